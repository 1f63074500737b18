"""Exact way out of every scene: force, torque, depth and normal from convex pieces, without quadrature.

    python tests/golden/gen/way_out_tables.py SCENE|all [--every N] [--skip SCENE] [-o DIR]

Reads meshes/scenes.toml and build/meshes (made by meshes/make.py), writes tests/golden/exact/NAME.csv.gz: the same
bytes on every run, columns as in README.md; `areas` is the number of contacts that push. Definitions: force/README.md.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from extent_tables import Floats, chosen_ticks, read_path, summary, write_tables
from overlap import make_solid, read_stl
from way_out import contact, make_body

# Contacts that push less than this (mm) are not counted.
PUSHES_MM = 1e-6


def solve_scene(scene: dict[str, Any], meshes: Path, every: int) -> tuple[Floats, str]:
    """Rows (n, 13) of one scene and its summary line. Errors: ValueError if a body has no cover."""
    solids = [make_solid(*read_stl(meshes / scene[k])) for k in ("static", "tool")]
    static, tool = map(make_body, solids)
    trace = read_path(meshes / scene["path"])
    ticks = chosen_ticks(trace, every)
    matrix = trace.attitude.as_matrix()
    rows = []
    for i in ticks:
        found = contact(static, tool, matrix[i], trace.position_mm[i])
        moved = solids[1].body.transform(np.column_stack([matrix[i], trace.position_mm[i]]))
        depth, normal = 0.0, np.zeros(3)
        for half in found.halves:
            if half.depth_mm > depth:
                depth, normal = half.depth_mm, half.normal
        head = [trace.t_s[i], *found.force_mm(), depth, *normal]
        count = int((found.push_mm > PUSHES_MM).sum())
        volume = (moved ^ solids[0].body).volume()
        rows.append(np.array([*head, count, volume, *found.torque_mm2()], float))
    table = np.array(rows)
    return table, summary(table, trace, ticks, solids[1])


if __name__ == "__main__":
    write_tables("Exact way out of the test scenes.", "exact", solve_scene)
