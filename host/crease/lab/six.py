"""A held tool in six degrees of freedom beside other ways to hold it, and the exact wrench (tests/bench/SIX.md)."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.draw.plot import COLOURS, STYLE, legend_beside, new_figure
from crease.lab import six_drum
from crease.lab.setup import F64, Result, Setup, Table, make_path, text_rows
from crease.lab.six_rivals import NAMES, Line, make_rival
from crease.replay.replay import CoupleOptions, ReplayOptions, run_path

SCENES = {
    "plate_1": "plate 1 mm thin, pressed 10 mm deep",
    "corner": "corner of three walls",
    "key": "key in its slot, 0.1 mm wider",
    "ball_joint": "ball pulled round in its socket",
    "stick_edge": "stick drawn across an edge",
}
OURS = "coupled tick"
LABELS = (OURS, *NAMES)
"""The last is for tools that are lines alone: on the stick."""
OFF_SCALE = 3.0
"""Curves are cut where they leave the exact wrench's range by so much of it."""
INPUTS = (
    *(f"six/{name}.{end}" for name in SCENES for end in ("csv", "json", "static.stl", "tool.stl")),
    *("six/plate_needle.json", "six/plate_needle.tool.stl"),
)
"""Files of the folder of meshes."""
SHADED = (OURS, "god-object", "force shading")
"""On the drum: what is shaded, beside what is not."""
DASHED = {"force shading": "god-object", "contact levels": "static coupling"}
"""Methods made of others, whose curve they often lie on: drawn over it."""


def run(setup: Setup) -> Result:
    """Force and torque along five paths: ours, other methods, and the exact answer."""
    result = Result(
        "six",
        "Six degrees of freedom",
        "A tool is held outside by a spring of 2000 N/m and 5 N m/rad, which is what the hand feels. Seven ways to "
        "find where it is held, one of them for a tool that is a line, on the same image, without friction; dots: the "
        "least energy of the springs with the tool outside, from the true geometry.",
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
        setup.check_left(bool(kept.any()), "no pose whose exact answer is known")
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
    _draw_drum(setup, result, six)
    ours = [max(float(r[2]), float(r[3])) for r in rows if r[1] == OURS]  # type: ignore[arg-type]
    result.found.append(f"The coupled tick is off by {max(ours):.2g} mm at most.")
    return result


def _answers(six: Setup, name: str, spec: dict[str, Any]) -> dict[str, F64]:
    """Wrenches (n, 6) of every method."""
    springs = float(spec["spring"]["stiffness_N_m"]), float(spec["spring"]["stiffness_Nm_rad"])
    image = (spec["image"].get(what) for what in ("voxel_mm", "spacing_mm", "tolerance_mm"))
    scene = six.scene(f"{name}.static", f"{name}.tool", *image)
    path = six.path(name)
    coupled = run_path(scene, path, ReplayOptions(springs[0], couple=CoupleOptions(springs[1])))
    found = {OURS: np.hstack([coupled["force_N"], coupled["torque_Nm"]]).astype(np.float64)}
    for label in NAMES:
        method = make_rival(label, scene, springs, Line.of(spec))
        if method is not None:
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
        figure = new_figure(17.0, 6.0)
        axes = figure.subplots(2, len(SCENES), sharex="col")
        for column, name in enumerate(SCENES):
            ticks, right = exact[name]
            for row, (part, scale) in enumerate(((slice(0, 3), 1.0), (slice(3, 6), 1e3))):
                axis = axes[row, column]
                dots = scale * np.linalg.norm(right[:, part], axis=1)
                for label in sorted(drawn[name], key=lambda v: (v in DASHED, -LABELS.index(v))):
                    wrench = drawn[name][label]
                    curve = scale * np.linalg.norm(wrench[:, part], axis=1)
                    wide = 1.8 if label == OURS else 1.0
                    axis.plot(
                        setup.every * np.arange(len(curve)),
                        curve,
                        color=COLOURS[LABELS.index(label)],
                        lw=wide,
                        ls="--" if label in DASHED else "-",
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
        legend_beside(axes[0, list(SCENES).index("stick_edge")])
        setup.write_figure(
            result,
            "six.png",
            figure,
            "Force and torque on the hand along five paths; dots: exact.",
        )


def _draw_drum(setup: Setup, result: Result, six: Setup) -> None:
    """Directions of the force round a drum of facets, and a row for each method."""
    import matplotlib as mpl

    spec = json.loads((six.meshes / "plate_needle.json").read_text(encoding="utf-8"))
    springs = float(spec["spring"]["stiffness_N_m"]), float(spec["spring"]["stiffness_Nm_rad"])
    scene, pose = six_drum.make_scene(six.mesh("plate_needle.tool")), six_drum.poses()
    at = np.degrees(np.arctan2(pose[:, 0], pose[:, 2]))[six_drum.TICKS_IN :]
    rows: list[tuple[object, ...]] = []
    with mpl.rc_context(STYLE):
        figure = new_figure(7.0, 3.2)
        axes = figure.subplots()
        for label in SHADED:
            if label == OURS:
                options = ReplayOptions(springs[0], couple=CoupleOptions(springs[1]))
                force = run_path(scene, make_path(pose), options)["force_N"].astype(np.float64)
            else:
                method = six_drum.rival(label, scene, springs, Line.of(spec))
                assert method is not None
                force = np.array([method.tick(p)[0][:3] for p in pose])
            rows.append((label, *six_drum.turns_deg(force, pose)))
            axes.plot(
                at,
                six_drum.turned_deg(force, pose)[six_drum.TICKS_IN :],
                color=COLOURS[LABELS.index(label)],
                ls="--" if label == "god-object" else "-",
                label=label,
            )
        axes.axhline(0.0, color="black", lw=0.8, label="round drum")
        axes.set_xlabel("hand, degrees round the drum")
        axes.set_ylabel("force off the round drum's, degrees")
        legend_beside(axes)
        setup.write_figure(
            result,
            "six_drum.png",
            figure,
            f"A needle's tip {six_drum.DEEP_MM:g} mm deep round a drum of {six_drum.SIDES} sides: what facets do to "
            "the force's direction, and what shading makes of it.",
        )
    heads = ("method", "largest turn in a tick, deg", "off the round drum, deg RMS")
    result.tables.append(Table("Round a drum of facets", heads, text_rows(rows)))
