"""Every fault of the bus, injected at every n-th tick of a contact: what the firmware does, as a table.

    python tests/bench/faults.py build/scenes/wall_cube.crs [--every 50] [--seconds 2] [--json OUT]

A hand presses a cube on a wall and slides it, 1 to 6 N. At each injection the run forks: each kind of fault gets a copy
of the loop as it is in that tick. Status 1 when one run breaks its rule:

- torque reduced, and zero, within the ticks that the rule gives (1: in the tick of the fault itself);
- no torque word beyond its limit, no number that is not finite, zero from the fault on, at the drives too;
- no way back but the command `clear`: `start` does nothing;
- the recording names the fault or counts the oddity, and runs again to the bit.
"""

from __future__ import annotations

import argparse
import json
import os
import pickle
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from crease.base.native import ffi, lib
from crease.base.scene import Scene, open_scene
from crease.bus.drives import Fault, Frame
from crease.loop.hil import Loop, lead_in
from crease.replay.recording import fault_names, limit_names, rerun

F64 = npt.NDArray[np.float64]

AFTER_TICKS = 120
"""A run goes on for so long after its fault."""
APPROACH_TICKS = 700
"""From the start of rendering until the contact is steady."""
WORD_LIMITS = (2000, 2500, 2500)
"""Peak of each drive, per mille of rated: sim/dictionary.h."""


@dataclass(frozen=True)
class Rule:
    """What has to happen. Ticks count from the injection, 1 is its own tick; None: nothing is asked.

    always: whether every run has to fault. counts: counters of which one has to rise when nothing else is told.
    """

    limit_by: int | None = None
    zero_by: int | None = None
    faults: tuple[str, ...] = ()
    always: bool = True
    counts: tuple[str, ...] = ()


@dataclass(frozen=True)
class Kind:
    """An injection: a row of the simulator's fault table, input bits of the port, or a frame of somebody else."""

    rule: Rule
    what: dict[str, Any] = field(default_factory=dict)
    after: int = AFTER_TICKS
    inputs: int = 0
    alien: Frame | None = None


def _kind(kind: str, rule: Rule, after: int = AFTER_TICKS, **what: Any) -> Kind:
    return Kind(rule, {"kind": kind, **what}, after)


# It shows when the torque on the joint swings, not before; see firmware/servo/SPEC.md.
STUCK, STUCK_TICKS = Rule(faults=("stuck",), always=False), 1000
GONE = Rule(limit_by=1, zero_by=3, faults=("silent",))
STATE_Y, STATE_Z, WRIST, TORQUE = 0x192, 0x193, 0x194, 0x181

KINDS: dict[str, Kind] = {
    "state lost": _kind("drop", Rule(limit_by=1, counts=("missing",)), id=STATE_Y),
    "state lost 3 times": _kind("drop", GONE, id=STATE_Y, ticks=3),
    "state 1 tick late": _kind("delay", Rule(limit_by=1, counts=("missing",)), id=STATE_Z, value=1),
    "state twice": _kind("duplicate", Rule(counts=("twice",)), id=STATE_Y),
    "state after the others": _kind("reorder", Rule(), id=0x191),
    "position corrupt": _kind("corrupt", Rule(1, 1, ("jump",)), id=STATE_Y, value=0x0140),
    "position corrupt, one count": _kind("corrupt", Rule(), id=STATE_Y, value=0x0001),
    "status word corrupt": _kind("corrupt", Rule(1, 1, ("drive-state",)), id=STATE_Y, value=0x0604),
    "wrist lost": _kind("drop", Rule(counts=("wrist_missing",)), id=WRIST, ticks=2),
    "wrist lost 3 times": _kind("drop", Rule(None, 7, ("silent",)), id=WRIST, ticks=6),
    "wrist corrupt": _kind("corrupt", Rule(None, 2, ("jump",)), id=WRIST, value=0x0140, ticks=2),
    "torque lost": _kind("drop", Rule(), id=TORQUE, to_drives=True),
    "torque lost 6 times": _kind(
        "drop", Rule(None, 6, ("drive", "drive-state", "emcy")), id=TORQUE, to_drives=True, ticks=6
    ),
    "torque 1 tick late": _kind("delay", Rule(), id=TORQUE, to_drives=True, value=1),
    "torque corrupt": _kind("corrupt", Rule(), id=TORQUE, to_drives=True, value=0x0304),
    # Three of its frames fit into the first period, and so many a drive may send.
    "babbling drive": _kind(
        "babble", Rule(2, 2, ("babble",)), axis=1, id=0x692, value=20, ticks=20
    ),
    "silent drive": _kind("silent", GONE, axis=2, ticks=60),
    "encoder jump": _kind("encoder_jump", Rule(1, 1, ("jump",)), axis=1, value=200),
    "encoder X stuck": _kind("encoder_stuck", STUCK, STUCK_TICKS, axis=0, ticks=STUCK_TICKS),
    "encoder Y stuck": _kind("encoder_stuck", STUCK, STUCK_TICKS, axis=1, ticks=STUCK_TICKS),
    "encoder Z stuck": _kind("encoder_stuck", STUCK, STUCK_TICKS, axis=2, ticks=STUCK_TICKS),
    "drive reset": _kind("drive_reset", Rule(1, 1, ("reset", "drive-state")), axis=0),
    "bus-off of a drive": _kind("bus_off", GONE, axis=0, ticks=60),
    "bus-off of the host": Kind(Rule(1, 1, ("bus-off",)), inputs=int(lib.CR_INPUT_BUS_OFF)),
    "frame not sent": Kind(Rule(1, 1, ("bus-off",)), inputs=int(lib.CR_INPUT_SEND_FAILED)),
    "drive error 0x2310": _kind("drive_error", Rule(1, 1, ("drive", "emcy")), axis=1, value=0x2310),
    "second host": Kind(Rule(1, 1, ("alien",)), alien=Frame(TORQUE, bytes(6))),
}


@dataclass
class Outcome:
    """What one kind led to, over all its runs. Ticks: the longest; 0 when it never came to that."""

    runs: int = 0
    faulted: int = 0
    limited: int = 0
    limit_ticks: int = 0
    zero_ticks: int = 0
    bad_frames: int = 0
    recovered: int = 0
    names: Counter[str] = field(default_factory=Counter)
    limits: Counter[str] = field(default_factory=Counter)
    counts: Counter[str] = field(default_factory=Counter)
    wrong: Counter[str] = field(default_factory=Counter)

    def add(self, run: Outcome) -> None:
        """Take in one run."""
        for name in ("runs", "faulted", "limited", "bad_frames", "recovered"):
            setattr(self, name, getattr(self, name) + getattr(run, name))
        self.limit_ticks = max(self.limit_ticks, run.limit_ticks)
        self.zero_ticks = max(self.zero_ticks, run.zero_ticks)
        for name in ("names", "limits", "counts", "wrong"):
            getattr(self, name).update(getattr(run, name))


def hand(tick: int) -> list[float]:
    """Target of the tip (m, base) and wrist (rad): from above the wall into it, then pressing and sliding."""
    t_s = tick * 1e-3
    depth_m = min(0.020, 0.030 * t_s) + 0.012 * np.sin(2 * np.pi * t_s) * min(1.0, t_s)
    x_m = -0.04 + 0.015 * np.sin(2 * np.pi * 0.7 * t_s)
    y_m = np.sqrt(2.0) * 0.45 - 0.02 + 0.010 * np.sin(2 * np.pi * 0.4 * t_s)
    return [x_m, y_m, 0.034 - depth_m, 0.02 * np.sin(2 * np.pi * 0.5 * t_s), 0.0, 0.0]


class Watch:
    """Looks at every frame of the host: torque words within the limits, and zero once told so."""

    def __init__(self) -> None:
        self.bad = 0
        self.zero = False

    def __call__(self, _: float, frame: Frame) -> None:
        """One frame on the bus."""
        if frame.id != TORQUE:
            return
        words = [int.from_bytes(frame.data[i : i + 2], "little", signed=True) for i in (0, 2, 4)]
        within = all(abs(w) <= most for w, most in zip(words, WORD_LIMITS, strict=True))
        self.bad += len(frame.data) != 6 or not within or (self.zero and any(words))


def inject(loop: Loop, kind: Kind) -> None:
    """For the next tick."""
    if kind.what:
        loop.drives.set_faults([Fault(tick=loop.drives.counters.ticks + 1, **kind.what)])
    if kind.inputs:
        loop.command(kind.inputs)
    if kind.alien is not None:
        frame = ffi.new("cr_frame *", {"id": kind.alien.id, "size": len(kind.alien.data)})
        lib.cr_servo_rx(loop.servo.c, frame)


def judge(kind: Kind, run: Outcome, rows: npt.NDArray[Any], before: npt.NDArray[Any]) -> None:
    """Hold what was recorded since the injection against the rule."""
    rule = kind.rule
    faulted, limited = (
        np.flatnonzero(rows["faults"]),
        np.flatnonzero(rows["limits"] & lib.CR_LIMIT_STALE),
    )
    run.limited = int(len(limited) > 0)
    for name in rows["counters"].dtype.names or ():
        if name in ("ticks_rendering", "ticks_limited", "limits", "faults"):
            continue
        run.counts[name] += int((rows["counters"][name][-1] != before["counters"][name]).any())
    run.counts = +run.counts
    if len(limited):
        run.limit_ticks = int(limited[0]) + 1
        run.limits.update(limit_names(int(lib.CR_LIMIT_STALE)))
    if len(faulted):
        run.faulted, run.zero_ticks = 1, int(faulted[0]) + 1
        names = fault_names(int(rows["faults"][faulted[0]]))
        run.names.update(names)
        run.wrong["another fault"] += not set(names) & set(rule.faults)
        run.wrong["torque after the fault"] += bool((rows["target"][faulted[0] :] != 0).any())
    reduced = min([n for n in (run.limit_ticks, run.zero_ticks) if n], default=0)
    must_fault = bool(rule.faults) and rule.always
    run.wrong["no fault"] += must_fault and not run.faulted
    run.wrong["zero too late"] += rule.zero_by is not None and run.zero_ticks > rule.zero_by
    run.wrong["reduced too late"] += rule.limit_by is not None and not 0 < reduced <= rule.limit_by
    run.wrong["not recorded"] += bool(rule.counts) and not any(
        run.counts[name] for name in rule.counts
    )
    run.wrong["not finite"] += not all(
        np.isfinite(rows[name]).all() for name in ("torque", "force_N", "energy_J", "velocity_m_s")
    )


def one_run(loop: Loop, scene: Scene, kind: Kind, tick: int, recover: bool) -> Outcome:
    """What follows one injection, in a copy of the loop."""
    run, watch, start = Outcome(runs=1), Watch(), loop.ticks
    before = loop.result(0).recording.rows[-1]
    loop.on_frame = watch
    inject(loop, kind)
    for k in range(kind.after):
        loop.tick(hand(tick + k))
        watch.zero = loop.mode == lib.CR_MODE_FAULT
    judge(kind, run, loop.result(start).recording.rows[start:], before)
    run.wrong["recording does not run again"] += rerun(
        loop.result(start).recording, scene
    ).different
    if run.faulted:
        for _ in range(20):
            loop.command(int(lib.CR_COMMAND_START))
            loop.tick(hand(tick + kind.after))
            run.wrong["came back by itself"] += loop.mode != lib.CR_MODE_FAULT
        demand = [loop.drives.drive(axis).torque_permille for axis in range(3)]
        run.wrong["torque at a drive"] += any(demand)
        if recover:
            run.recovered = comes_back(loop)
            run.wrong["does not come back on clear"] += not run.recovered
    run.bad_frames = watch.bad
    run.wrong["bad frame"] += watch.bad
    run.wrong = +run.wrong
    return run


def comes_back(loop: Loop) -> int:
    """1 when `clear`, then `start` render again, the fault being over and the hand away from the wall."""
    loop.on_frame = None
    loop.drives.set_faults([])
    loop.command(int(lib.CR_COMMAND_CLEAR))
    away = np.array(hand(0))
    for _ in range(3000):
        loop.tick(away.tolist())
        if loop.mode in (lib.CR_MODE_IDLE, lib.CR_MODE_FAULT):
            break
    loop.command(int(lib.CR_COMMAND_START))
    loop.tick(away.tolist())
    return int(loop.mode in (lib.CR_MODE_RENDERING, lib.CR_MODE_LIMITED))


def in_a_copy(work: Callable[[], Outcome]) -> Outcome:
    """Run `work` in a fork of this process: the loop here stays as it is."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        status = 1
        try:
            os.close(read)
            with os.fdopen(write, "wb") as pipe:
                pickle.dump(work(), pipe)
            status = 0
        finally:
            os._exit(status)
    os.close(write)
    with os.fdopen(read, "rb") as pipe:
        data = pipe.read()
    _, status = os.waitpid(child, 0)
    if status != 0:
        raise RuntimeError(f"a run ended with status {status}")
    outcome: Outcome = pickle.loads(data)
    return outcome


def injections(scene: Scene, every: int, seconds: float) -> Iterator[tuple[Loop, int, bool]]:
    """The loop in contact before every n-th tick, the tick, and whether it is the first."""
    loop = Loop(scene)
    first = np.array([hand(0)])
    loop.bring_up(lead_in(first, loop.drives.state.tip_pos_m))
    loop.command(int(lib.CR_COMMAND_START))
    for tick in range(APPROACH_TICKS):
        loop.tick(hand(tick))
    for tick in range(round(1000 * seconds)):
        at = APPROACH_TICKS + tick
        if tick % every == 0:
            record = lib.cr_servo_get_record(loop.servo.c)
            assert record.area_count > 0, f"tick {at} is not in contact"
            assert record.faults == 0
            yield loop, at, tick == 0
        loop.tick(hand(at))


def table(scene: Scene, every: int, seconds: float) -> dict[str, Outcome]:
    """Every kind at every injection."""
    outcomes = {name: Outcome() for name in KINDS}
    for loop, at, recover in injections(scene, every, seconds):
        for name, kind in KINDS.items():

            def work(kind: Kind = kind, at: int = at, recover: bool = recover) -> Outcome:
                return one_run(loop, scene, kind, at, recover)  # noqa: B023

            outcomes[name].add(in_a_copy(work))
    return outcomes


def row(name: str, out: Outcome) -> str:
    """One line of the table."""
    told = [*sorted(out.names), *(f"limit {n}" for n in sorted(out.limits))]
    told += [f"{n} counted" for n in sorted(out.counts) if n not in ("missing",) or not out.limits]
    outcome = "tolerated"
    if out.faulted:
        outcome = "fault" if out.faulted == out.runs else f"fault in {out.faulted}"
    elif out.limited:
        outcome = "limited"
    cells = [
        name, str(out.runs), outcome, str(out.limit_ticks or "-"), str(out.zero_ticks or "-"),
        str(out.bad_frames), "on clear" if out.recovered else "-", ", ".join(told) or "-",
    ]  # fmt: skip
    return f"| {' | '.join(cells)} |"


HEAD = "| injected | runs | outcome | reduced in tick | zero in tick | bad frames | back | the record says |"


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("scene", type=Path)
    parser.add_argument("--every", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--json", metavar="OUT", type=Path)
    args = parser.parse_args()
    outcomes = table(open_scene(args.scene), args.every, args.seconds)
    print(HEAD)
    print("|---|---|---|---|---|---|---|---|")
    for name, out in outcomes.items():
        print(row(name, out))
    wrong = {name: dict(out.wrong) for name, out in outcomes.items() if out.wrong}
    for name, what in wrong.items():
        print(f"WRONG {name}: {', '.join(f'{n} x {text}' for text, n in what.items())}")
    runs = sum(out.runs for out in outcomes.values())
    print(f"\n{runs} runs, {sum(sum(w.values()) for w in wrong.values())} broken rules")
    if args.json:
        text = json.dumps({name: vars(out) for name, out in outcomes.items()}, indent=2)
        args.json.write_text(text + "\n", encoding="utf-8")
    return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
