"""Where the method breaks: a plate thinner than the penetration, a tool fully inside, a peg in a hole."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from crease.draw.plot import COLOURS, STYLE, new_figure
from crease.lab.exact import exact_path, make_solids
from crease.lab.setup import F64, MM, Result, Setup, Table, make_path, text_rows, upright
from crease.replay.replay import ReplayOptions, run_path

STIFFNESS_N_M = 1000.0
METHODS = {
    "way out": ReplayOptions(stiffness_N_m=STIFFNESS_N_M),
    "extent": ReplayOptions(stiffness_N_m=STIFFNESS_N_M, response="extent"),
    "as published": ReplayOptions(stiffness_N_m=STIFFNESS_N_M, response="extent", coverage="hard"),
    "sphere proxy": ReplayOptions(stiffness_N_m=STIFFNESS_N_M, response="sphere_proxy"),
}
WRONG_SHARE = 0.2
"""The answer counts as wrong where it is off by more than this share of what is expected, and by WRONG_MM."""
WRONG_MM = 0.1
EXACT_EVERY = 4
"""Every n-th pose has its exact contact computed."""


@dataclass(frozen=True)
class Case:
    """A push along one axis: meshes, voxel and spacing in mm, poses, how far it was pushed, what it should feel."""

    name: str
    about: str
    static: str
    tool: str
    sizes_mm: tuple[float, float]
    poses: F64
    axis: int
    pushed_mm: F64
    expected_mm: F64


def cases(thinned: Callable[[F64], F64] = lambda way_mm: way_mm) -> list[Case]:
    """The three, with what a body that was pushed in from one side has to feel: its whole way back."""
    plate = thinned(np.linspace(-0.5, 34.0, 691))
    deep = thinned(np.linspace(-0.5, 40.0, 811))
    aside = thinned(np.linspace(0.0, 2.0, 401))
    zero, side = np.zeros_like, np.ones_like
    return [
        Case("plate", "Ball R 15 mm through a plate 1 mm thick", "plate", "ball15", (1.0, 1.2),
             upright(MM * np.column_stack([zero(plate), zero(plate), 15.5 - plate])), 2, plate, plate.clip(0.0)),
        Case("fully inside", "Cube of 20 mm into a wall 50 mm thick", "wall", "cube20", (2.0, 2.0),
             upright(MM * np.column_stack([3.0 * side(deep), 2.0 * side(deep), 10.0 - deep])), 2, deep, deep.clip(0.0)),
        Case("peg in a hole", "Peg R 9.8 mm in a hole R 10 mm", "hole_block", "peg", (1.0, 1.2),
             upright(MM * np.column_stack([aside, zero(aside), -15.0 * side(aside)])), 0, aside,
             -(aside - 0.2).clip(0.0)),
    ]  # fmt: skip


INPUTS = tuple(f"{mesh}.stl" for case in cases() for mesh in (case.static, case.tool))
"""Files of the folder of meshes."""


def run(setup: Setup) -> Result:
    """Force against the way pushed, beside what it should be, and where it goes wrong."""
    result = Result(
        "thin-and-deep",
        "Where it breaks: thin and deep",
        "The tick answers each pose as it stands, without a memory of where the tool came from. "
        "Expected: the way back to where the "
        "tool was pushed in. Exact extent: what the contact-zone method converges to, from booleans. Through a "
        "plate it is the plate's thickness, fully "
        "inside nothing, and in a round hole the whole width of the crescent that overlaps, many "
        "times the true depth: it is the "
        "definition that breaks, not its computation. A proxy has the memory, but is a ball.",
    )
    rows: list[tuple[object, ...]] = []
    felt: dict[str, dict[str, F64]] = {}
    found = cases(setup.thinned)
    for case in found:
        scene = setup.scene(case.static, case.tool, *case.sizes_mm)
        path = make_path(case.poses)
        defined = _defined_mm(setup, case)
        columns = {
            "pushed_mm": case.pushed_mm,
            "expected_mm": case.expected_mm,
            "defined_mm": defined,
        }
        felt.setdefault(case.name, {})["exact extent"] = defined
        rows.append((case.about, "exact extent", *_where_wrong(case, defined)))
        for name, options in METHODS.items():
            if name == "sphere proxy" and case.tool != "ball15":
                continue
            ticks = run_path(scene, path, options)
            felt_mm = 1e3 * ticks["force_N"][:, case.axis].astype(np.float64) / STIFFNESS_N_M
            felt.setdefault(case.name, {})[name] = columns[f"{name.replace(' ', '_')}_mm"] = felt_mm
            rows.append((case.about, name, *_where_wrong(case, felt_mm)))
        setup.write_csv(result, f"{case.name.replace(' ', '_')}.csv", columns)
    heads = (
        "push",
        "method",
        "right up to, mm",
        "largest error, mm",
        "pushes the wrong way",
        "lets go",
    )
    result.tables.append(
        Table("Force over stiffness against the way pushed", heads, text_rows(rows))
    )
    _draw(setup, result, found, felt)
    result.found += [
        f"{case.about}: the way out is right up to {_where_wrong(case, felt[case.name]['way out'])[0]} mm."
        for case in found
    ]
    return result


def _defined_mm(setup: Setup, case: Case) -> F64:
    """What the exact contact (crease.lab.exact) gives along the push: every n-th pose, straight lines between."""
    chosen = np.unique(np.r_[np.arange(0, len(case.poses), EXACT_EVERY), len(case.poses) - 1])
    solids = make_solids(setup.mesh(case.static), setup.mesh(case.tool))
    force = exact_path(solids, case.poses[chosen])[0][:, case.axis]
    return np.interp(np.arange(len(case.poses)), chosen, 1e3 * force)


def _where_wrong(case: Case, felt_mm: F64) -> tuple[str, str, str, str]:
    """How far the answer is right, how wrong it gets, and whether it turns round or vanishes."""
    error = np.abs(felt_mm - case.expected_mm)
    wrong = error > np.maximum(WRONG_MM, WRONG_SHARE * np.abs(case.expected_mm))
    first = int(np.argmax(wrong)) if wrong.any() else len(wrong)
    against = (felt_mm * np.sign(case.expected_mm) < -WRONG_MM) & (case.expected_mm != 0.0)
    gone = (np.abs(felt_mm) < 1e-6) & (np.abs(case.expected_mm) > WRONG_MM)
    right = "all the way" if first == len(wrong) else f"{case.pushed_mm[max(0, first - 1)]:.2f}"

    def since(mask: npt.NDArray[np.bool_]) -> str:
        return f"from {case.pushed_mm[int(np.argmax(mask))]:.2f} mm" if mask.any() else "never"

    return right, f"{float(error.max()):.2f}", since(against), since(gone)


def _draw(setup: Setup, result: Result, found: list[Case], felt: dict[str, dict[str, F64]]) -> None:
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        figure = new_figure(12.0, 3.9)
        for axis, case in zip(figure.subplots(1, 3), found, strict=True):
            axis.plot(
                case.pushed_mm, case.expected_mm, color="black", ls=(0, (4, 2)), label="expected"
            )
            for (name, values), colour in zip(
                felt[case.name].items(), ("#888888", *COLOURS), strict=False
            ):
                axis.plot(case.pushed_mm, values, color=colour, label=name)
            axis.set_title(case.about, fontsize=8.5)
            axis.set_xlabel("pushed, mm")
        figure.axes[0].set_ylabel("force / stiffness, mm")
        figure.axes[0].legend(loc="upper left")
        setup.write_figure(
            result, "thin_and_deep.png", figure, "Force along the push, and what it should be."
        )
