"""Runs the C test programs and pytest, and closes with one count: `N passed, M failed`."""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PROGRAM_LIMIT_S = 900.0
"""One C test program may take this long before it counts as hung."""

PASSED = re.compile(r"^\[  PASSED  \] (\d+) test", re.MULTILINE)
FAILED = re.compile(r"^\[  FAILED  \] (\d+) test", re.MULTILINE)
SKIPPED = re.compile(r"^\[  SKIPPED \] (\d+) test", re.MULTILINE)


@dataclass(frozen=True)
class Count:
    """Tests that passed and that did not."""

    passed: int = 0
    failed: int = 0

    def __add__(self, other: Count) -> Count:
        return Count(self.passed + other.passed, self.failed + other.failed)


def first_number(pattern: re.Pattern[str], text: str) -> int:
    """The number that `pattern` finds in `text`, or zero."""
    match = pattern.search(text)
    return int(match[1]) if match else 0


def run_program(program: Path) -> Count:
    """One cmocka program. A crash or a skipped test counts as failed."""
    start = time.monotonic()
    try:
        result = subprocess.run(
            [program],
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
            cwd=ROOT,
            timeout=PROGRAM_LIMIT_S,
        )
        output, status = result.stdout + result.stderr, f"exit {result.returncode}"
    except (OSError, subprocess.TimeoutExpired) as error:
        output, status = "", str(error)
    passed = first_number(PASSED, output)
    failed = first_number(FAILED, output) + first_number(SKIPPED, output)
    if failed == 0 and (status != "exit 0" or passed == 0):
        failed = 1
    verdict = "ok" if failed == 0 else f"FAILED ({status})"
    name = program.relative_to(ROOT) if program.is_relative_to(ROOT) else program
    print(f"{name}: {passed} passed, {time.monotonic() - start:.1f} s: {verdict}", flush=True)
    if failed:
        print(output, flush=True)
    return Count(passed, failed)


SLOW_PROGRAMS = ("test_bitflips", "test_rivals", "test_soak")
"""C programs that take ten seconds and more: left out with --quick."""


LONG_PROGRAMS = (*SLOW_PROGRAMS, "test_servo_faults", "test_detect", "test_way_out")
"""Begun first, so that no processor waits for one of them at the end."""


def run_programs(folders: Sequence[Path], quick: bool, only: Sequence[str]) -> Count:
    """Every test program of `folders` (the ones whose source is still there), as many at a time as there are cores.

    The folders hold the same tests, built in other ways: all must pass, those of the first are counted.
    """
    sources = {path.stem for path in (ROOT / "tests").glob("*/test_*.c")}
    chosen = sorted(only or sources.difference(SLOW_PROGRAMS if quick else ()))
    programs = [folder.resolve() / name for folder in folders for name in chosen]
    programs.sort(key=lambda program: program.name not in LONG_PROGRAMS)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        counts = list(pool.map(run_program, programs))
    first = folders[0].resolve()
    return sum(
        (
            count if program.parent == first else Count(0, count.failed)
            for program, count in zip(programs, counts, strict=True)
        ),
        Count(),
    )


HIL_FILES = ("tests/bus/test_drive.py", "tests/bus/test_bus_cli.py", "tests/hil")
"""Tests that run a second time, or only, on a real vcan0."""


def read_junit(report: Path, status: int) -> Count:
    """Passed and failed of a pytest run, from its JUnit report. Skipped counts as failed: every test must run."""
    if not report.exists():
        return Count(0, 1)
    suites = ET.parse(report).getroot().iter("testsuite")
    totals = [
        {k: int(s.get(k, "0")) for k in ("tests", "failures", "errors", "skipped")} for s in suites
    ]
    tests = sum(t["tests"] for t in totals)
    failed = sum(t["failures"] + t["errors"] + t["skipped"] for t in totals)
    if status != 0 and failed == 0:
        failed = 1
    return Count(max(tests - failed, 0), failed)


BESIDE = (
    *("tests/host/test_live.py", "tests/host/test_readme.py", "tests/host/test_wheel.py"),
    *(
        "tests/host/test_experiment.py",
        "tests/host/test_stress.py",
        "tests/host/test_bake_limits.py",
    ),
    *("tests/host/test_couple_peg.py", "tests/host/test_six.py"),
    "tests/property/test_force_of_way_out.py",
)
"""Run beside the rest of tests/host and all others: some of it waits, and all three rows take as long."""


def run_all_pytest(select: str, hil: Callable[[], Count] | None) -> Count:
    """Every pytest of the tree, in three rows beside each other and beside `hil`.

    Those that are marked `quiet` come last, with nothing beside them.
    """
    kept = ["-m", f"not quiet{select}"]
    apart = [f"--ignore={path}" for path in BESIDE]
    folders = sorted(f"tests/{path.parent.name}" for path in (ROOT / "tests").glob("*/test_*.py"))
    others = [folder for folder in dict.fromkeys(folders) if folder != "tests/host"]
    jobs: list[Callable[[], Count]] = [
        partial(run_pytest, [*kept, *apart], ["tests/host"], "pytest-host"),
        partial(run_pytest, [*kept, *apart], others, "pytest-others", keep=True),
        partial(run_pytest, kept, BESIDE, "pytest-beside", keep=True),
        *([hil] if hil else []),
    ]
    with ThreadPoolExecutor(len(jobs)) as pool:
        count = sum(pool.map(call, jobs), Count())
    for name in ("pytest-others", "pytest-beside", *([HIL] if hil else [])):
        print((ROOT / "build" / f"{name}.log").read_text(errors="replace"), flush=True)
    return count + run_pytest(["-m", f"quiet{select}"], ["tests"], "pytest-quiet")


def run_pytest(
    select: list[str],
    paths: Sequence[str],
    name: str = "pytest",
    wrap: Sequence[str] = (),
    keep: bool = False,
    **extra: str,
) -> Count:
    """pytest over `paths`, inside the command `wrap`, with more environment. keep: its words go to build/NAME.log."""
    report = ROOT / "build" / f"{name}.xml"
    report.parent.mkdir(exist_ok=True)
    report.unlink(missing_ok=True)
    config = ["-c", "host/pyproject.toml", "--rootdir", ".", f"--junit-xml={report}"]
    command = [*wrap, sys.executable, "-m", "pytest", *config, *select, "--durations=5", *paths]
    with ExitStack() as stack:
        said = stack.enter_context(report.with_suffix(".log").open("wb")) if keep else None
        status = subprocess.run(
            command, check=False, cwd=ROOT, env=os.environ | extra, stdout=said, stderr=said
        ).returncode
    return read_junit(report, status)


HIL = "pytest-hil"
VCAN = Path("/sys/class/net/vcan0")
VIRTUAL_LIMIT_S = 1800
"""For all of HIL_FILES, on the machine's clock."""


def run_hil() -> Count:
    """The protocol and closed-loop tests on this kernel's vcan0."""
    print("bus transport: socketcan, vcan0 of this kernel", flush=True)
    return run_pytest([], HIL_FILES, HIL, CREASE_TRANSPORT="socketcan")


def run_virtual_hil() -> Count:
    """The same on User-Mode Linux's vcan0, with virtual time: whatever runs beside it, it sees the same."""
    print("bus transport: socketcan, vcan0 in User-Mode Linux with virtual time", flush=True)
    wrap = (str(ROOT / "tests" / "hil" / "lab" / "vcan-run"), "-V", "-t", str(VIRTUAL_LIMIT_S))
    return run_pytest(
        [], HIL_FILES, HIL, wrap, keep=True, CREASE_TRANSPORT="socketcan", CREASE_VIRTUAL_TIME="1"
    )


def call(job: Callable[[], Count]) -> Count:
    """What `job` gives."""
    return job()


def hear_signals() -> None:
    """What whoever began this had ignored is heard again: a program that a test ends by Ctrl-C would run on.

    Shells begin their background jobs so, and nohup.
    """
    for number in (signal.SIGINT, signal.SIGQUIT, signal.SIGHUP):
        if signal.getsignal(number) == signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL)


def main() -> int:
    """Command line: see the Makefile."""
    hear_signals()
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--c-tests", type=Path, required=True, help="folder of test programs")
    parser.add_argument("--sanitized", type=Path, help="the same programs with sanitizers")
    parser.add_argument(
        "--quick", action="store_true", help="leave out what takes a second and more"
    )
    parser.add_argument("--only-c", action="store_true", help="no pytest")
    parser.add_argument("--programs", nargs="+", default=[], help="C programs (all)")
    parser.add_argument("paths", nargs="*", default=["tests"], help="for pytest (tests)")
    args = parser.parse_args()
    folders = [args.c_tests, *([args.sanitized] if args.sanitized else [])]
    count = run_programs(folders, args.quick, args.programs)
    if not args.only_c:
        beside = None if args.quick or VCAN.exists() else run_virtual_hil
        if args.paths == ["tests"]:
            count += run_all_pytest(" and not slow" if args.quick else "", beside)
        else:
            count += run_pytest(["-m", "not slow"] if args.quick else [], args.paths)
            count += beside() if beside else Count()
        if VCAN.exists() and not args.quick:
            count += run_hil()
    print(f"{count.passed} passed, {count.failed} failed", flush=True)
    return 1 if count.failed or not count.passed else 0


if __name__ == "__main__":
    sys.exit(main())
