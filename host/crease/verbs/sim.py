"""`crease sim`: three drives with mechanism and operator behind them, on a bus."""

from __future__ import annotations

import argparse
import signal
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from crease.base.errors import BusError, UsageError
from crease.base.table import column_names, describe, read_table
from crease.bus.drives import (
    F64,
    FAULT_KINDS,
    VALUES,
    Drives,
    Fault,
    Mech,
    Params,
    Wrist,
    WristParams,
    fault_out_of_range,
)
from crease.replay.trajectory import COLUMNS, load_trajectory, place_of_row, stack_columns
from crease.verbs.common import SubParsers, add_json, number, print_either, warn

PATH_COLUMNS = ("t_s", "x_m", "y_m", "z_m")
WRIST_COLUMNS = ("yaw_rad", "pitch_rad", "roll_rad")


def add_parser(sub: SubParsers) -> None:
    """The command line of the verb."""
    from crease.bus.transport import add_bus_options

    parser = sub.add_parser(
        "sim",
        help="simulated drives, mechanism and operator on a bus",
        description="Three CiA 402 drives with the device and its operator behind them. A SYNC moves the device by one "
        "period. Stop with Ctrl-C.",
    )
    add_bus_options(parser)
    parser.add_argument(
        "--wall-clock",
        action="store_true",
        help="the device moves with the clock, not with the SYNC",
    )
    parser.add_argument(
        "--seconds", metavar="S", type=number(0.001, 1e6), help="stop after this time"
    )
    parser.add_argument(
        "--operator",
        metavar="PATH.csv",
        type=Path,
        help="a path of the tool, t_s,x_m,y_m,z_m,qw,qx,qy,qz, in the world, as for `crease hil`: the hand goes to its "
        "first pose in 0.6 s, rests 0.4 s and leads it along, by the arm of the default device; or without qw..qz "
        "targets of the tip in the frame of the device's base, as they are, perhaps with yaw_rad,pitch_rad,roll_rad. "
        "Starts with the drives enabled",
    )
    parser.add_argument(
        "--device",
        metavar="SIM.toml",
        type=Path,
        help="parameters that differ from the default device",
    )
    parser.add_argument(
        "--fault",
        metavar="KIND:tick=N,...",
        action="append",
        default=[],
        help=f"{', '.join(FAULT_KINDS)}; with tick, ticks, axis (X, Y, Z), id, to (drives, host), value; "
        f"{', '.join(_OF_FRAMES[:-1])} and {_OF_FRAMES[-1]} need id, such as id=0x191 (`crease bus --schedule`); "
        f"{', '.join(list(_BY_VALUE)[:-1])} and {list(_BY_VALUE)[-1]} need value; "
        "repeatable",
    )
    add_json(parser)
    parser.set_defaults(run=run)


_OF_PASSING = ("drop", "delay", "duplicate", "reorder", "corrupt")
"""Faults of frames on their way, to the drives or to the host."""

_OF_FRAMES = (*_OF_PASSING, "babble")
"""Faults of the frames with one identifier, which has no usual value."""

_BY_VALUE = {"delay": -1, "corrupt": 0xFF, "babble": -1, "encoder_jump": -1}
"""Faults that are as large as their value says, and its bits that say so."""

_AT_ONCE = ("encoder_jump", "drive_reset", "drive_error")
"""Faults that come in one tick."""

_OF = {
    "id": _OF_FRAMES,
    "to": _OF_PASSING,
    "value": tuple(VALUES),
    "ticks": tuple(kind for kind in FAULT_KINDS if kind not in _AT_ONCE),
}
"""Parts of a fault that not every kind has, and the kinds that have them."""


def parse_fault(text: str) -> Fault:
    """`drop:tick=100,ticks=3,id=0x191,to=host` as a row of the fault table.   Errors: UsageError."""
    kind, _, rest = text.partition(":")
    values: dict[str, Any] = {}
    given: list[str] = []
    for part in filter(None, rest.split(",")):
        name, equals, value = part.partition("=")
        if name in given:
            raise UsageError(f"fault '{text}': {name} is given twice")
        given.append(name)
        try:
            if name == "axis" and value in ("X", "Y", "Z"):
                values["axis"] = "XYZ".index(value)
            elif name == "to" and value in ("drives", "host"):
                values["to_drives"] = value == "drives"
            elif name in ("tick", "ticks", "id", "value") and equals:
                values[name] = int(value, 0)
            else:
                raise ValueError(name)
        except ValueError as error:
            raise UsageError(
                f"fault '{text}': '{part}' is not understood; write KIND:tick=N,ticks=N,axis=X,id=0x191,to=host,value=N"
            ) from error
    if kind not in FAULT_KINDS or "tick" not in values:
        raise UsageError(
            f"fault '{text}': write KIND:tick=N with KIND one of {', '.join(FAULT_KINDS)}"
        )
    fault = Fault(kind=kind, **values)
    if wrong := fault_out_of_range(fault):
        raise UsageError(f"fault '{text}': {wrong}")
    if idle := [name for name in given if kind not in _OF.get(name, (kind,))]:
        raise UsageError(f"fault '{text}': {kind} has no {idle[0]}; leave it out")
    if kind in _OF_FRAMES and "id" not in given:
        raise UsageError(
            f"fault '{text}': {kind} needs id=, such as id=0x191: see `crease bus --schedule`"
        )
    if kind in _BY_VALUE and fault.value & _BY_VALUE[kind] == 0:
        what = VALUES[kind][2]
        raise UsageError(
            f"fault '{text}': {kind} by nothing is no fault; give value=, {what}, such as value=3"
        )
    return fault


def parse_faults(texts: Sequence[str]) -> list[Fault]:
    """All of a command line.   Errors: UsageError."""
    from crease._sim import lib

    if len(texts) > lib.CR_SIM_FAULTS_MAX:
        raise UsageError(f"--fault: {len(texts)} are too many; at most {lib.CR_SIM_FAULTS_MAX}")
    return [parse_fault(text) for text in texts]


def never_acted(texts: Sequence[str], ticks: int, injected: int) -> list[str]:
    """A warning for each fault that changed nothing in a run of so many ticks of SYNC, as far as that can be told."""
    late = [text for text in texts if parse_fault(text).tick > ticks]
    warnings = [f"--fault {text}: never came; the drives saw {ticks:,} SYNC" for text in late]
    if injected == 0:
        warnings += [
            f"--fault {text}: never acted; no frame or drive that it is about came in its ticks"
            for text in texts
            if text not in late
        ]
    return warnings


def load_device(path: Path | None) -> tuple[Params, WristParams]:
    """Parameters from a TOML file: keys of cr_sim_params, tables axes.X, axes.Y, axes.Z, and for a held tool a table
    wrist with keys of cr_sim_wrist_params.   Errors: BusError.
    """
    if path is None:
        return Params(), WristParams()
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except UnicodeDecodeError as error:
        raise BusError(f"{path}: is no text in UTF-8; save it as TOML in UTF-8") from error
    except (OSError, tomllib.TOMLDecodeError) as error:
        raise BusError(f"{path}: cannot be read: {describe(error)}") from error
    axes, wrist = values.pop("axes", {}), values.pop("wrist", {})
    if not isinstance(axes, dict) or not all(isinstance(axis, dict) for axis in axes.values()):
        raise BusError(f"{path}: axes must be tables: [axes.X] and so on")
    if not isinstance(wrist, dict):
        raise BusError(f"{path}: wrist must be a table: [wrist]")
    try:
        params, motors = Params(axes=axes, **values), WristParams(**wrist)
        if not _in_range(Mech, params):
            raise BusError(_out_of_range(values, axes))
        if not _in_range(Wrist, motors):
            raise BusError(_wrist_out_of_range(wrist))
    except BusError as error:
        raise BusError(f"{path}: {error}") from error
    return params, motors


def _in_range(make: Callable[[Any], object], params: Params | WristParams) -> bool:
    try:
        make(params)
    except BusError:
        return False
    return True


def _out_of_range(values: dict[str, Any], axes: dict[str, Any]) -> str:
    """Which of the parameters is out of range by itself, the others at their default; or that some are together."""
    where = "see cr_sim_params in sim/sim.h"
    for name, value in values.items():
        if not _in_range(Mech, Params(**{name: value})):
            return f"parameter {name}: {value!r} is out of range; {where}"
    for axis, changes in axes.items():
        for name, value in changes.items():
            if not _in_range(Mech, Params(axes={axis: {name: value}})):
                return f"parameter axes.{axis}.{name}: {value!r} is out of range; {where}"
    return f"the parameters do not go together; {where}"


def _wrist_out_of_range(values: dict[str, Any]) -> str:
    """The same of the wrist, each of whose parameters has a range of its own."""
    name = next(n for n, value in values.items() if not _in_range(Wrist, WristParams(**{n: value})))
    return f"parameter wrist.{name}: {values[name]!r} is out of range; see cr_sim_wrist_params in sim/sim.h"


def load_params(path: Path | None) -> Params:
    """The same without the wrist, which is not on the bus.   Errors: BusError."""
    return load_device(path)[0]


def load_path(path: Path, start_m: F64, period_s: float) -> F64:
    """Targets of the operator, one row a period: tip m, frame of the base, wrist rad; shape (n, 6).

    start_m: where the tip stands; a path of the tool in the world is led up to from there.
    Errors: TableError, TrajectoryError, BusError with file and line; LoopError for a pose that is out of reach.
    """
    known = column_names(path)
    if set(known) & set(COLUMNS[4:]):
        from crease.base.native import ffi, lib
        from crease.loop.hil import operator_way

        if both := [name for name in WRIST_COLUMNS if name in known]:
            raise BusError(
                f"{path}: has {both[0]} beside the quaternion; a path of the tool has qw..qz alone, targets of the tip "
                "the angles of the wrist"
            )
        config = ffi.new("cr_servo_config *", lib.cr_servo_config_default())
        return np.concatenate(operator_way(load_trajectory(path), config, start_m, period_s))
    given = (*PATH_COLUMNS, *(name for name in WRIST_COLUMNS if name in known))
    columns = read_table(path, given)
    rows = stack_columns(path, columns, given)
    times = rows[:, 0]
    finite = np.isfinite(rows)
    if not finite.all():
        row = int(np.argmin(finite.all(axis=1)))
        name = given[int(np.argmin(finite[row]))]
        raise BusError(
            f"{place_of_row(path, row)}: {name} is {columns[name][row]}, not a finite number"
        )
    if (shrinks := np.diff(times) <= 0.0).any():
        row = int(np.argmax(shrinks)) + 1
        raise BusError(
            f"{place_of_row(path, row)}: time does not increase: {times[row]:.9g} s after {times[row - 1]:.9g} s"
        )
    ticks = np.arange(times[0], times[-1] + 0.5 * period_s, period_s)
    zero = np.zeros(len(times))
    names = (*PATH_COLUMNS[1:], *WRIST_COLUMNS)
    return np.column_stack([np.interp(ticks, times, columns.get(name, zero)) for name in names])


def run(args: argparse.Namespace) -> None:
    """Errors: CreaseError for a bus that cannot be opened, or bad parameters, path or faults."""
    from crease.bus.transport import check_bitrate, now_us

    check_bitrate(args.bitrate)
    if args.interface == "inprocess":
        raise UsageError(
            "interface inprocess: lives inside one program and has its own drives; use socketcan or virtual"
        )
    params = load_params(args.device)
    drives = Drives(
        params,
        wall_clock=args.wall_clock,
        now_us=now_us(),
        faults=parse_faults(args.fault),
    )
    if args.operator is not None:
        drives.set_path(load_path(args.operator, drives.state.tip_pos_m, params.period_s))
    lost = _run_socketcan(args, drives) if args.interface == "socketcan" else _run_any(args, drives)
    counters = drives.counters
    warnings = never_acted(args.fault, counters.ticks, counters.faults_done)
    warn(warnings)
    report: dict[str, object] = {
        "ticks": counters.ticks,
        "frames_in": counters.frames_in,
        "frames_out": counters.frames_out,
        "frames_ignored": counters.frames_ignored,
        "frames_lost": counters.frames_dropped + lost,
        "faults_done": counters.faults_done,
        "states": [drives.drive(axis).state for axis in range(3)],
        "warnings": warnings,
    }
    print_either(
        args.json,
        report,
        [
            ("ticks", f"{counters.ticks:,}"),
            (
                "frames",
                f"{counters.frames_in:,} in, {counters.frames_out:,} out, {counters.frames_ignored:,} not for us",
            ),
            ("lost", f"{counters.frames_dropped + lost:,}"),
            ("injected", f"{counters.faults_done:,} faults"),
            ("drives", ", ".join(drives.drive(axis).state for axis in range(3))),
        ],
    )


def _run_socketcan(args: argparse.Namespace, drives: Drives) -> int:
    """In C, without the interpreter in the loop. Gives frames lost."""
    from crease._sim import ffi, lib
    from crease.bus.transport import check_channel

    check_channel(args.interface, args.channel)
    report = ffi.new("cr_sim_run_report *")
    duration_us = round(1e6 * args.seconds) if args.seconds else 0
    status = lib.cr_sim_run_socketcan(drives.c, args.channel.encode(), duration_us, report)
    if status != 0:
        import os

        what = {
            lib.CR_SIM_RUN_INTERFACE: "there is no such interface; see `ip link`",
            lib.CR_SIM_RUN_SOCKET: "no CAN socket; does this kernel have SocketCAN?",
        }.get(status, "the interface is gone")
        raise BusError(f"socketcan {args.channel}: {what} ({os.strerror(report.error_number)})")
    return int(report.dropped_rx + report.failed_tx)


def _run_any(args: argparse.Namespace, drives: Drives) -> int:
    """Through python-can."""
    from crease.bus.transport import one_line, open_bus, serve

    stopped: list[int] = []
    bus = open_bus(args.interface, args.channel, args.bitrate)
    main_thread = True
    try:
        before = [
            signal.signal(number, lambda n, _: stopped.append(n))
            for number in (signal.SIGINT, signal.SIGTERM)
        ]
    except ValueError:
        main_thread = False
    try:
        with one_line(bus):
            serve(bus, drives, lambda: bool(stopped), args.seconds)
    finally:
        if main_thread:
            for number_, handler in zip((signal.SIGINT, signal.SIGTERM), before, strict=True):
                signal.signal(number_, handler)
        bus.shutdown()
    return 0
