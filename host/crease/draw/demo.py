"""`make demo`: the corner trajectory with the contact-zone method and with the fixed 45 degrees: figures and a page.

python -m crease.draw.demo SCENES.toml MESHES IMAGES OUT
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from crease.bake.scene_list import SceneSpec, load_specs
from crease.base.errors import CreaseError
from crease.base.scene import open_scene
from crease.base.table import Column, write_atomic, write_bytes, write_table
from crease.draw.corner import CornerCase, draw_corner, section_xz
from crease.draw.plot import draw_ticks, forces_N, save_figure
from crease.draw.view import Replay, make_page
from crease.mesh.mesh import load_mesh
from crease.replay.replay import REPEAT, ReplayOptions, run_path, to_columns
from crease.replay.trajectory import load_trajectory

SCENES = ("edge90_sphere", "edge90_cube")
NAMES = {"zones": "contact zones", "fixed45": "fixed 45 degrees"}


def replay_both(spec: SceneSpec, images: Path, out: Path) -> dict[str, dict[str, Column]]:
    """Tables of a scene by response, also written to OUT/SCENE.RESPONSE.csv."""
    scene = open_scene(images / f"{spec.name}.crs")
    path = load_trajectory(spec.path)
    tables = {}
    for response in NAMES:
        options = ReplayOptions(stiffness_N_m=spec.stiffness_N_m, response=response)
        rows = run_path(scene, path, options, repeat=REPEAT)
        tables[response] = to_columns(path, rows, REPEAT)
        write_table(out / f"{spec.name}.{response}.csv", tables[response])
    return tables


def draw_both(tables: dict[str, dict[str, Column]], title: str, figure_path: Path) -> None:
    """The tables of both responses over each other."""
    figure = draw_ticks(list(tables.values()), [NAMES[name] for name in tables], title)
    write_atomic(figure_path, lambda file: save_figure(figure, file, "png"))


def draw_corner_of(
    spec: SceneSpec, tables: dict[str, dict[str, Column]], figure_path: Path
) -> None:
    """The corner in section with the arrows of both responses."""
    position_m = load_trajectory(spec.path).position_m
    tool = load_mesh(spec.tool, spec.tool_unit_m)
    radius_m = float(np.linalg.norm(tool.vertices_m, axis=1).max())
    outlines = section_xz(load_mesh(spec.static, spec.unit_m), float(position_m[:, 1].mean()))
    cases = [CornerCase(NAMES[name], position_m, forces_N(table)) for name, table in tables.items()]
    figure = draw_corner(cases, outlines, radius_m)
    write_atomic(figure_path, lambda file: save_figure(figure, file, "png"))


def write_view(
    spec: SceneSpec, tables: dict[str, dict[str, Column]], images: Path, page: Path
) -> None:
    """Both replays side by side, moving."""
    replays = [Replay(NAMES[name], table) for name, table in tables.items()]
    made = make_page(replays, open_scene(images / f"{spec.name}.crs"), spec.about)
    write_bytes(page, made.text.encode("utf-8"))


def main(argv: list[str] | None = None) -> int:
    """See the module."""
    parser = argparse.ArgumentParser(
        prog="python -m crease.draw.demo", description="The demonstration."
    )
    for name in ("table", "meshes", "images", "out"):
        parser.add_argument(name, type=Path)
    args = parser.parse_args(argv)
    try:
        specs = load_specs(args.table, args.meshes)
        args.out.mkdir(parents=True, exist_ok=True)
        for name in SCENES:
            tables = replay_both(specs[name], args.images, args.out)
            draw_both(tables, specs[name].about, args.out / f"{name}.png")
            if name == SCENES[0]:
                draw_corner_of(specs[name], tables, args.out / "corner.png")
                write_view(specs[name], tables, args.images, args.out / "corner.html")
    except CreaseError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
