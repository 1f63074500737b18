"""`make hil-m7`: an emulated Cortex-M7 runs the whole servo loop over a real SocketCAN interface.

    python tests/hil/m7.py

Inside User-Mode Linux, in virtual time: QEMU runs controller.c on its mps2-an500; the board's UART speaks slcan and is
a CAN interface of the kernel; `crease sim` is at the other end of it. The board brings the drives up, renders a corner,
loses a drive, is cleared by the script that stands for its operator, and renders again, until its interrupt is held up:
once, then three times in a row. Then its records run again on this machine: the same to the bit.

An instruction takes the time that it has at 480 MHz, the clock's interrupt comes in the middle of the search.

Prints one line for each thing that has to hold. Status 1 when one does not.
"""

from __future__ import annotations

import argparse
import fcntl
import json
import os
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import can
import numpy as np
import numpy.typing as npt
from crease.base.native import ffi, lib
from crease.base.scene import Scene, open_scene
from crease.loop.hil import hand_targets, lead_in, write_targets
from crease.replay.recording import RECORD, Recording, fault_names, load_recording, rerun
from crease.replay.trajectory import check_rows, load_trajectory
from hil_tools import ROOT, wait_for

VCAN_RUN = ROOT / "tests" / "hil" / "lab" / "vcan-run"
ELF = ROOT / "build" / "m7" / "loop.elf"
SCENE = ROOT / "build" / "scenes" / "corner3_sphere.crs"
PATH = ROOT / "build" / "meshes" / "corner3_sphere.csv"
WORK = ROOT / "build" / "hil-m7"
RECORD_FILE = "m7.crr"
OPERATOR_FILE = "operator.csv"
ENDED = "the loop has ended"
"""What an500.c says in the end, with the most bytes of stack it used; RECORD_FILE is its recording."""
SHIFT = 3
"""An instruction takes 2^3 ns of the emulator: one cycle of 480 MHz of the device, whose time is 3.84 times as slow."""

LINE_DISCIPLINE_SLCAN = 17
SIOCGIFNAME = 0x8910
LIMIT_S = 300

PERIOD_US, DEADLINE_US, OFF_MAX_US = 1000.0, 700.0, 10.0
"""controller.c; the interrupt waits for no more than a few instructions."""
STACK_BYTES = 8192
"""Of an STM32H743: sections.ld."""

REST_TICKS, LEAD_TICKS = 60, 100
"""The hand rests until the drives are calibrated, then leads the tool from inside the corner to the first row."""
ROWS = slice(500, 761, 2)
"""Of the golden path: along the edge of two walls back to the corner of three; twice as fast."""
SILENT = "silent:tick=1385,ticks=20,axis=Y"
"""The fault: drive Y says nothing for 20 ticks, the tool in contact. Counted from the first SYNC."""
SILENT_AXIS = 1
TICKS_MIN, FORCE_MIN_N = 80, 0.1
"""Of rendering in contact, before the fault and after it; a smaller force is none."""
CORNER_SHARE = 0.5
"""Of the force, against each of the corner's three faces: 0.577 when all push alike, 0 when one does not."""


@dataclass(frozen=True)
class Outcome:
    """One thing that has to hold, and what was found."""

    holds: bool
    text: str


# ----------------------------------------------------------------------------------------------------------- the run


def operator_path(folder: Path) -> None:
    """What the hand does, for `crease sim --operator`."""
    golden = load_trajectory(PATH)
    rows = golden.rows[ROWS].copy()
    rows[:, 0] = np.arange(len(rows)) * 1e-3
    config = ffi.new("cr_servo_config *", lib.cr_servo_config_default())
    targets = hand_targets(check_rows(rows, golden.source), config)
    start_m = np.array([0.0, float(np.sqrt(2.0)) * float(config.arm.upper_m), 0.0])
    rest = np.tile(np.r_[start_m, np.zeros(3)], (REST_TICKS, 1))
    lead = lead_in(targets, start_m, LEAD_TICKS, 1)
    write_targets(folder / OPERATOR_FILE, np.concatenate([rest, lead, targets]))


def start_board(folder: Path, shift: int) -> tuple[subprocess.Popen[str], str]:
    """The emulator, and the terminal that is the board's UART."""
    words = ["qemu-system-arm", "-M", "mps2-an500", "-display", "none", "-nic", "none"]
    words += [
        "-monitor",
        "none",
        "-icount",
        f"shift={shift},sleep=on",
        "-serial",
        "pty",
        "-semihosting-config",
        "enable=on,target=native",
    ]
    words += ["-kernel", str(ELF), "-device", f"loader,file={SCENE},addr=0x60000000,force-raw=on"]
    board = subprocess.Popen(
        words,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=folder,
    )
    return board, next(word for word in said_by(board, "/dev/pts/").split() if "/dev/pts/" in word)


def said_by(board: subprocess.Popen[str], text: str) -> str:
    """The next line with this text in it.   Errors: AssertionError when the program ends without it."""
    assert board.stdout is not None
    lines = []
    for line in board.stdout:
        lines.append(line)
        if text in line:
            return line
    raise AssertionError(f"the emulator ended without '{text}': {''.join(lines)}")


def attach(terminal: str) -> tuple[int, str]:
    """Make a terminal a CAN interface. Gives the open terminal, which keeps it one, and the interface's name."""
    line = os.open(terminal, os.O_RDWR | os.O_NOCTTY)
    fcntl.ioctl(line, termios.TIOCSETD, struct.pack("i", LINE_DISCIPLINE_SLCAN))
    return line, fcntl.ioctl(line, SIOCGIFNAME, bytes(16)).split(b"\0")[0].decode()


def set_link(name: str, *words: str) -> None:
    """`ip link set`."""
    subprocess.run(["ip", "link", "set", name, *words], check=True)


def inside(folder: Path, shift: int) -> int:
    """In User-Mode Linux: one run. Leaves the recording and what the drives report; gives the emulator's status."""
    start_s = time.monotonic()
    with ExitStack() as stack:
        board, terminal = start_board(folder, shift)
        stack.callback(board.kill)
        line, name = attach(terminal)
        stack.callback(os.close, line)
        set_link(name, "txqueuelen", "100", "up")
        words = [sys.executable, "-m", "crease", "sim", "-i", "socketcan", "-c", name, "--json"]
        words += ["--operator", str(folder / OPERATOR_FILE), "--fault", SILENT]
        with can.Bus(interface="socketcan", channel=name) as bus:
            sim = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
            stack.callback(sim.kill)
            wait_for(bus, 0x713)
        # Only an interface with a bit rate opens the channel, and the board waits for that: the drives come first.
        set_link(name, "down")
        set_link(name, "type", "can", "bitrate", "1000000")
        set_link(name, "up")
        last = said_by(board, "the loop has")
        sim.send_signal(signal.SIGINT)
        report = json.loads(sim.communicate(timeout=10)[0])
        set_link(name, "down")
    report["stack_bytes"] = int(last.split()[-1])
    report["seconds"] = time.monotonic() - start_s
    (folder / "sim.json").write_text(json.dumps(report), encoding="ascii")
    return 0 if ENDED in last else 1


# ------------------------------------------------------------------------------------------------------- the verdict


def digest(rows: npt.NDArray[Any]) -> str:
    """Of everything in the records that a re-run compares."""
    fields = RECORD.fields
    assert fields is not None
    compared = int(fields["wake_late_ns"][1])
    words = np.ascontiguousarray(rows).view(np.uint8).reshape(len(rows), RECORD.itemsize)
    return sha256(words[:, :compared].tobytes()).hexdigest()[:16]


def in_contact(rows: npt.NDArray[Any]) -> npt.NDArray[np.bool_]:
    """Ticks that rendered a force, by an answer of their own or by the one before."""
    rendering = np.isin(rows["mode"], (lib.CR_MODE_RENDERING, lib.CR_MODE_LIMITED))
    felt = np.linalg.norm(rows["force_N"], axis=1) > FORCE_MIN_N
    return np.asarray(rendering & (rows["areas"] > 0) & felt)


def check_rendering(rows: npt.NDArray[Any], fault_at: int, clear_at: int) -> list[Outcome]:
    """Drives up, the corner felt, before the fault and after it."""
    contact = in_contact(rows)
    before, after = int(contact[:fault_at].sum()), int(contact[clear_at:].sum())
    enabled = (rows["status"] & 0x6F == 0x27).all(axis=1)
    felt_N = np.abs(rows["contact_force_N"][contact].astype(np.float64))
    least = float((felt_N.min(axis=1) / np.linalg.norm(felt_N, axis=1)).max(initial=0.0))
    late = rows["contact_late_ticks"][contact]
    most_N = float(np.linalg.norm(rows["force_N"][contact], axis=1).max(initial=0.0))
    return [
        Outcome(
            bool(contact.any() and enabled[contact].mean() > 0.99),
            "drives in OPERATION ENABLED while it renders",
        ),
        Outcome(
            before >= TICKS_MIN and least >= CORNER_SHARE,
            f"{before} ticks in contact before the fault, up to {most_N:.1f} N, each face {least:.2f} of it or more; "
            f"contact {late.mean():.1f} ticks old, {late.max(initial=0)} at most",
        ),
        Outcome(bool(contact[max(fault_at - 4, 0)]), "in contact when the drive falls silent"),
        Outcome(after >= TICKS_MIN, f"{after} ticks in contact after it was cleared"),
    ]


def check_fault(rows: npt.NDArray[Any], fault_at: int, clear_at: int) -> list[Outcome]:
    """One fault, the one that was made; no torque from its tick until it is cleared."""
    names = fault_names(int(rows["faults"][fault_at])) if fault_at < len(rows) else []
    quiet = bool(
        (rows["target"][fault_at:clear_at] == 0).all()
        and (rows["torque"][fault_at:clear_at] == 0).all()
    )
    pushed = bool((rows["target"][max(fault_at - 10, 0) : fault_at] != 0).any())
    counters = rows["counters"][-1]
    missing = counters["missing"].tolist()
    others = [count for axis, count in enumerate(missing) if axis != SILENT_AXIS]
    lost = {
        name: int(counters[name])
        for name in (
            "late",
            "twice",
            "malformed",
            "alien",
            "babbled",
            "overruns",
            "send_failed",
            "rx_drops",
        )
    }
    return [
        Outcome(
            names == ["silent"] and int(counters["faults"]) == 1,
            f"fault: {', '.join(names) or 'none'}",
        ),
        Outcome(
            quiet and pushed and clear_at > fault_at,
            f"zero torque from its tick on, for {clear_at - fault_at} ticks",
        ),
        Outcome(
            not any(others) and not any(lost.values()),
            f"no other frame lost: missing {missing}, {lost}",
        ),
    ]


def check_time(rows: npt.NDArray[Any]) -> list[Outcome]:
    """SYNC at its time, whatever the search does; the tick in the first slot that has all states."""
    rendering = np.isin(rows["mode"], (lib.CR_MODE_RENDERING, lib.CR_MODE_LIMITED))[1:]
    period_us = np.diff(rows["sync_ns"].astype(np.int64))[rendering] * 1e-3
    waited_ns = rows["now_ns"].astype(np.int64) - rows["sync_ns"].astype(np.int64)
    waited_us = waited_ns[1:][rendering] * 1e-3
    least_us, most_us = waited_us.min(initial=PERIOD_US), waited_us.max(initial=0.0)
    off_us = max((abs(us - PERIOD_US) for us in period_us.tolist()), default=0.0)
    return [
        Outcome(
            off_us < OFF_MAX_US and most_us < DEADLINE_US + OFF_MAX_US,
            f"periods while it renders are {off_us:.1f} us off at most; "
            f"ticks begin {least_us:.0f} to {most_us:.0f} us after SYNC",
        )
    ]


def check_late(rows: npt.NDArray[Any], late: npt.NDArray[np.int64]) -> list[Outcome]:
    """Held up once: the torque is held, the next tick is in time. Three times in a row: held, halved, a fault."""
    if len(late) != 4 or late[-1] + 1 >= len(rows):
        return [Outcome(False, f"{len(late)} late ticks instead of 4")]
    once, first, second, third = (int(tick) for tick in late)
    torque = rows["torque"]
    stale = rows["limits"] & lib.CR_LIMIT_STALE != 0
    rendering = np.isin(rows["mode"], (lib.CR_MODE_RENDERING, lib.CR_MODE_LIMITED))
    held = all(
        (torque[tick] == torque[tick - 1]).all() and torque[tick].any() for tick in (once, first)
    )
    halved = second == first + 1 and bool((torque[second] == 0.5 * torque[first]).all())
    names = fault_names(int(rows["faults"][third]))
    return [
        Outcome(
            held and bool(rendering[once + 1] and not stale[once + 1]),
            "held up for a period: torque held, in time again a tick later",
        ),
        Outcome(
            halved and third == second + 1 and names == ["overrun"],
            f"held up for three: torque held, halved, fault: {', '.join(names) or 'none'}",
        ),
        Outcome(
            bool((rows["target"][third:] == 0).all() and (torque[third:] == 0).all()),
            f"zero torque from its tick on, for {len(rows) - third} ticks",
        ),
    ]


def check_rerun(recording: Recording, scene: Scene) -> list[Outcome]:
    """The records of the Cortex-M7 against this machine's for the same frames."""
    again = rerun(recording, scene)
    ours, theirs = digest(again.rows), digest(recording.rows)
    same = again.different == 0 and not again.gap and again.records == len(recording)
    return [
        Outcome(
            same and ours == theirs,
            f"{len(recording):,} records, {again.different} different; Cortex-M7 {theirs}, here {ours}",
        )
    ]


def late_ticks(recording: Recording) -> npt.NDArray[np.int64]:
    """Ticks that came late."""
    overruns = recording.rows["counters"]["overruns"].astype(np.int64)
    return np.flatnonzero(np.diff(overruns, prepend=0))


def judge(recording: Recording, scene: Scene, report: dict[str, Any]) -> list[Outcome]:
    """Everything that has to hold of a run."""
    late = late_ticks(recording)
    rows = recording.rows[: late[0] if len(late) else None]
    faulted = rows["mode"] == lib.CR_MODE_FAULT
    fault_at = int(np.argmax(faulted)) if faulted.any() else len(rows)
    clear_at = fault_at + int(np.argmin(np.r_[faulted[fault_at:], False]))
    return [
        *check_rendering(rows, fault_at, clear_at),
        *check_fault(rows, fault_at, clear_at),
        *check_time(rows),
        *check_late(recording.rows, late),
        Outcome(
            report["frames_lost"] == 0 and report["faults_done"] > 0,
            f"drives: {report['ticks']:,} SYNC frames, {report['frames_lost']} frames lost",
        ),
        Outcome(
            report["stack_bytes"] <= STACK_BYTES,
            f"{report['stack_bytes']:,} bytes of stack were used, of search and interrupt together",
        ),
        *check_rerun(recording, scene),
    ]


def judge_slow(recording: Recording, scene: Scene, report: dict[str, Any]) -> list[Outcome]:
    """What has to hold on a slow core too. Its drives stand still while it searches, so that their states get lost."""
    late = late_ticks(recording)
    contact = recording.rows[in_contact(recording.rows)]
    age = contact["contact_late_ticks"]
    return [
        Outcome(
            len(age) >= TICKS_MIN,
            f"{len(age)} ticks in contact, which is {age.max(initial=0)} ticks old at most",
        ),
        *check_time(recording.rows[: late[0] if len(late) else None]),
        *check_late(recording.rows, late),
        Outcome(
            report["stack_bytes"] <= STACK_BYTES,
            f"{report['stack_bytes']:,} bytes of stack were used, of search and interrupt together",
        ),
        *check_rerun(recording, scene),
    ]


def run(shift: int) -> int:
    """Outside: the run, then the verdict."""
    start_s = time.monotonic()
    WORK.mkdir(parents=True, exist_ok=True)
    for name in (RECORD_FILE, "sim.json"):
        (WORK / name).unlink(missing_ok=True)
    operator_path(WORK)
    words = [VCAN_RUN, "-V", "-t", LIMIT_S, sys.executable, __file__, "--inside", "--shift", shift]
    done = subprocess.run([str(word) for word in words], check=False)
    if done.returncode != 0:
        print(f"error: the run ended with {done.returncode}", file=sys.stderr)
        return 1
    report = json.loads((WORK / "sim.json").read_text(encoding="ascii"))
    judged = judge if shift == SHIFT else judge_slow
    outcomes = judged(load_recording(WORK / RECORD_FILE), open_scene(SCENE), report)
    for outcome in outcomes:
        print(f"{'ok  ' if outcome.holds else 'FAIL'}  {outcome.text}")
    print(f"{time.monotonic() - start_s:.0f} s for {report['seconds']:.1f} s of virtual time")
    return 0 if all(outcome.holds for outcome in outcomes) else 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument(
        "--shift", type=int, default=SHIFT, help="an instruction takes 2^SHIFT ns; 3: 480 MHz"
    )
    args = parser.parse_args(arguments)
    return inside(WORK, args.shift) if args.inside else run(args.shift)


if __name__ == "__main__":
    sys.exit(main())
