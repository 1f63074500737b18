"""What a unit of work costs on a core without vectors, in lookups of 16 points: valgrind counts work_units.c.

A step of a search ends when it has done so many units, and takes as long as they cost: what is counted for too little
makes steps longer than a board has time for, what is counted for too much makes answers late.
"""

from __future__ import annotations

import re
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CONTACT = ROOT / "firmware" / "contact"
C_STD = ("-std=c11", "-D_POSIX_C_SOURCE=200809L", "-ffp-contract=off", "-fno-math-errno")
FLAGS = (*C_STD, "-O2")
SCALAR = "-DCR_SCALAR=1"
PART = re.compile(r"Trigger: Client Request: (\w+)")
TOTAL = re.compile(r"^(?:summary|totals): (\d+)", re.MULTILINE)
ROOM = 1.6
"""A unit may cost so many times more or less than it did."""


@dataclass(frozen=True)
class Weight:
    """Parts of the program whose difference is what a weight counts; what a unit of that cost, in lookups."""

    more: str
    less: str
    cost: float
    units: str = ""
    """Another part that has these units, where they do not differ."""


WEIGHTS = {
    ("PARTS_OF_POINTS", "detect.c"): Weight("planes_near", "", 0.51),
    ("PARTS_OF_CELLS", "detect.c"): Weight("cells_near", "", 0.77),
    ("PARTS_OF_LAYER", "gather.c"): Weight("planes_in", "planes_near", 0.67),
    ("PARTS_OF_LANE", "layers.c"): Weight("cells_in", "cells_near", 0.68),
    ("PARTS_OF_PLANE", "layers.c"): Weight("meeting_in", "cells_in", 0.53),
    ("PARTS_OF_PLANE", "measure.c"): Weight("hits_on_planes", "no_hits_on_planes", 0.62),
    ("PARTS_OF_LOOKUP", "measure.c"): Weight("hits_in_cells", "no_hits_in_cells", 0.59),
    ("PARTS_OF_RELATED", "measure.c"): Weight("relate", "", 0.49),
    ("PARTS_OF_LED", "measure.c"): Weight("lead", "", 0.21),
    ("PARTS_OF_SWEEP", "measure.c"): Weight("join", "", 0.68),
    ("PARTS_OF_AGREED", "measure.c"): Weight("agree", "", 0.39),
    ("PARTS_OF_HALVES", "measure.c"): Weight("share", "", 0.44),
    ("PAIRS_OF_PART", "answer.c"): Weight("answer_resolved", "answer_of_none", 1.12),
    ("PARTS_OF_LANE", "depth_along.c"): Weight("count_lanes", "count_known", 0.53),
    ("PARTS_OF_PLACE", "depth_along.c"): Weight("count_full", "count_lanes", 0.74),
    ("PARTS_OF_HALF", "depth_along.c"): Weight("count_halves", "count_known", 0.78),
}  # fmt: skip
"""Of each (name, file). The costs are those of gcc 12: a weight that is half or twice what it is fails."""


def compile_core(folder: Path) -> dict[str, Path]:
    """Objects of the core and of the program, by the names of their sources."""
    made = {}
    for source in [*sorted(CONTACT.glob("*.c")), Path(__file__).with_name("work_units.c")]:
        made[source.name] = folder / f"{source.stem}.o"
        includes = [f"-I{ROOT / name}" for name in ("firmware", "tests/unit")]
        to = str(made[source.name])
        words = ["gcc", *FLAGS, SCALAR, *includes, "-c", str(source), "-o", to]
        subprocess.run(words, check=True)
    return made


def count_units(objects: Mapping[str, Path], folder: Path) -> dict[str, tuple[int, float]]:
    """Instructions and units of each part."""
    program, counts = folder / "work_units", folder / "counts"
    archives = [ROOT / f"build/gcc/lib{name}.a" for name in ("helpers", "crease")]
    made = map(str, (*objects.values(), *archives))
    subprocess.run(["gcc", *made, "-lcmocka", "-lm", "-o", str(program)], check=True)
    words = [
        "valgrind",
        "-q",
        "--tool=callgrind",
        "--instr-atstart=no",
        f"--callgrind-out-file={counts}",
    ]
    said = subprocess.run([*words, str(program)], check=True, capture_output=True, text=True).stdout
    units = {name: float(count) for name, count in (line.split() for line in said.splitlines())}
    found = {}
    for path in folder.glob("counts.*"):
        text = path.read_text("ascii")
        part, total = PART.search(text), TOTAL.search(text)
        if part is not None and total is not None:
            found[part[1]] = (int(total[1]), units[part[1]])
        path.unlink()
    return found


def cost_of(weight: Weight, parts: Mapping[str, tuple[int, float]]) -> float:
    """What a unit costs, in lookups of 16 points; no units: endless."""
    more, less = parts[weight.more], parts[weight.less] if weight.less else (0, 0)
    units = parts[weight.units][1] if weight.units else more[1] - less[1]
    return (more[0] - less[0]) / units / parts["lookup"][0] if units > 0 else float("inf")


def is_as_before(weight: Weight, cost: float) -> bool:
    """Whether a unit costs about what it did."""
    return weight.cost / ROOM <= cost <= weight.cost * ROOM
