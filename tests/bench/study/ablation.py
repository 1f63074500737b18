"""What each level of skipping saves: switched off in turn, on free motion, near motion, sliding and deep contact."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from crease.base.attitude import to_matrix
from crease.base.native import skip_mask
from crease.lab.setup import Result, Table, machine, make_path, text_rows
from crease.replay.replay import ReplayOptions, run_path

from study.against_exact import BenchSetup

F64 = npt.NDArray[np.float64]

TICKS = 1000
STEP_MM = 0.03
HEIGHTS_MM = {"free": 250.0, "near": 2.0, "sliding": -0.5, "deep": -12.0}
"""Height of the tool's lowest corner above the face."""

SKIPS = {
    "all": skip_mask(["all"]),
    "without top": skip_mask(["tree", "coherence"]),
    "without tree": skip_mask(["top", "coherence"]),
    "without coherence": skip_mask(["top", "tree"]),
    "none": 0,
}
HALF_MM = 30.0
"""Half the side of the tool."""


def motion(height_mm: float) -> F64:
    """Poses (n, 7) of the 60 mm cube beside the block's edge, sliding along it as it turns slowly."""
    s = np.linspace(-0.5, 0.5, TICKS)
    turn = np.column_stack([np.ones(TICKS), 0.12 + 0.05 * s, -0.1 + 0.08 * s, 0.2 * s])
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    up = to_matrix(turn)[:, 2]
    lowest = -HALF_MM * np.abs(up).sum(axis=1)
    way = STEP_MM * TICKS * s
    # The block fills x < 0, z < 0: the tool stands over its top face, away from the edge.
    at = np.column_stack([np.full(TICKS, -60.0), way, height_mm - lowest])
    return np.hstack([1e-3 * at, turn])


def run(setup: BenchSetup) -> Result:
    """A row for each motion and each level that is left out."""
    result = Result(
        "ablation",
        "What skipping saves",
        "The 60 mm cube of 2,700 triangles over the 45,000-triangle block, samples 2 mm apart, "
        f"{STEP_MM:g} mm a tick: {', '.join(f'{k} {v:g} mm' for k, v in HEIGHTS_MM.items())} "
        "above the face. Every answer is the same to the bit. Median over the ticks, least of "
        f"{setup.repeat} runs. Machine: {machine()}.",
    )
    scene = setup.scene("block45k", "cube60_2700", 2.0, 2.0)
    rows: list[tuple[object, ...]] = []
    columns: dict[str, list[float]] = {"height_mm": [], "skip": []}
    for name, height in HEIGHTS_MM.items():
        path = make_path(motion(height)[:: setup.every])
        whole = None
        for how, skip in SKIPS.items():
            found = run_path(scene, path, ReplayOptions(skip=skip), repeat=setup.repeat)
            whole = found if whole is None else whole
            same = bool((found["force_N"] == whole["force_N"]).all())
            values = {k: float(np.median(found[k])) for k in ("points", "nodes", "contacts")}
            values["us"] = 1e-3 * float(np.median(found["tick_ns"]))
            columns["height_mm"].append(height)
            columns["skip"].append(skip)
            for key, value in values.items():
                columns.setdefault(key, []).append(value)
            saved = values["us"] / max(1e-3 * float(np.median(whole["tick_ns"])), 1e-9)
            rows.append((name, how, f"{values['points']:,.0f}", f"{values['nodes']:,.0f}", f"{values['contacts']:,.0f}",
                         f"{values['us']:.2f}", f"{saved:.1f}", "yes" if same else "NO"))  # fmt: skip
    setup.write_csv(result, "ablation.csv", {k: np.array(v) for k, v in columns.items()})
    heads = ("motion", "skips", "samples looked at", "spheres", "inside", "tick, us", "times as long",
             "same bits")  # fmt: skip
    result.tables.append(Table("Each level of skipping left out", heads, text_rows(rows)))
    for name in HEIGHTS_MM:
        mine = {str(r[1]): str(r[6]) for r in rows if r[0] == name}
        worst = max((k for k in mine if k.startswith("without")), key=lambda k: float(mine[k]))
        result.found.append(
            f"{name}: {worst} costs most, {mine[worst]} times the time; none {mine['none']} times."
        )
    return result
