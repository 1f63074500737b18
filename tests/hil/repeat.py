"""Two runs of the closed loop on vcan0 in virtual time: the same frames with the same stamps, and no tick missed.

    python tests/hil/repeat.py [--seconds S] [--keep DIR]

Starts User-Mode Linux twice (make hil-kernel), each time with the firmware and the simulated drives in processes of
their own.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from hashlib import sha256
from pathlib import Path

from hil_tools import ROOT, bake_scene, closed_loop, late_syncs, of

VCAN_RUN = ROOT / "tests" / "hil" / "lab" / "vcan-run"
STATES = (0x191, 0x192, 0x193)


def record(scene: Path, seconds: float, log: Path) -> int:
    """Inside: run the loop and write its frames as candump does. Gives the number of things that went wrong."""
    with closed_loop(scene, "--seconds", f"{seconds:g}") as loop:
        heard = loop.listen(seconds + 1.0)
        text = loop.creased.communicate(timeout=20)[0].strip()
    lines = [f"({time_s:.6f}) vcan0 {cob:03X}#{data.hex().upper()}" for time_s, cob, data in heard]
    log.write_text("\n".join(lines) + "\n", encoding="ascii")
    late = late_syncs(heard)
    last_s = of(heard, 0x193)[-1][0]
    first_s = of(heard, 0x193)[0][0]
    asked = sum(first_s - 5e-4 <= time_s <= last_s for time_s, _ in of(heard, 0x080))
    missing = sum(abs(len(of(heard, cob)) - asked) for cob in STATES)
    print(
        f"{len(heard):,} frames, {late} ticks late or missed, {missing} of {3 * asked:,} answers missing"
    )
    if loop.creased.returncode != 0:
        print(text, file=sys.stderr)
    return late + missing + (loop.creased.returncode != 0)


def once(scene: Path, seconds: float, log: Path) -> tuple[int, list[str]]:
    """Outside: one run. Gives its status and the lines of its log."""
    start_s = time.monotonic()
    log.unlink(missing_ok=True)
    words = [sys.executable, __file__, "--record", log, "--scene", scene, "--seconds", seconds]
    command = [str(word) for word in (VCAN_RUN, "-V", "-t", 300 + 10 * seconds, *words)]
    # The hash seed decides how often an interpreter looks at the clock, and a look costs 0.3 us of virtual time.
    environment = os.environ | {"PYTHONHASHSEED": "0"}
    done = subprocess.run(command, check=False, text=True, capture_output=True, env=environment)
    lines = log.read_text(encoding="ascii").splitlines() if log.exists() else []
    digest = sha256("\n".join(lines).encode()).hexdigest()
    print(
        f"{time.monotonic() - start_s:.1f} s: {done.stdout.strip()}; log {digest[:16]}", flush=True
    )
    if done.returncode != 0:
        print(f"status {done.returncode}\n{done.stderr}", file=sys.stderr)
    return done.returncode, lines


def difference(first: list[str], second: list[str]) -> str:
    """What two logs have in common, in words."""
    if first == second and first:
        return "identical byte for byte"
    frames = [[line.split()[2] for line in lines] for lines in (first, second)]
    if frames[0] == frames[1] and first:
        stamps = [
            [float(line.split()[0].strip("()")) for line in lines] for lines in (first, second)
        ]
        most_s = max(abs(a - b) for a, b in zip(*stamps, strict=True))
        return f"DIFFER in stamps by at most {1e6 * most_s:.0f} us; same frames in the same order"
    at = next(
        (i for i, (a, b) in enumerate(zip(*frames, strict=False)) if a != b), min(map(len, frames))
    )
    return f"DIFFER from frame {at:,} on"


def compare(seconds: float, keep: Path | None) -> int:
    """Two runs. Gives the exit status."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scene, log = bake_scene(folder), folder / "run.log"
        print("warm-up: the interpreter writes its caches")
        once(scene, 1.5, log)
        runs = [once(scene, seconds, log) for _ in range(2)]
    if keep is not None:
        for number, (_, lines) in enumerate(runs, 1):
            (keep / f"run{number}.log").write_text("\n".join(lines) + "\n", encoding="ascii")
    whole = all(status == 0 for status, _ in runs)
    verdict = difference(runs[0][1], runs[1][1])
    print(
        f"{seconds:g} s at 1 kHz: {'no tick missed' if whole else 'TICKS MISSED'}, logs of two runs {verdict}"
    )
    return 0 if whole and verdict.startswith("identical") else 1


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--keep", metavar="DIR", type=Path, help="keep both logs")
    parser.add_argument("--record", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--scene", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.record is not None:
        return min(record(args.scene, args.seconds, args.record), 99)
    return compare(args.seconds, args.keep)


if __name__ == "__main__":
    sys.exit(main())
