"""Every fault of the simulated bus, injected at every n-th tick of a contact: what the firmware does, as a table.

    python tests/bench/faults.py SCENE.crs PATH.csv [--every 50] [--seconds 2]

Checked in every run: no torque word beyond its limit; once in fault, zero torque from the very tick on and
until the end; the recording re-runs to the bit.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from crease.bus.drives import Fault
from crease.hil import InProcess, hand_targets, lead_in, resample
from crease.native import ffi, lib
from crease.recording import fault_names, limit_names, rerun
from crease.scene import open_scene
from crease.trajectory import load_trajectory

AFTER_TICKS = 60
"""A run goes on for so long after its fault."""

KINDS: dict[str, dict[str, object]] = {
    "drop a state": {"kind": "drop", "id": 0x192},
    "drop 3 states": {"kind": "drop", "id": 0x192, "ticks": 3},
    "drop a torque": {"kind": "drop", "id": 0x181, "to_drives": True},
    "delay a state by 1 tick": {"kind": "delay", "id": 0x193, "value": 1},
    "duplicate a state": {"kind": "duplicate", "id": 0x191},
    "reorder a state": {"kind": "reorder", "id": 0x191},
    "corrupt a position": {"kind": "corrupt", "id": 0x192, "value": 0x0140},
    "corrupt a status word": {"kind": "corrupt", "id": 0x192, "value": 0x0604},
    "babble": {"kind": "babble", "axis": 1, "id": 0x692, "value": 20, "ticks": 20},
    "silent drive": {"kind": "silent", "axis": 2, "ticks": 60},
    "encoder jump": {"kind": "encoder_jump", "axis": 1, "value": 200},
    "encoder stuck": {"kind": "encoder_stuck", "axis": 2, "ticks": 60},
    "drive reset": {"kind": "drive_reset", "axis": 0},
    "bus-off of a drive": {"kind": "bus_off", "axis": 0, "ticks": 60},
    "drive error 0x2310": {"kind": "drive_error", "axis": 1, "value": 0x2310},
}


@dataclass
class Outcome:
    """What one kind led to, over all its runs."""

    runs: int = 0
    faulted: int = 0
    names: Counter[str] = field(default_factory=Counter)
    limits: Counter[str] = field(default_factory=Counter)
    ticks_to_zero: int = 0
    wrong: int = 0


def one_run(
    scene: object, targets: np.ndarray, at: int, what: dict[str, object], out: Outcome
) -> None:
    """A run with one fault `at` ticks into the contact."""
    loop = InProcess(scene)  # type: ignore[arg-type]
    loop.bring_up(lead_in(targets, loop.drives.state.tip_pos_m))
    loop.command(int(lib.CR_COMMAND_START))
    first = loop.drives.counters.ticks + 1 + at
    loop.drives.set_faults([Fault(tick=first, **what)])  # type: ignore[arg-type]
    start = len(loop.rows)
    for k in range(at + AFTER_TICKS):
        loop.tick(targets[min(k, len(targets) - 1)].tolist())
    result = loop.result(start)
    rows = result.recording.rows[start:]
    most = np.array([2000, 2500, 2500])
    faulted = np.flatnonzero(rows["faults"])
    out.runs += 1
    bad = bool((np.abs(rows["target"]) > most).any() or not np.isfinite(rows["torque"]).all())
    if len(faulted):
        out.faulted += 1
        out.names.update(fault_names(int(rows["faults"][faulted[0]])))
        out.ticks_to_zero = max(out.ticks_to_zero, int(faulted[0]) - at + 1)
        bad |= bool((rows["target"][faulted[0] :] != 0).any() or faulted[0] < at)
    out.limits.update(limit_names(int(np.bitwise_or.reduce(rows["limits"][at:]))))
    bad |= rerun(result.recording, scene).different != 0  # type: ignore[arg-type]
    out.wrong += bad


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", type=Path)
    parser.add_argument("path", type=Path)
    parser.add_argument("--every", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=2.0)
    args = parser.parse_args()
    scene = open_scene(args.scene)
    config = ffi.new("cr_servo_config *", lib.cr_servo_config_default())
    targets = hand_targets(resample(load_trajectory(args.path)), config)
    wrong = 0
    print(
        f"| {'injected':24s} | runs | faults | tick of zero torque | fault | limits meanwhile | wrong |"
    )
    print("|---|---|---|---|---|---|---|")
    for name, what in KINDS.items():
        out = Outcome()
        for at in range(args.every, round(1000 * args.seconds) + 1, args.every):
            one_run(scene, targets, at, what, out)
        zero = str(out.ticks_to_zero) if out.faulted else "-"
        print(
            f"| {name:24s} | {out.runs} | {out.faulted} | {zero} | {', '.join(sorted(out.names)) or '-'} "
            f"| {', '.join(sorted(out.limits)) or '-'} | {out.wrong} |",
            flush=True,
        )
        wrong += out.wrong
    return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
