"""`make wcet`: the most instructions of a tick on a Cortex-M7, derived from the object code.

    python wcet.py [--quick] [--facets N] [--work N]

Prints what it is made of, stage by stage, and fails where the object code has a loop without a bound, the table a bound
without a loop, or a measured tick exceeds what is derived. --quick: beside the ticks that were kept, measures none and
writes nothing; else the figures of firmware/WCET.md are written anew.
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crease.base.scene import open_scene
from jobs import ROOT
from longest import BoundError, Code, Copy, Longest, NamedLoop, Programme, read
from runs import CheckError, build_counter, run_blocks
from worst import BOARD_LOOKUPS, Counted, Found, measure, poses_job, read_poses

PROGRAM = ROOT / "build" / "m7" / "replay.elf"
TABLE = ROOT / "tests" / "check" / "wcet.toml"
FIRMWARE = ROOT / "firmware"
ROOTS = ("cr_tick", "cr_feel")
_DEFINE = re.compile(r"^#define (\w+) +(.+?)(?: */[/*].*)?$", re.MULTILINE)
_UNSIGNED = re.compile(r"\b(\d+)u\b")
_NAME = re.compile(r"(?:(\w+\.[ch]):)?([A-Z][A-Z0-9_]+)\b")


class Constants:
    """Numbers of the sources by name; `file.c:NAME` where several have one."""

    def __init__(self, instead: Mapping[str, int] | None = None) -> None:
        """instead: of what the sources have."""
        self._instead = dict(instead or {})
        self._texts: dict[str, dict[str, str]] = {}
        for path in (FIRMWARE / "config.h", *sorted((FIRMWARE / "contact").glob("*.[ch]"))):
            for name, text in _DEFINE.findall(path.read_text("utf-8")):
                self._texts.setdefault(name, {})[path.name] = text

    def but(self, **instead: int) -> Constants:
        """With other numbers."""
        made = Constants.__new__(Constants)
        made._texts, made._instead = self._texts, self._instead | instead
        return made

    def value(self, text: str | float, **more: int) -> float:
        """Of an expression of names and numbers; // divides as C does.   Errors: BoundError."""
        if not isinstance(text, str):
            return float(text)

        def number(match: re.Match[str]) -> str:
            file, name = match[1], match[2]
            if name in self._instead:
                return str(self._instead[name])
            of = self._texts.get(name, {})
            chosen = {of[file]} if file in of else set() if file else set(of.values())
            if len(chosen) != 1:
                raise BoundError(f"{match[0]}: {len(chosen)} constants of this name")
            whole = _UNSIGNED.sub(r"\1", chosen.pop()).replace("/", "//")
            return f"({self.value(whole):.0f})"

        for name, n in more.items():
            text = re.sub(rf"\b{name}\b", str(n), text)
        plain_text = _NAME.sub(number, text)
        if not re.fullmatch(r"[\d.()+*/ -]+", plain_text):
            raise BoundError(f"{text}: not an expression of numbers")
        return float(eval(plain_text, {"__builtins__": {}}))


@dataclass(frozen=True)
class Table:
    """tests/check/wcet.toml."""

    rows: dict[str, Any]

    @property
    def stages(self) -> dict[str, str]:
        """Of the functions that begin one."""
        return dict(self.rows["stages"])

    def check(self, code: Code) -> None:
        """It is of this code.   Errors: BoundError: a loop without a bound, a bound without a loop."""
        known = {name for row in self.rows["bound"] for name in row["loops"]}
        known |= set(self.rows.get("library_loops", {}))
        found = {loop.name for loop in code.loops}
        short = {name.rpartition(" #")[0] for name in found}
        for loop in sorted(code.loops, key=lambda one: one.name):
            if not {loop.name, loop.name.rpartition(" #")[0]} & known:
                raise BoundError(f"{loop.name}: a loop without a bound: say one in {TABLE.name}")
        for name in sorted(known - found - short):
            raise BoundError(f"{name}: a bound in {TABLE.name}, but no such loop")

    def bounds(self, constants: Constants) -> Callable[[NamedLoop, Copy], float]:
        """How often the body of a loop runs."""
        most = {n: constants.value(row["most"]) for row in self.rows["bound"] for n in row["loops"]}
        callers = {c: row["bytes"] for row in self.rows.get("library", ()) for c in row["callers"]}

        def bound(loop: NamedLoop, copy: Copy) -> float:
            short = loop.name.rpartition(" #")[0]
            if loop.name in most or short in most:
                return most.get(loop.name, most.get(short, 0.0))
            caller = copy[1].replace("<", " < ")
            if caller not in callers:
                raise BoundError(f"{caller}: how many bytes is not said")
            size = int(constants.value(callers[caller]))
            return constants.value(self.rows["library_loops"][loop.name], bytes=size)

        return bound

    def work(self, constants: Constants, uncounted: Sequence[str] = ()) -> dict[str, float]:
        """Units that are counted at places."""
        units: dict[str, float] = {}
        for row in self.rows["work"]:
            if row["at"] not in uncounted:
                units[row["at"]] = units.get(row["at"], 0.0) + constants.value(row["units"])
        return units

    def programme(
        self,
        code: Code,
        root: str,
        constants: Constants,
        resumed: str = "",
        before: Mapping[str, float] | None = None,
    ) -> Programme:
        """Paths of a function, with all that bounds them but the work; resumed, before: of Programme."""
        library = {c.partition(" ")[0] for r in self.rows.get("library", ()) for c in r["callers"]}
        bounds, of_caller = self.bounds(constants), tuple(sorted(library))
        made = Programme(code, root, self.stages, bounds, of_caller, resumed, before)
        for fact in self.rows.get("fact", ()):
            sums = {place: constants.value(n) for place, n in fact["sum"].items()}
            made.at_most(sums, constants.value(fact["most"]))
        return made


def read_table(file: Path = TABLE) -> Table:
    """The table."""
    return Table(tomllib.loads(file.read_text("utf-8")))


@dataclass(frozen=True)
class Bound:
    """Of a slice, its last step and a feel. zones: of the tick that takes most; slice, step: which, and their paths."""

    zones: int
    slice: str
    step: str
    slice_path: Longest
    step_path: Longest

    @property
    def instructions(self) -> int:
        """In all."""
        return self.slice_path.instructions + self.step_path.instructions

    def stages(self) -> dict[str, float]:
        """Instructions by stage, those of the last step under `last step: ...`."""
        by: dict[str, float] = {}
        for (stage, _), n in self.slice_path.by.items():
            by[stage] = by.get(stage, 0.0) + n
        return by | {f"last step, {self.step}": float(self.step_path.instructions)}


CARRIED = 1
"""Parts of a unit that `stats.work` leaves out, and the middle of the tool, which is looked up and not counted."""


def programmes_of_steps(code: Code, table: Table, constants: Constants) -> dict[str, Programme]:
    """Of each step, by its name."""
    found = {}
    for row in table.rows["step"]:
        resumed, before = row.get("from", ""), row.get("before", {})
        made = table.programme(code, row["root"], constants, resumed, before)
        for place, most in row["most"].items():
            made.at_most({place: 1.0}, constants.value(most))
        found[row["name"]] = made
    return found


def steps_of(code: Code, table: Table, constants: Constants) -> dict[str, Longest]:
    """The longest of each step, whatever it counts."""
    made = programmes_of_steps(code, table, constants)
    return {name: programme.longest() for name, programme in made.items()}


def lost_of(code: Code, table: Table, constants: Constants) -> list[str]:
    """A line for each way back from where a step goes on that the table leaves none."""
    made = programmes_of_steps(code, table, constants)
    lost = [(name, call) for name, programme in made.items() for call in programme.never()]
    return [f"step {name}: no way back from {call}" for name, call in lost]


def bound_with(code: Code, table: Table, constants: Constants, work: int) -> Bound:
    """The most of a tick with these constants: work - 1 units of steps, and a last one."""
    steps = steps_of(code, table, constants)
    found = []
    zones = int(constants.value("CR_WAY_ZONES_MAX"))
    for row in table.rows["slice"]:
        made = table.programme(code, row["root"], constants)
        made.at_most(table.work(constants, row.get("uncounted", ())), work - 1.0 + CARRIED)
        for place in row.get("never", ()):
            made.at_most({place: 1.0}, 0.0)
        last = max(row["last"], key=lambda name: steps[name].instructions)
        found.append(Bound(zones, row["name"], last, made.longest(), steps[last]))
    return max(found, key=lambda bound: bound.instructions)


def bound_of(
    code: Code, table: Table, constants: Constants, work: int, quick: bool = False
) -> Bound:
    """The most of any tick, over all counts of zones; quick: over a few of them."""
    most = int(constants.value("CR_WAY_ZONES_MAX"))
    counts = [1, 4, 16, most] if quick else range(1, most + 1)
    all_ = [bound_with(code, table, constants.but(CR_WAY_ZONES_MAX=z), work) for z in counts]
    return max(all_, key=lambda bound: bound.instructions)


# ------------------------------------------------------------------------------------------------------------- measured


def unfit(code: Code, table: Table, constants: Constants, found: Found) -> list[str]:
    """Bounds and facts that what runs at a pose does not fit; work that is not counted as the table says."""
    made = table.programme(code, "cr_tick", constants)
    job, rows = poses_job(found.scene, found.lookups, [found.pose])
    scene = open_scene(ROOT / "build" / "scenes" / f"{found.scene}.crs")
    did = Counted(scene, found.lookups).sum(rows)
    with tempfile.TemporaryDirectory(prefix="crease-wcet-") as folder:
        file = Path(folder) / "pose.job"
        file.write_bytes(job)
        ran = run_blocks("m7", PROGRAM, file)
    # of zones that join only what each of them counts however few they are
    units = table.work(constants.but(CR_WAY_ZONES_MAX=1))
    lines = made.broken(ran, len(rows), units, did + CARRIED * len(rows))
    return [f"{found.scene}, {found.lookups} lookups: {line}" for line in lines]


# --------------------------------------------------------------------------------------------------------------- report


def loops_of(code: Code, table: Table, path: Longest, stage: str) -> list[tuple[str, str, float]]:
    """Loops of a stage: what bounds each, by the table, and the instructions of its own; most first."""
    said = {n: row["most"] for row in table.rows["bound"] for n in row["loops"]}
    found: dict[tuple[str, str], float] = {}
    for loop in code.loops:
        of = code.functions[loop.function]
        inner = {b for o in of.loops if o.blocks < loop.loop.blocks for b in o.blocks}
        short = loop.name.rpartition(" #")[0]
        most = said.get(loop.name, said.get(short))
        for copy in {c for c, _ in path.counts if c[0] == stage}:
            if Programme.name_of(copy) != loop.function or most is None:
                continue
            own = sum(
                path.counts[copy, b] * len(of.blocks[b].code) for b in loop.loop.blocks - inner
            )
            found[short, most] = found.get((short, most), 0.0) + own
    ranked = sorted(found.items(), key=lambda item: -item[1])
    return [(name, most, n) for (name, most), n in ranked if n > 0.0]


def rows_of(code: Code, table: Table, bound: Bound) -> list[tuple[str, str, int, float]]:
    """Stage, the loops that weigh most in it with what bounds them, instructions, share."""
    rows = []
    for stage, n in bound.stages().items():
        if n < 1.0:
            continue  # all work goes where it costs more
        last = stage.startswith("last step")
        path = bound.step_path if last else bound.slice_path
        names = {c[0] for c in path.by} if last else {stage}
        loops = sorted(
            (loop for name in names for loop in loops_of(code, table, path, name)),
            key=lambda loop: -loop[2],
        )
        said = ", ".join(f"`{name.partition(':')[0]}` {most}" for name, most, _ in loops[:2])
        rows.append((stage, said, round(n), n / bound.instructions))
    return rows


def page_of(
    bounds: Mapping[int, Bound], code: Code, table: Table, others: Mapping[str, int]
) -> str:
    """The figures of firmware/WCET.md."""
    most = bounds[max(bounds)]
    lines = [
        "| stage | loops that weigh most, and how often their bodies run | instructions | share |"
    ]
    lines.append("| --- | --- | --- | --- |")
    for stage, said, n, share in rows_of(code, table, most):
        lines.append(f"| {stage} | {said} | {n:,} | {100 * share:.0f} % |")
    lines.append(f"| **tick** | | **{most.instructions:,}** | |")
    lines += ["", "| of this | instructions at most |", "| --- | --- |"]
    lines += [f"| {name} | {n:,} |" for name, n in others.items()]
    lines += ["", "| facets of a cell of the image, at most | tick |", "| --- | --- |"]
    lines += [f"| {facets} | {b.instructions:,} |" for facets, b in bounds.items()]
    return "\n".join(lines)


def write_page(text: str, page: Path = FIRMWARE / "WCET.md") -> None:
    """Between its marks."""
    old = page.read_text("utf-8")
    new = re.sub(
        r"(<!-- wcet: begin -->\n).*?(<!-- wcet: end -->)",
        lambda m: f"{m[1]}{text}\n{m[2]}",
        old,
        flags=re.DOTALL,
    )
    page.write_text(new, "utf-8")


def exceeded(bound: int, measured: Mapping[str, int]) -> list[str]:
    """A line for each measured tick that is above the bound."""
    return [
        f"{name}: {n:,} instructions were measured, {bound:,} derived"
        for name, n in measured.items()
        if n > bound
    ]


def measured_ticks(quick: bool) -> dict[str, int]:
    """Ticks of the poses that were searched for, with the work of a board's: as they were kept, or today."""
    poses = [f for f in read_poses() if f.lookups == BOARD_LOOKUPS]
    if quick:
        return {f.scene: f.instructions for f in poses}
    build_counter()
    return {f.scene: n for f, n in zip(poses, measure(poses), strict=True)}


def groups_of_board() -> int:
    """Groups of the shell that the board's loop has memory for, by its own words."""
    text = (FIRMWARE / "port" / "cortex-m7" / "controller.c").read_text("ascii")
    (told,) = re.findall(r"/\* A servo and a world with (\d+) groups", text)
    return int(told)


def main() -> int:
    """Command line: see above."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="measure nothing, write nothing")
    parser.add_argument("--facets", type=int, help="of a cell of the image at most (6)")
    parser.add_argument("--work", type=int, default=BOARD_LOOKUPS, help="units of a slice (40)")
    args = parser.parse_args()
    try:
        code, table = read(PROGRAM, ROOTS), read_table()
        table.check(code)
        constants = Constants({"GROUPS": groups_of_board()})
        most = args.facets or int(constants.value("CR_KIND_FACETS_MAX"))
        wanted = [most] if args.quick or args.facets else range(3, most + 1)
        bounds = {
            n: bound_of(code, table, constants.but(CR_KIND_FACETS_MAX=n), args.work, args.quick)
            for n in wanted
        }
        steps = steps_of(code, table, constants)
        feel = table.programme(code, "cr_feel", constants).longest()
        others = {
            f"longest step of the search: {name}": p.instructions for name, p in steps.items()
        }
        others["`cr_feel` alone"] = feel.instructions
        measured = measured_ticks(args.quick)
        seen = [] if args.quick else read_poses()
        breaches = [line for f in seen for line in unfit(code, table, constants, f)]
        breaches += lost_of(code, table, constants)
    except (BoundError, CheckError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    bound = bounds[most]
    print(f"a tick of {args.work} units of work, {bound.zones} zones, search that {bound.slice}:")
    for stage, said, n, share in rows_of(code, table, bound):
        print(f"  {stage:24}{n:12,}  {100 * share:3.0f} %  {said}")
    print(f"  {'tick':24}{bound.instructions:12,}")
    for name, n in others.items():
        print(f"{name}: {n:,}")
    for n, other in bounds.items():
        print(f"cells of {n} facets at most: {other.instructions:,}")
    worst = max(measured.values())
    print(f"largest measured: {worst:,}, {worst / bound.instructions:.3f} of what is derived")
    breaches += exceeded(bound.instructions, measured)
    for line in breaches:
        print(f"breach: {line}", file=sys.stderr)
    if not (args.quick or args.facets or args.work != BOARD_LOOKUPS):
        write_page(page_of(bounds, code, table, others))
    return 1 if breaches else 0


if __name__ == "__main__":
    sys.exit(main())
