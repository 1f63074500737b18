"""`crease bus`: what is going on on the motor bus; its files; its schedule."""

from __future__ import annotations

import argparse
import contextlib
import itertools
import re
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from crease.base.ending import raising
from crease.base.errors import BusError, UsageError
from crease.verbs.common import SubParsers, add_force, add_json, number, print_json, warn

if TYPE_CHECKING:
    import can

    from crease.bus.monitor import Monitor

LOG_SUFFIXES = (".log", ".asc", ".blf")
"""Formats of python-can that give back what was put in: .trc loses error frames, .db loses frames."""
_REDRAW_S = 0.2


def add_parser(sub: SubParsers) -> None:
    """The command line of the verb."""
    parser = sub.add_parser(
        "bus",
        help="watch the motor bus; its EDS, DBC and schedule",
        description="A live table of the frames on the bus, decoded; or the files and the timing that belong to it.",
    )
    parser.add_argument(
        "-i", "--interface", metavar="NAME", help="of python-can: socketcan, virtual, slcan, ..."
    )
    parser.add_argument("-c", "--channel", metavar="NAME", help="such as vcan0")
    parser.add_argument(
        "-b", "--bitrate", metavar="BIT/S", type=int, help="for interfaces that set it: 1000000"
    )
    parser.add_argument(
        "--read", metavar="LOG", type=Path, help="a log instead of a bus: .log, .asc, .blf"
    )
    parser.add_argument(
        "-o", "--log", metavar="LOG", type=Path, help="keep every frame: .log (candump), .asc, .blf"
    )
    parser.add_argument(
        "--seconds", metavar="S", type=number(0.001, 1e6), help="stop after this time"
    )
    parser.add_argument(
        "--export",
        metavar="DIR",
        type=Path,
        help="write the EDS of every drive and the DBC of the bus",
    )
    parser.add_argument(
        "--schedule", action="store_true", help="worst-case response times of every frame"
    )
    add_json(parser)
    add_force(parser)
    parser.set_defaults(run=run)


_WATCHED = (
    ("-i", "interface"),
    ("-c", "channel"),
    ("-b", "bitrate"),
    ("-o", "log"),
    ("--seconds", "seconds"),
)
"""Options of a bus that is watched."""


def _check_alone(args: argparse.Namespace) -> None:
    """Errors: UsageError for options that do not go together."""
    asked = [name for name in ("export", "schedule", "read") if getattr(args, name)]
    if len(asked) > 1:
        raise UsageError(f"{' and '.join(f'--{name}' for name in asked)}: give one of them")
    for option, name in _WATCHED if asked else ():
        if getattr(args, name) is not None:
            raise UsageError(
                f"{option} is of a bus that is watched; leave it out with --{asked[0]}"
            )


def run(args: argparse.Namespace) -> None:
    """Errors: CreaseError for a bus that cannot be opened, a log that cannot be read or written, options that do not
    go together.
    """
    _check_alone(args)
    if args.export is not None:
        _export(args)
    elif args.schedule:
        _schedule(args)
    elif args.read is not None:
        _read(args)
    else:
        _watch(args)


def _export(args: argparse.Namespace) -> None:
    from crease.bus.generate import export

    files = export(args.export, args.force)
    if args.json:
        print_json({"files": [str(path) for path in files]})
    else:
        print("\n".join(str(path) for path in files))


def _schedule(args: argparse.Namespace) -> None:
    from crease.bus import schedule
    from crease.bus.dictionary import load

    dictionary = load()
    layouts = schedule.layouts(dictionary)
    ours = layouts["this one"]
    error_us = float(dictionary.schedule["error_interval_us"])
    found = schedule.analyse(ours)
    struck = schedule.analyse(ours, error_interval_us=error_us)
    rows: list[dict[str, Any]] = [
        {
            "layout": name,
            "load_cyclic": schedule.load(items, cyclic_only=True),
            "load": schedule.load(items),
            "last_cyclic_us": schedule.worst_cyclic_us(items),
            "feasible": schedule.feasible(items),
            "feasible_with_errors": schedule.feasible(items, error_us),
            "highest_rate_Hz": schedule.highest_rate_Hz(items),
        }
        for name, items in layouts.items()
    ]
    cycle, six = schedule.cycle(dictionary), schedule.six_cycle(dictionary)
    if args.json:
        messages = [
            vars(r) | {"with_error_us": e.response_us} for r, e in zip(found, struck, strict=True)
        ]
        print_json(
            {"messages": messages, "layouts": rows, "cycle": vars(cycle), "cycle_six": vars(six)}
        )
        return
    print("COB-ID  frame           bits   period us  response us  with one bus error per 10 ms")
    for one, worse in zip(found, struck, strict=True):
        print(
            f"0x{one.cob:03X}   {one.name:14s} {one.cost_us:5.0f} {one.period_us:11,.0f} {_us(one.response_us):>12s}"
            f"  {_us(worse.response_us):>12s}{'' if worse.feasible else '  too late'}"
        )
    print(
        f"\nwhile torque flows: the states are there {cycle.states_us:.0f} us after SYNC, at the latest after"
        f" {cycle.answers_us:.0f} us; deadline {cycle.deadline_us:.0f} us;\nthe computation may take"
        f" {cycle.budget_us:.0f} us, with no heartbeat in the way {cycle.budget_quiet_us:.0f} us\n"
        f"six axes on CAN FD: {six.states_us:.0f} us, at the latest {six.answers_us:.0f}; deadline"
        f" {six.deadline_us:.0f}; computation {six.budget_us:.0f}, {six.budget_quiet_us:.0f} us\n"
    )
    print(f"{'layout':26s} {'load cyclic/all':>16s} {'last cyclic':>12s}  feasible  up to")
    for row in rows:
        fits = "yes" if row["feasible"] else "no"
        last = _us(row["last_cyclic_us"]) + (" us" if row["last_cyclic_us"] else "")
        print(
            f"{row['layout']:26s} {100 * row['load_cyclic']:8.1f}/{100 * row['load']:.1f} %"
            f" {last:>12s}  {fits:8s}  {row['highest_rate_Hz']} Hz"
        )


def _us(value: float | None) -> str:
    return "no bound" if value is None else f"{value:,.0f}"


def _read(args: argparse.Namespace) -> None:
    import can

    from crease.bus.dictionary import load
    from crease.bus.monitor import Monitor

    _check_suffix(args.read)
    if not args.read.is_file():
        raise BusError(f"{args.read}: there is no such file")
    monitor = Monitor(load())
    whole = _check_candump(args.read) if args.read.suffix.lower() == ".log" else None
    try:
        for message in itertools.islice(can.LogReader(args.read), whole):
            monitor.feed(message)
    except Exception as error:  # every reader of python-can raises its own kinds
        raise BusError(f"{args.read}: cannot be read: {' '.join(str(error).split())}") from error
    if not monitor.rows and monitor.errors == 0:
        raise BusError(
            f"{args.read}: holds no whole frame; record it with `candump -L` or `crease bus -o`"
        )
    _show(args, monitor)


_CANDUMP = re.compile(rb"\s*\([\d.]+\)\s+\S+\s+[0-9A-Fa-f]+#\S*(\s+[RT])?\s*")


def _check_candump(path: Path) -> int:
    """How many frames there are; a last line that does not end is left out, with a warning.

    Errors: BusError naming the first line that candump would not write.
    """
    count = 0
    with path.open("rb") as file:
        for number, line in enumerate(file, start=1):
            if not line.strip():
                continue
            if not line.endswith(b"\n"):
                warn([f"{path}: line {number}, the last, does not end: it is cut off and left out"])
                break
            count += 1
            if not _CANDUMP.fullmatch(line):
                raise BusError(
                    f"{path}: line {number} is no candump line, (TIME) CHANNEL ID#DATA; record it with `candump -L` or "
                    "`crease bus -o`"
                )
    return count


def _check_suffix(path: Path) -> None:
    if path.suffix.lower() not in LOG_SUFFIXES:
        raise BusError(
            f"{path}: the suffix is not one of {', '.join(LOG_SUFFIXES)}; other formats lose frames"
        )


def _show(args: argparse.Namespace, monitor: Monitor) -> None:
    if args.json:
        print_json(monitor.report())
    else:
        print("\n".join(monitor.lines()))


def _watch(args: argparse.Namespace) -> None:
    import can

    from crease.base.table import check_target, refusals
    from crease.bus.dictionary import load
    from crease.bus.monitor import Monitor
    from crease.bus.transport import one_line, open_bus

    if args.interface is None or args.channel is None:
        raise UsageError("nothing to watch; give -i and -c, or --read, --export, --schedule")
    if args.log is not None:
        _check_suffix(args.log)
        check_target(args.log, args.force, stream=True)
    monitor = Monitor(load())
    with contextlib.ExitStack() as stack:
        bus = stack.enter_context(open_bus(args.interface, args.channel, args.bitrate))
        listeners: list[Callable[[can.Message], None]] = []
        if args.log is not None:
            with refusals(args.log):
                log = can.Logger(args.log)
            stack.callback(_in_words(args.log, log.stop))
            listeners.append(_in_words(args.log, log.on_message_received))
        with raising(), contextlib.suppress(KeyboardInterrupt), one_line(bus):
            _listen(bus, monitor, listeners, args.seconds, sys.stdout.isatty() and not args.json)
    _show(args, monitor)


def _in_words(log: Path, write: Callable[..., None]) -> Callable[..., None]:
    """`write`, whose refusals by the disk are told of the file `log`."""
    from crease.base.table import refusals

    def written(*given: Any) -> None:
        with refusals(log):
            write(*given)

    return written


def _listen(
    bus: can.BusABC,
    monitor: Monitor,
    listeners: list[Callable[[can.Message], None]],
    seconds: float | None,
    live: bool,
) -> None:
    from crease.bus.transport import kernel_drops

    end_s = None if seconds is None else time.monotonic() + seconds
    drawn_s = time.monotonic()
    try:
        while end_s is None or time.monotonic() < end_s:
            message = bus.recv(timeout=0.05)
            if message is not None:
                monitor.feed(message)
                for listener in listeners:
                    listener(message)
            if live and time.monotonic() - drawn_s > _REDRAW_S:
                monitor.drops = kernel_drops(bus)
                print("\x1b[H\x1b[2J" + "\n".join(monitor.lines()), flush=True)
                drawn_s = time.monotonic()
    finally:
        monitor.drops = kernel_drops(bus)
