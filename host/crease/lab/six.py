"""A held tool in six degrees of freedom beside other ways to hold it, and the exact wrench (tests/bench/SIX.md)."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.draw.plot import COLOURS, STYLE, new_figure
from crease.lab.setup import F64, Result, Setup, Table, text_rows
from crease.lab.six_rivals import RIVALS
from crease.replay.replay import CoupleOptions, ReplayOptions, run_path

SCENES = {
    "plate_1": "plate 1 mm thin, pressed 10 mm deep",
    "corner": "corner of three walls",
    "key": "key in its slot, 0.1 mm wider",
}
OURS = "coupled tick"
OFF_SCALE = 3.0
"""Curves are cut where they leave the exact wrench's range by so much of it."""


def run(setup: Setup) -> Result:
    """Force and torque along three paths: ours, three other methods, and the exact answer."""
    result = Result(
        "six",
        "Six degrees of freedom",
        "A tool is held outside by a spring of 2000 N/m and 5 N m/rad, which is what the hand feels. Four ways to find "
        "where it is held, on the same image, without friction; dots: the least energy of the springs with the tool "
        "outside, from the true geometry.",
    )
    six = replace(setup, meshes=setup.meshes / "six", _meshes={}, _scenes={})
    rows: list[tuple[object, ...]] = []
    drawn: dict[str, dict[str, F64]] = {}
    columns: dict[str, npt.NDArray[Any]] = {}
    exact: dict[str, tuple[npt.NDArray[np.int64], F64]] = {}
    for name, about in SCENES.items():
        six.path(name)  # says how to make what is missing
        spec = json.loads((six.meshes / f"{name}.json").read_text(encoding="utf-8"))
        found = _answers(six, name, spec)
        table = np.array(spec["exact"]["rows"], np.float64)
        kept = table[:, 0] % setup.every == 0
        ticks, right = table[kept, 0].astype(np.int64) // setup.every, table[kept, 1:]
        exact[name], drawn[name] = (ticks, right), found
        for label, wrench in found.items():
            columns |= {
                f"{name}_{label.replace(' ', '_')}_{what}": np.linalg.norm(wrench[:, part], axis=1)
                for what, part in (("force_N", slice(0, 3)), ("torque_Nm", slice(3, 6)))
            }
            rows.append((about, label, *_off_mm(spec, wrench[ticks] - right)))
    longest = max(len(c) for c in columns.values())
    padded = {
        n: np.pad(c, (0, longest - len(c)), constant_values=np.nan) for n, c in columns.items()
    }
    setup.write_csv(result, "six.csv", {"tick": setup.every * np.arange(longest), **padded})
    heads = ("scene", "method", "force off, mm", "torque off, mm")
    caption = "Off the exact wrench, RMS: force over the spring's stiffness, torque over that and the tool's radius"
    result.tables.append(Table(caption, heads, text_rows(rows)))
    _draw(setup, result, drawn, exact)
    ours = [max(float(r[2]), float(r[3])) for r in rows if r[1] == OURS]  # type: ignore[arg-type]
    result.found.append(f"The coupled tick is off by {max(ours):.2g} mm at most.")
    return result


def _answers(six: Setup, name: str, spec: dict[str, Any]) -> dict[str, F64]:
    """Wrenches (n, 6) of every method."""
    springs = float(spec["spring"]["stiffness_N_m"]), float(spec["spring"]["stiffness_Nm_rad"])
    image = spec["image"]
    scene = six.scene(f"{name}.static", f"{name}.tool", image["voxel_mm"], image["spacing_mm"])
    path = six.path(name)
    coupled = run_path(scene, path, ReplayOptions(springs[0], couple=CoupleOptions(springs[1])))
    found = {OURS: np.hstack([coupled["force_N"], coupled["torque_Nm"]]).astype(np.float64)}
    for label, made in RIVALS.items():
        method = made(scene, springs)
        found[label] = np.array([method.tick(pose)[0] for pose in path.rows[:, 1:]])
    return found


def _off_mm(spec: dict[str, Any], off: F64) -> tuple[float, float]:
    """RMS of force and of torque, as lengths."""
    rms = np.sqrt(np.mean(np.sum(off.reshape(-1, 2, 3) ** 2, axis=2), axis=0))
    k_t, radius_m = float(spec["spring"]["stiffness_N_m"]), 1e-3 * float(spec["tool_radius_mm"])
    return float(1e3 * rms[0] / k_t), float(1e3 * rms[1] / k_t / radius_m)


def _draw(
    setup: Setup,
    result: Result,
    drawn: dict[str, dict[str, F64]],
    exact: dict[str, tuple[npt.NDArray[np.int64], F64]],
) -> None:
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        figure = new_figure(11.0, 5.6)
        axes = figure.subplots(2, len(SCENES), sharex="col")
        for column, name in enumerate(SCENES):
            ticks, right = exact[name]
            for row, (part, scale) in enumerate(((slice(0, 3), 1.0), (slice(3, 6), 1e3))):
                axis = axes[row, column]
                dots = scale * np.linalg.norm(right[:, part], axis=1)
                for colour, (label, wrench) in zip(
                    COLOURS[3::-1], reversed(drawn[name].items()), strict=False
                ):
                    curve = scale * np.linalg.norm(wrench[:, part], axis=1)
                    wide = 1.8 if label == OURS else 1.0
                    axis.plot(
                        setup.every * np.arange(len(curve)),
                        curve,
                        color=colour,
                        lw=wide,
                        label=label,
                    )
                axis.plot(
                    setup.every * ticks, dots, "o", ms=3.5, color="black", label="exact", zorder=5
                )
                most = float(dots.max(initial=0.0))
                axis.set_ylim(-0.03 * most, (1.0 + 0.15 * OFF_SCALE) * most if most else None)
            axes[0, column].set_title(SCENES[name])
            axes[1, column].set_xlabel("tick, ms")
        axes[0, 0].set_ylabel("force, N")
        axes[1, 0].set_ylabel("torque, N mm")
        axes[0, 0].legend(loc="upper left")
        setup.write_figure(
            result,
            "six.png",
            figure,
            "Force and torque on the hand along three paths; dots: exact.",
        )
