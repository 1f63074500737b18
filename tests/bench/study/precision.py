"""What single precision costs: the firmware built in float32 and in double, over the same paths, pose by pose."""

from __future__ import annotations

import tempfile
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from crease.draw.plot import COLOURS, STYLE, new_figure
from crease.lab.setup import Result, Table, machine, text_rows
from crease.replay.measures import DEEP_M, angle_deg
from crease.replay.replay import ReplayOptions, run_path

from study.against_exact import BenchSetup, Exact, exact_force_N
from study.points import write_records
from study.program import IN_DOUBLE, build_each, run_in_double
from study.sweeps import SWEEPS

PATHS = ("edge90_cube", "edge90_sphere", "part_spanner")
RESPONSES = ("way_out", "extent")
COUNTS = ("areas", "zones", "contacts", "clusters")
"""What a tick decides and reports: a tick where one of them differs took another decision."""

CHOICE_UM = 0.1
"""Ticks that differ by more, over stiffness, are told one by one: rounding alone stays well below."""

Rows = npt.NDArray[Any]
F64 = npt.NDArray[np.float64]
HEADS = ("path", "response", "ticks in contact", "decided otherwise", "above 0.1 um", "force RMS, um", "p99, um",
         "max, um", "at tick", "direction p99, deg", "max, deg", "torque max, uN m", "error float32, mm",
         "error double, mm", "tick float32, us", "tick double, us")  # fmt: skip


@dataclass(frozen=True)
class Cost:
    """Of one path: the columns of HEADS. Forces over stiffness, in um; errors are RMS against the exact table."""

    path: str
    response: str
    ticks: int
    flips: int
    choices: int
    force_rms_um: float
    force_p99_um: float
    force_max_um: float
    at_tick: int
    direction_p99_deg: float
    direction_max_deg: float
    torque_max_uNm: float
    error_single_mm: float
    error_double_mm: float
    single_us: float
    double_us: float


def force_um(single: Rows, double: Rows) -> F64:
    """Difference of the forces over stiffness, in um, at each tick."""
    gone = np.linalg.norm(single["force_N"] - double["force_N"], axis=1)
    return np.asarray(1e6 * gone / ReplayOptions().stiffness_N_m)


def compare(path: str, response: str, single: Rows, double: Rows, exact: Exact | None) -> Cost:
    """Both replays of a path, row by row."""
    k = ReplayOptions().stiffness_N_m
    mine, other = single["force_N"].astype(np.float64), double["force_N"]
    touching = (single["contacts"] > 0) | (double["contacts"] > 0)
    um = force_um(single, double)
    deep = np.linalg.norm(other, axis=1) > k * DEEP_M
    turn = angle_deg(mine, other)[deep]
    flips = np.any([single[name] != double[name] for name in COUNTS], axis=0)
    true = np.full_like(other, np.nan) if exact is None else exact_force_N(exact, k)
    torque = np.linalg.norm(single["torque_Nm"] - double["torque_Nm"], axis=1)
    return Cost(
        path, response, int(touching.sum()), int(flips.sum()), int((um > CHOICE_UM).sum()),
        _rms(um[touching]), float(np.percentile(um[touching], 99)), float(um.max()), int(um.argmax()),
        float(np.percentile(turn, 99)), float(turn.max()), 1e6 * float(torque.max()),
        *(1e3 / k * _rms(np.linalg.norm(f - true, axis=1)[touching]) for f in (mine, other)),
        *(1e-3 * float(np.median(rows["tick_ns"][touching])) for rows in (single, double)),
    )  # fmt: skip


def _rms(values: F64) -> float:
    return float(np.sqrt((values**2).mean()))


def run(setup: BenchSetup) -> Result:
    """Every path with the way out and with extent, as table, CSV and figure.   Errors: CreaseError."""
    result = Result(
        "precision",
        "What float32 costs",
        "The same sources built twice: in float32, and with every float32 widened to a double. The image's numbers are "
        "the same in both; pose and arithmetic are rounded in one only. Differences of force are over stiffness. Times "
        f"are the least of {setup.repeat} runs of each pose. Machine: {machine()}.",
    )
    sweeps = {s.path: s for s in SWEEPS}
    costs: list[Cost] = []
    curves: dict[str, F64] = {}
    with tempfile.TemporaryDirectory() as folder:
        programs = build_each(Path(folder), IN_DOUBLE, RESPONSES)
        for name in PATHS:
            path, sweep = setup.path(name), sweeps[name]
            scene = setup.scene(sweep.static, sweep.tool, *sweep.base_mm)
            for response in RESPONSES:
                options = ReplayOptions(response=response)
                single = run_path(scene, path, options, setup.repeat)
                double = run_in_double(programs[response], scene, path, options, setup.repeat)
                exact = setup.exact_of(name, options)
                costs.append(compare(name, response, single, double, exact))
                if response == RESPONSES[0]:
                    curves[name] = force_um(single, double)
    rows = [astuple(cost) for cost in costs]
    result.tables.append(Table("float32 against double", HEADS, text_rows(rows)))
    write_records(setup.out / "precision.csv", costs)
    result.files.append("precision.csv")
    result.found += [_said(cost) for cost in costs]
    _draw(setup, result, curves, costs)
    return result


def _said(c: Cost) -> str:
    return (
        f"{c.path}, {c.response}: float32 changes the force by {c.force_rms_um:.2g} um RMS, at most by "
        f"{c.force_max_um:.2g} um (tick {c.at_tick}), its direction at most by {c.direction_max_deg:.2g} deg. "
        f"{_error(c)}Ticks that decide otherwise: {c.flips}; that differ by more than {CHOICE_UM:g} um: {c.choices}."
    )


def _error(c: Cost) -> str:
    """A sentence; nothing where there is no exact table."""
    if np.isnan(c.error_single_mm):
        return ""
    return f"Error against the exact: {c.error_single_mm:.4g} mm in float32, {c.error_double_mm:.4g} mm in double. "


def _draw(setup: BenchSetup, result: Result, curves: dict[str, F64], costs: list[Cost]) -> None:
    import matplotlib as mpl

    errors_um = {c.path: 1e3 * c.error_single_mm for c in costs if c.response == RESPONSES[0]}
    with mpl.rc_context(STYLE):
        figure = new_figure(9.0, 7.0)
        axes = figure.subplots(len(curves), 1, sharey=True)
        for axis, (name, um), colour in zip(axes, curves.items(), COLOURS, strict=False):
            axis.semilogy(
                np.arange(len(um)), np.where(um > 0, um, np.nan), ".", ms=2.5, color=colour
            )
            if errors_um[name] > 0.0:
                axis.axhline(errors_um[name], ls="--", lw=1.0, color="#444444")
                said = f"error against the exact force: {errors_um[name]:.0f} um RMS"
                axis.text(0.01, errors_um[name] * 0.8, said, va="top", transform=axis.get_yaxis_transform(),
                          fontsize=8, color="#444444")  # fmt: skip
            axis.set_title(name, loc="left")
            axis.set_ylabel("um")
        axes[-1].set_xlabel("tick")
        figure.suptitle(
            "What float32 costs: force of float32 less force of double, over stiffness", fontsize=11
        )
        caption = "Each dot is a tick; forces that are the same to the bit have none. Dashed: the method's own error."
        setup.write_figure(result, "precision.png", figure, caption)
