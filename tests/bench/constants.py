"""What each empirical constant of the contact core is worth: halved and doubled, against the exact tables.

    .venv/bin/python tests/bench/constants.py            prints the table of firmware/contact/CONSTANTS.md
    .venv/bin/python tests/bench/constants.py --write    measures and writes it: half an hour on one core
    .venv/bin/python tests/bench/constants.py --keep     writes it with what was measured before
    .venv/bin/python tests/bench/constants.py --only NAME ...

A constant is a `#define` with a number in firmware/contact. Those that are no choice (limits of the format, sentinels,
guards against rounding) are named in `GIVEN` with the reason. Of each other one the file is compiled anew with half and
with twice its value, the paths of the golden scenes are replayed, and what moved most is told, in shares of its bound.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "golden")]

import bench  # noqa: E402
import test_golden as way_golden  # noqa: E402
import test_golden_extent as extent_golden  # noqa: E402
from crease.base.errors import CreaseError  # noqa: E402
from crease.base.scene import open_scene  # noqa: E402
from crease.replay.measures import Accuracy, Felt, compare, motion_m  # noqa: E402
from crease.replay.replay import DEFAULT_RESPONSE, ROW, ReplayOptions  # noqa: E402
from crease.replay.trajectory import load_trajectory  # noqa: E402
from ranges import Guard, by_constant, read_guards  # noqa: E402
from study.against_exact import box_corners, exact_felt, read_exact  # noqa: E402
from study.program import FLAGS, RIVALS, ROOT, WITH_RIVALS, words_for  # noqa: E402

CONTACT = ROOT / "firmware" / "contact"
PAGE = CONTACT / "CONSTANTS.md"
STIFFNESS_N_M = 1000.0
DEFINE = re.compile(r"^#define (\w+) \(?(-?[0-9][0-9.e+-]*)([fu]?)\)?$", re.MULTILINE)
COMMENT = re.compile(r"/\*((?:(?!\*/).)*)\*/\s*$", re.DOTALL)
GIVEN = {
    "scene.c": "limits of the format: SPEC.md",
    "published.c": "the method as published",
    "NEVER_M": "no length",
    "ENDLESS_M": "no end",
    "CR_WAY_NO_PLANE": "no cosine",
    "NOWHERE": "no height",
    "CR_WAY_NO_SPREAD": "no spread",
    "CR_WAKE_NOW": "no distance",
    "POSITION_MAX_M": "a limit of the interface",
    "QUATERNION_TOLERANCE": "a limit of the interface",
    "LOOKUPS_LEAST": "a limit of the interface",
    "LOOKUPS_MOST": "a limit of the interface",
    "PERIOD_MIN_S": "rounding",
    "ROUNDING_M": "rounding",
    "CR_WAY_SLACK_M": "rounding",
    "CREASE_END": "rounding",
    "HELD_LEAVES_MIN": "a limit of how fast a late contact changes",
    "FLAT": "rounding: a facet beside which nothing is felt otherwise",
    "NOTHING_M": "rounding",
    "LANDING_M": "rounding",
    "AREA_MIN_M2": "rounding",
    "SHARP_MIN": "rounding",
    "CR_WAY_LEAVES_MIN": "rounding",
    "ODOMETER_MAX_M": "the last bit of an odometer",
    "BOX_MAX": "work, no answer",
    "RIVALS_MAX": "work",
    "LANES_OF_STEP": "how finely work is cut",
    "PARTS": "how finely a piece is cut that two planes cut",
    "OUTERMOST": "where the parts of such a piece are",
    "CUT_REACH": "work: beyond it nothing is cut",
    "CR_WORK_PARTS": "how finely work is counted",
    "CR_WAY_BOUNDS_MAX": "a capacity",
}
"""Constants, or all of a file, that are not empirical, and why."""
BY_INSTRUCTIONS = ("CR_PARTS_OF_", "PARTS_OF_", "PAIRS_OF_")
"""Begins of names: parts of a unit of work stand for instructions, `make wcet` and tests/check/test_work_units.py."""
WAY_FILES = {
    *("answer.c", "depth_along.c", "exits.c", "facets.c", "gather.c", "layers.c", "measure.c"),
    *("relate.c", "resolve.c", "rows.c", "way_out.h"),
}
GOLDEN = {"way_out": way_golden, "extent": extent_golden}
EXACT = {"way_out": bench.EXACT, "extent": extent_golden.EXACT}
NOTICED = 0.02
"""A figure that moves by less than this share of its bound did not move."""


@dataclass(frozen=True)
class Constant:
    """A number of the sources: file, name, text of its value, its comment in one line."""

    file: str
    name: str
    value: str
    suffix: str
    why: str

    @property
    def responses(self) -> tuple[str, ...]:
        """Responses whose answer may depend on it: rivals share what detects, not what answers."""
        return ("way_out",) if self.file in WAY_FILES else ("way_out", "extent")

    def scaled(self, factor: float) -> str:
        """The text of the value times a factor; whole numbers stay whole, and at least 1."""
        if self.suffix == "f":
            return self.text(float(self.value) * factor)
        return self.text(max(1, round(int(self.value) * factor)))

    def text(self, value: float) -> str:
        """A value as the sources have it."""
        return f"{value:.8e}f" if self.suffix == "f" else f"{round(value)}{self.suffix}"


def find_constants(folder: Path = CONTACT) -> list[Constant]:
    """Every empirical constant, in the order of the files and of their lines."""
    found = []
    for file in sorted([*folder.glob("*.c"), folder / "way_out.h"]):
        text, why = file.read_text("utf-8"), ""
        for match in DEFINE.finditer(text):
            above, line = (
                COMMENT.search(text[: match.start()]),
                text[: match.start()].rsplit("\n", 2),
            )
            beside = len(line) > 1 and line[-2].startswith("#define")
            why = " ".join(above[1].split()) if above else why if beside else ""
            name, value, suffix = match.groups()
            if not {file.name, name} & GIVEN.keys() and not name.startswith(BY_INSTRUCTIONS):
                found.append(
                    Constant(
                        file.name, name, value, suffix, why.replace(" * ", " ").replace("|", "/")
                    )
                )
    return found


def spoil(constant: Constant, text: str, folder: Path) -> list[Path]:
    """Write the files that know a constant into a folder, with this value of it.   Output  those to compile."""
    users = WAY_FILES - {"way_out.h"} if constant.file == "way_out.h" else {constant.file}
    pattern = re.compile(rf"^#define {constant.name} .*$", re.MULTILINE)
    for file in {"way_out.h", *users}:
        source = (CONTACT / file).read_text("utf-8").replace('"contact/way_out.h"', '"way_out.h"')
        if file == constant.file:
            source = pattern.sub(f"#define {constant.name} {text}", source)
        (folder / file).write_text(source, "utf-8")
    return [folder / file for file in sorted(users)]


class Laboratory:
    """Objects of the core for a response, as it ships or with rivals, compiled once; one file at a time anew."""

    def __init__(self, folder: Path, response: str) -> None:
        """Compile all.   Errors: CreaseError."""
        self.folder, self.response = folder, response
        self.flags = FLAGS if response == DEFAULT_RESPONSE else (*FLAGS, WITH_RIVALS)
        self.sources = {
            f"rivals/{file.name}" if file.parent.name == "rivals" else file.name: file
            for file in (
                HERE / "replay_path.c",
                ROOT / "tests/check/blob.c",
                ROOT / "host/native/replay.c",
                *sorted(CONTACT.glob("*.c")),
                *(RIVALS if WITH_RIVALS in self.flags else ()),
            )
        }
        self.objects = {
            name: self._compile(source, (), folder / f"{name.replace('/', '_')}.o")
            for name, source in self.sources.items()
        }

    def _compile(self, source: Path, first: Sequence[str], to: Path) -> Path:
        folders = [f"-I{ROOT / name}" for name in ("firmware", "host/native", "tests/check")]
        _run(["cc", *self.flags, "-O2", *first, *folders, "-c", source, "-o", to])
        return to

    def program(self, constant: Constant | None, text: str) -> Path:
        """The replay with another value of a constant; None: as it is."""
        objects = dict(self.objects)
        if constant is not None:
            with tempfile.TemporaryDirectory(dir=self.folder) as name:
                for file in spoil(constant, text, Path(name)):
                    to = self.folder / f"new_{file.name}.o"
                    objects[file.name] = self._compile(file, (f"-I{name}",), to)
        to = self.folder / "replay"
        _run(["cc", *objects.values(), "-lm", "-o", to])
        return to

    def measure(self, program: Path, scene_name: str) -> Accuracy:
        """The golden figures of a scene by a program of this laboratory."""
        golden = GOLDEN[self.response]
        spec = golden.SPECS[scene_name]
        exact = read_exact(EXACT[self.response] / str(spec.exact))
        scene, path = open_scene(bench.SCENES / f"{scene_name}.crs"), load_trajectory(spec.path)
        image = np.frombuffer(bytes(scene.image), np.uint8)
        options = ReplayOptions(response=self.response)
        _run(words_for(program, self.folder, image, path.rows, options))
        rows = np.fromfile(self.folder / "rows", ROW)
        felt = Felt(*(rows[n].astype(np.float64) for n in ("force_N", "depth_m", "torque_Nm")))
        moved = motion_m(path.rows[:, 1:4], path.rows[:, 4:8], box_corners(scene))
        return compare(
            felt,
            exact_felt(exact, STIFFNESS_N_M),
            STIFFNESS_N_M,
            float(scene.meta.tool_radius_m),
            moved,
        )


def _run(words: Iterable[object]) -> None:
    done = subprocess.run([str(w) for w in words], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        said = (done.stderr or done.stdout).strip().splitlines()
        raise CreaseError(f"{said[-1] if said else 'a program failed and said nothing'}")


Figures = dict[tuple[str, str, str], float]
"""Of each (response, scene, measure)."""


def figures_of(
    labs: Iterable[Laboratory], constant: Constant | None, text: str, names: Sequence[str]
) -> Figures:
    """All golden figures with another value of a constant; scenes without an exact table of a response are left out."""
    found: Figures = {}
    for lab in labs:
        response, program = lab.response, lab.program(constant, text)
        for name in names or list(GOLDEN[response].SPECS):
            if name in GOLDEN[response].SPECS:
                accuracy = lab.measure(program, name)
                for measure in way_golden.MEASURES:
                    found[response, name, measure] = float(getattr(accuracy, measure))
    return found


def bounds_of() -> Figures:
    """The golden bounds of both responses."""
    tables = {response: golden.BOUNDS for response, golden in GOLDEN.items()}
    return {
        (response, *key): bound
        for response, table in tables.items()
        for key, bound in way_golden.read_bounds(table).items()
    }


def golden_bound(scene: str, measure: str) -> float:
    """The bound of a figure of the library's response."""
    return way_golden.read_bounds(way_golden.BOUNDS)[scene, measure]


def told(before: Mapping[tuple[str, str, str], float], after: Figures, bounds: Figures) -> str:
    """What moved most, in shares of its bound, and how many bounds noticed."""
    key = max(after, key=lambda k: abs(after[k] - before[k]) / bounds[k])
    if abs(after[key] - before[key]) / bounds[key] < NOTICED:
        return "nothing"
    broken = sum(after[k] > bounds[k] for k in after)
    _, scene, measure = key
    noticed = f", {broken} bounds broken" if broken else ""
    return f"{scene} {measure} {before[key]:.3g} to {after[key]:.3g}{noticed}"


HEADS = ("constant", "value", "range", "guard", "why", "halved", "doubled")
CELLS = r"\| (.*?) " * (len(HEADS) - 1)
LINE = re.compile(rf"^\| `(\w+)` \(([\w.]+)\) {CELLS}\|$", re.MULTILINE)
"""Name, file, and the other cells."""


def measured(constants: Sequence[Constant], names: Sequence[str]) -> dict[Constant, list[str]]:
    """What each tells halved and doubled."""
    found = {}
    bounds = bounds_of()
    with tempfile.TemporaryDirectory() as name:
        labs = {}
        for response in GOLDEN:
            (folder := Path(name) / response).mkdir()
            labs[response] = Laboratory(folder, response)
        before = figures_of(labs.values(), None, "", names)
        for constant in constants:
            cells = []
            for factor in (0.5, 2.0):
                chosen = [labs[response] for response in constant.responses]
                after = figures_of(chosen, constant, constant.scaled(factor), names)
                cells.append(told(before, after, bounds))
            found[constant] = cells
            print(f"{constant.file} {constant.name}: {'; '.join(cells)}", flush=True)
    return found


def kept(constants: Sequence[Constant], page: str) -> dict[Constant, list[str]]:
    """The same, as a page has it.   Errors: CreaseError for a constant that it has not, or not with this value."""
    rows = {(name, file): cells for name, file, *cells in LINE.findall(page)}
    found = {}
    for constant in constants:
        cells = rows.get((constant.name, constant.file), [])
        if not cells or cells[0] != constant.value:
            raise CreaseError(f"{constant.file}: {constant.name} is not in {PAGE.name}: measure it")
        found[constant] = cells[-2:]
    return found


def table(cells: Mapping[Constant, Sequence[str]]) -> str:
    """The table, Markdown."""
    guards = by_constant(read_guards())
    lines = [f"| {' | '.join(HEADS)} |", f"|{'---|' * len(HEADS)}"]
    lines += [row_of(c, guards.get((c.name, c.file)), told) for c, told in cells.items()]
    return "\n".join(lines)


def row_of(constant: Constant, guard: Guard | None, cells: Sequence[str]) -> str:
    """A line of the table."""
    told = (guard.range, guard.tests) if guard is not None else ("none", "none")
    place = f"`{constant.name}` ({constant.file})"
    return f"| {' | '.join((place, constant.value, *told, constant.why.strip(), *cells))} |"


def main(arguments: Sequence[str]) -> int:
    """Command line: see above."""
    parser = argparse.ArgumentParser(
        description="the constants of the contact core, halved and doubled"
    )
    parser.add_argument("--write", action="store_true", help=f"write the table into {PAGE.name}")
    parser.add_argument(
        "--keep", action="store_true", help="write it with what was measured before"
    )
    parser.add_argument(
        "--only", nargs="+", default=[], metavar="NAME", help="these constants alone"
    )
    parser.add_argument(
        "--scenes", nargs="+", default=[], metavar="NAME", help="these scenes alone"
    )
    args = parser.parse_args(arguments)
    constants = [c for c in find_constants() if not args.only or c.name in args.only]
    if (args.write or args.keep) and (args.only or args.scenes):
        parser.error("--write and --keep are for the whole table")
    page = PAGE.read_text("utf-8")
    try:
        made = table(kept(constants, page) if args.keep else measured(constants, args.scenes))
    except CreaseError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    if args.write or args.keep:
        begin, end = "<!-- constants: begin -->", "<!-- constants: end -->"
        head, rest = page.split(begin)
        PAGE.write_text(f"{head}{begin}\n{made}\n{end}{rest.split(end)[1]}", "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
