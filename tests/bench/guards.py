"""Shows that every constant of the contact core is guarded: its test passes at both ends of its range and fails beyond.

    .venv/bin/python tests/bench/guards.py                 all of them: some minutes on one core
    .venv/bin/python tests/bench/guards.py --only NAME ...

tests/bench/constants_guards.toml has the claims. For each the core is compiled with the value that is claimed about,
and the one test that is named is judged: a C test of tests/unit is run against that core, the golden figure of a scene
measured by a replay with it, and the units of work of tests/check/test_work_units.py are counted in it.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from functools import cached_property
from pathlib import Path

from constants import Constant, Laboratory, find_constants, golden_bound, spoil

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests" / "check")]

import work_units  # noqa: E402
from ranges import ENDS, GOLDEN, WORK, End, read_guards  # noqa: E402

GCC = ROOT / "build" / "gcc"
FLAGS = (*work_units.C_STD, "-O1", "-DCR_ASSERTS=1")


class Bench:
    """Cores with one value changed, and the tests that judge them."""

    def __init__(self, folder: Path, tests: Iterable[str]) -> None:
        """Make what the C tests are linked of.   Errors: SystemExit with what `make` said."""
        self.folder = folder
        names = sorted(
            {Path(t.partition("::")[0]).stem for t in tests if t.startswith("tests/unit/")}
        )
        made = [f"build/gcc/tests/{name}" for name in names]
        made += [f"build/gcc/lib{name}.a" for name in ("helpers", "crease", "sim")]
        done = subprocess.run(["make", "-s", *made], cwd=ROOT, capture_output=True, text=True, check=False)  # fmt: skip
        if done.returncode != 0:
            raise SystemExit(done.stderr or done.stdout)
        self.said: dict[tuple[str, str, str, str], str] = {}

    @cached_property
    def laboratory(self) -> Laboratory:
        """Replays of golden paths, made when one is asked for."""
        place = self.folder / "replays"
        place.mkdir()
        return Laboratory(place, "way_out")

    @cached_property
    def scalar(self) -> dict[str, Path]:
        """Objects of the core without vectors and of the program that counts."""
        place = self.folder / "scalar"
        place.mkdir()
        return work_units.compile_core(place)

    def passes(self, constant: Constant, value: float, test: str) -> bool:
        """Whether a test passes with a value of a constant.   Errors: ValueError when it is not run at all."""
        if test.startswith("tests/unit/"):
            path, _, name = test.partition("::")
            said = self._run_c(constant, constant.text(value), Path(path).stem)
            if f"[ RUN      ] {name}\n" not in said:
                raise ValueError(f"{test}: not run; {said.strip().splitlines()[-1:]}")
            return f"[       OK ] {name}\n" in said
        if test.startswith(WORK):
            flags = (*work_units.FLAGS, work_units.SCALAR)
            made = self._compile(constant, constant.text(value), flags)
            parts = work_units.count_units({**self.scalar, **made}, self.folder)
            weight = work_units.WEIGHTS[constant.name, constant.file]
            return work_units.is_as_before(weight, work_units.cost_of(weight, parts))
        scene, _, measure = test.removeprefix(GOLDEN).strip("[]").partition("-")
        program = self.laboratory.program(constant, constant.text(value))
        accuracy = self.laboratory.measure(program, scene)
        return bool(getattr(accuracy, measure) <= golden_bound(scene, measure))

    def _run_c(self, constant: Constant, text: str, program: str) -> str:
        """What a C test program says with a value."""
        key = (constant.file, constant.name, text, program)
        if key not in self.said:
            objects = self._compile(constant, text, FLAGS).values()
            archives = [GCC / f"lib{name}.a" for name in ("helpers", "crease", "sim")]
            libraries = ("-lcmocka", "-Wl,--as-needed", "-lode", "-lm")
            to = self.folder / program
            own = GCC / f"tests/unit/{program}.o"
            subprocess.run(["gcc", *objects, own, *archives, *libraries, "-o", to], check=True)
            done = subprocess.run([to], capture_output=True, text=True, check=False, timeout=300.0)
            self.said[key] = done.stdout + done.stderr
        return self.said[key]

    def _compile(self, constant: Constant, text: str, flags: Sequence[str]) -> dict[str, Path]:
        """Objects of the files that know the constant, with this value."""
        place = self.folder / "core"
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir()
        made = {}
        for file in spoil(constant, text, place):
            made[file.name] = file.with_suffix(".o")
            includes = (f"-I{place}", f"-I{ROOT / 'firmware'}")
            subprocess.run(
                ["gcc", *flags, *includes, "-c", file, "-o", made[file.name]], check=True
            )
        return made


def judge(bench: Bench, constant: Constant, which: str, end: End) -> tuple[str, bool]:
    """What an end of a range shows, and whether it is as claimed."""
    if not end.test or end.value is None or end.fails is None:
        return f"{which}: {end.why}", bool(end.why)
    within, beyond = (bench.passes(constant, v, end.test) for v in (end.value, end.fails))
    shown = ("passes" if within else "FAILS", "PASSES" if beyond else "fails")
    return f"{which} {end.value:g} {shown[0]}, {end.fails:g} {shown[1]}", within and not beyond


def main(arguments: Sequence[str]) -> int:
    """Command line: see above."""
    parser = argparse.ArgumentParser(description="the guards of the constants, seen to fail")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="these constants alone")  # fmt: skip
    args = parser.parse_args(arguments)
    constants = {(c.name, c.file): c for c in find_constants()}
    guards = [g for g in read_guards() if not args.only or g.name in args.only]
    wrong = 0
    with tempfile.TemporaryDirectory() as name:
        bench = Bench(Path(name), {end.test for g in guards for end in g.ends if end.test})
        for guard in guards:
            constant = constants[guard.name, guard.file]
            shown = [
                judge(bench, constant, which, end)
                for which, end in zip(ENDS, guard.ends, strict=True)
            ]
            good = all(ok for _, ok in shown)
            wrong += not good
            verdict = "guarded" if good else "NOT AS CLAIMED"
            told = "; ".join(text for text, _ in shown)
            print(f"{guard.file} {guard.name} {constant.value}: {told}: {verdict}", flush=True)
    print(f"{len(guards)} constants, {wrong} not as claimed")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
