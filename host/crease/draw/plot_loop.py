"""Figure of a run of the closed loop: forces, depth, energy, timing of the bus, state and trouble."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from crease.base.native import ffi, lib
from crease.draw.plot import (
    COLOURS,
    FORCE_SPAN_N,
    LENGTH_SPAN_MM,
    STYLE,
    TORQUE_SPAN_NM,
    Table,
    at_least,
    forces_N,
    legend_beside,
    mark_few,
    new_figure,
    plain,
    torques_Nm,
)
from crease.replay.recording import Recording, fault_names, limit_names, mode_names, to_columns

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

F64 = npt.NDArray[np.float64]

MODE_COLOURS = ("#dddddd", "#c2c2c2", "#a8a8a8", "#8fbcdb", "#7fc7a3", "#f0c75e", "#d9534f")
"""init, bus-up, calibrating, idle, rendering, limited, fault."""

ENERGY_SPAN_MJ = 0.01
"""Least height of the axis of the energy."""

MARGIN_MIN = 0.05
"""Nearer to the singularity joint torques do not tell a force at the tip."""


def motor_force_N(recording: Recording) -> F64:
    """Force at the tip that the motors gave beyond compensation, by the torque the drives told (0x6077); (n, 3), world.

    NaN outside of rendering and near the singularity.
    """
    rows, config = recording.rows, recording.config
    told = np.full((len(rows), 3), np.nan)
    joints, kinematics = ffi.new("cr_joints *"), ffi.new("cr_kinematics *")
    rated = 1e-3 * np.array([axis.rated for axis in config.axis], dtype=np.float64)
    rendering = (lib.CR_MODE_RENDERING, lib.CR_MODE_LIMITED)
    for k in np.flatnonzero(np.isin(rows["mode"], rendering) & (rows["margin"] > MARGIN_MIN)):
        joints.joint, joints.wrist_rad = rows["joint"][k].tolist(), rows["wrist_rad"][k].tolist()
        lib.cr_kinematics_solve(ffi.addressof(config, "arm"), joints, kinematics)
        jacobian_t = np.array([[c.x, c.y, c.z] for c in kinematics.column])
        beyond = rated * rows["actual"][k] - rows["torque"][k]
        told[k] = np.linalg.solve(jacobian_t, beyond) + rows["force_N"][k]
    return told


def recording_table(recording: Recording) -> dict[str, npt.NDArray[Any]]:
    """The columns of a recording, and what its motors gave as motor_fx_N and so on."""
    columns = to_columns(recording.rows)
    columns.update(
        zip(("motor_fx_N", "motor_fy_N", "motor_fz_N"), motor_force_N(recording).T, strict=True)
    )
    return columns


def draw_loop(table: Table, title: str) -> Figure:
    """Five panels over time: force (contact, commanded, felt), depth, energy, timing after SYNC, state and trouble.

    Shapes: columns of `crease hil --table`, of `recording_table` or of a re-run. Felt is the simulator's force on the
    hand where the table has it, else what the motors gave; a re-run knows neither. Of a run with a held tool
    (`crease hil --couple`) a sixth, below the force: torque.
    """
    import matplotlib as mpl

    held = "contact_tx_Nm" in table
    heights = [2.2, *([1.6] if held else []), 1.0, 1.0, 1.4, 1.2]
    with mpl.rc_context(STYLE):
        figure = new_figure(9.0, 11.0 if held else 9.5)
        panels = list(figure.subplots(len(heights), 1, sharex=True, height_ratios=heights))
        _draw_forces(panels[0], table)
        if held:
            _draw_torques(panels.pop(1), table)
        panels[1].plot(table["t_s"], 1e3 * np.asarray(table["depth_m"]), color=COLOURS[0])
        panels[1].set_ylabel("hand from the\nheld tool, mm" if held else "depth, mm")
        panels[1].set_ylim(bottom=0.0)
        at_least(panels[1], LENGTH_SPAN_MM)
        panels[2].plot(table["t_s"], 1e3 * np.asarray(table["energy_J"]), color=COLOURS[0])
        panels[2].axhline(0.0, color="#999999", lw=0.8)
        panels[2].set_ylabel("energy to the\nhand, mJ")
        at_least(panels[2], ENERGY_SPAN_MJ)
        _draw_timing(panels[3], table)
        _draw_state(panels[4], table)
        mark_few(figure.axes)
        panels[4].set_xlabel("time, s")
        panels[4].margins(x=0.01)
        figure.align_ylabels()
        figure.suptitle(plain(title), fontsize=11, fontweight="bold", wrap=True)
    return figure


def _size_N(table: Table, prefix: str) -> F64:
    return np.asarray(
        np.linalg.norm(
            np.stack([np.asarray(table[f"{prefix}f{a}_N"]) for a in "xyz"], axis=1), axis=1
        )
    )


def _draw_forces(axes: Axes, table: Table) -> None:
    felt = (
        ("hand_", "felt by the hand")
        if "hand_fx_N" in table
        else ("motor_", "felt: from the motors")
    )
    axes.plot(table["t_s"], _size_N(table, "contact_"), color=COLOURS[2], lw=2.2, label="contact")
    commanded = np.linalg.norm(forces_N(table), axis=1)
    axes.plot(table["t_s"], commanded, color=COLOURS[0], lw=1.0, label="commanded")
    if f"{felt[0]}fx_N" in table:
        axes.plot(table["t_s"], _size_N(table, felt[0]), color=COLOURS[1], lw=0.8, label=felt[1])
    axes.set_ylabel("|force|, N")
    at_least(axes, FORCE_SPAN_N)
    legend_beside(axes)


def _draw_torques(axes: Axes, table: Table) -> None:
    """About the tool's origin, and what the simulated hand feels about each axis of the wrist."""
    spring = np.stack([np.asarray(table[f"contact_t{a}_Nm"]) for a in "xyz"], axis=1)
    sent = np.linalg.norm(torques_Nm(table), axis=1)
    hand = np.stack([np.asarray(table[f"hand_{a}_Nm"]) for a in ("yaw", "pitch", "roll")], axis=1)
    size = np.linalg.norm(spring, axis=1)
    axes.plot(table["t_s"], size, color=COLOURS[2], lw=2.2, label="spring of the held tool")
    axes.plot(table["t_s"], sent, color=COLOURS[0], lw=1.0, label="commanded")
    felt = np.linalg.norm(hand, axis=1)
    axes.plot(table["t_s"], felt, color=COLOURS[1], lw=0.8, label="felt by the hand")
    axes.set_ylabel("|torque|, N m")
    at_least(axes, TORQUE_SPAN_NM)
    legend_beside(axes)


RUNNING = tuple(
    int(getattr(lib, f"CR_MODE_{name}")) for name in ("CALIBRATING", "IDLE", "RENDERING", "LIMITED")
)
"""Modes in which a torque frame answers the states of each tick. While drives come up and are set up, and in fault, the
tick waits for states that nobody sends."""


def slack_text(table: Table) -> str:
    """The least time from a torque frame to the next SYNC, of the ticks of a loop that runs."""
    running = np.isin(np.asarray(table["mode"]).astype(int), RUNNING)
    if not running.any():
        return "no tick with the drives up"
    torque_us = np.asarray(table["torque_us"], dtype=np.float64)[running]
    return f"least slack {1000.0 - float(torque_us.max()):.0f} us"


def _draw_timing(axes: Axes, table: Table) -> None:
    states_us, torque_us = np.asarray(table["states_us"]), np.asarray(table["torque_us"])
    # Most often the same to a few us: the wider below the narrower shows on both sides of it.
    axes.plot(table["t_s"], torque_us, color=COLOURS[1], lw=3.0, label="torque frame sent")
    axes.plot(table["t_s"], states_us, color=COLOURS[0], lw=0.8, label="states in, tick begins")
    late_us = 1e-3 * np.asarray(table["wake_late_ns"], dtype=np.float64)
    axes.plot(table["t_s"], late_us, color=COLOURS[6], lw=0.8, label="period began late by")
    missing = np.asarray(table["states_missing"]) > 0
    if missing.any():
        at = np.asarray(table["t_s"])[missing]
        axes.plot(at, np.zeros(len(at)), "|", color=MODE_COLOURS[6], ms=9, label="state missing")
    axes.axhline(1000.0, color="#999999", lw=0.8, ls=(0, (4, 3)))
    axes.annotate(
        f"next SYNC; {slack_text(table)}",
        (0.005, 1000.0), xycoords=("axes fraction", "data"), xytext=(0, -9), textcoords="offset points",
        color="#777777", fontsize=7.5,
    )  # fmt: skip
    axes.set_ylabel("after SYNC, us")
    axes.set_ylim(-60.0, max(1100.0, 1.05 * float(np.max(torque_us, initial=0.0))))
    legend_beside(axes)


def _stretches(values: npt.NDArray[Any]) -> list[tuple[int, int]]:
    """First and past-the-last index of every run of equal values."""
    edges = np.flatnonzero(np.diff(values)) + 1
    bounds = [0, *edges.tolist(), len(values)]
    return list(pairwise(bounds))


def _draw_state(axes: Axes, table: Table) -> None:
    """A band of modes, and below it one row for each limit or fault that ever was."""
    from matplotlib.patches import Patch

    t_s = np.asarray(table["t_s"], dtype=np.float64)
    end_s = np.r_[t_s[1:], t_s[-1] + 1e-3]
    mode = np.asarray(table["mode"]).astype(int)
    # Limited for a tick or two is drawn in the row of its limit; the band would only flicker.
    band = np.where(mode == lib.CR_MODE_LIMITED, int(lib.CR_MODE_RENDERING), mode)
    for first, last in _stretches(band):
        axes.axvspan(t_s[first], end_s[last - 1], 0.8, 1.0, color=MODE_COLOURS[band[first]], lw=0)
    rows: list[tuple[str, npt.NDArray[np.bool_], str]] = []
    for column, names, colour in (
        ("limits", limit_names, "#c98a00"),
        ("faults", fault_names, MODE_COLOURS[6]),
    ):
        bits = np.asarray(table[column]).astype(np.int64)
        found = [bit for bit in range(32) if (bits >> bit & 1).any()]
        rows += [(names(1 << bit)[0], (bits >> bit & 1) == 1, colour) for bit in found]
    height = 0.76 / max(len(rows), 3)
    for number, (_, on, colour) in enumerate(rows):
        top = 0.78 - number * height
        for first, last in _stretches(on):
            if on[first]:
                axes.axvspan(
                    t_s[first], end_s[last - 1], top - 0.8 * height, top, color=colour, lw=0.6
                )
    axes.set_ylim(0.0, 1.0)
    axes.set_yticks([0.9, *(0.78 - (n + 0.4) * height for n in range(len(rows)))])
    axes.set_yticklabels(["mode", *(name for name, *_ in rows)], fontsize=7.5)
    axes.grid(visible=False)
    seen = sorted(set(band.tolist()))
    legend_beside(axes, [Patch(color=MODE_COLOURS[m], label=mode_names()[m]) for m in seen])
