"""Rows of the benchmark as a page and a table."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from crease.lab.setup import machine


@dataclass(frozen=True)
class Row:
    """One number beside its goal."""

    scene: str
    what: str
    goal: str
    measured: float
    kept: bool | None
    """None: there is no goal for it here."""

    @classmethod
    def most(cls, scene: str, what: str, goal: float, measured: float, asked: bool = True) -> Row:
        """At most `goal`."""
        return cls(scene, what, f"<= {goal:.3g}", measured, measured <= goal if asked else None)

    @classmethod
    def least(cls, scene: str, what: str, goal: float, measured: float) -> Row:
        """At least `goal`."""
        return cls(scene, what, f">= {goal:.3g}", measured, measured >= goal)


LEAST = "least motion"
SECTION = "\n## Beside other methods\n"
WORDS = {True: "kept", False: "**missed**", None: ""}
HEAD = """# Six degrees of freedom, measured

    make bench-six                      # 25 minutes; writes this page, six.csv and six_methods.csv
    PYTHONPATH=tests/bench .venv/bin/python tests/bench/six_bench.py --renew NAME ...   # these scenes alone

Scenes, paths and exact wrenches: [meshes/six](../../meshes/six/README.md); what is judged and how is said there.
Where goals are missed, and why where that is known: [DESIGN.md](../../firmware/couple/DESIGN.md#not-there-yet).
Inside is judged at every 4th tick, by hand at every 32nd. Energy below 0 is lost, not given: the goal says nothing of
it. "Least motion" is the held tool followed over the meshes themselves, in double (`six_least.py`), where the change at
half the step is missed: where that jumps as well, the scene does, as what is held outside may come free at once. Ticks
are the least of three runs; goals of their time are those of the peg and the cylinder. Not measured here: the
Cortex-M7, ten minutes at rest (here 1 s), strokes and hands with friction.
"""


def number(value: float) -> str:
    """Three digits."""
    if not math.isfinite(value):
        return str(value)
    return f"{value:.0f}" if value == int(value) and abs(value) < 1e6 else f"{value:.3g}"


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Markdown."""
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)]) + "\n"


def page(rows: Sequence[Row]) -> str:
    """What SIX.md holds."""
    asked = [r for r in rows if r.kept is not None]
    missed = [r for r in asked if not r.kept]
    text = f"{HEAD}\n{machine()}.\n\n{len(asked) - len(missed)} of {len(asked)} goals are kept.\n\n## Missed\n\n"
    heads = ("scene", "what", "goal", "measured", "")
    text += (
        table(heads[:4], [(r.scene, r.what, r.goal, number(r.measured)) for r in missed])
        if missed
        else "None.\n"
    )
    beside = [(r.scene, r.what, number(r.measured)) for r in rows if LEAST in r.what]
    if beside:
        text += f"\n## Beside {LEAST}\n\n" + table(("scene", "what", "measured"), beside)
    text += "\n## All\n\n"
    text += table(
        heads,
        [
            (
                r.scene,
                r.what,
                r.goal if r.kept is not None else "",
                number(r.measured),
                WORDS[r.kept],
            )
            for r in rows
        ],
    )
    return text


def write(folder: Path, rows: Sequence[Row], more: str = "") -> None:
    """SIX.md and six.csv."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "SIX.md").write_text(page(rows) + more, encoding="utf-8")
    with (folder / "six.csv").open("w", encoding="utf-8", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(("scene", "what", "goal", "measured", "kept"))
        for r in rows:
            out.writerow(
                (
                    r.scene,
                    r.what,
                    r.goal,
                    f"{r.measured:.6g}",
                    {True: "yes", False: "no", None: ""}[r.kept],
                )
            )


def read(file: Path) -> list[Row]:
    """What write() wrote in six.csv."""
    kept = {"yes": True, "no": False, "": None}
    with file.open(encoding="utf-8", newline="") as rows:
        return [
            Row(r["scene"], r["what"], r["goal"], float(r["measured"]), kept[r["kept"]])
            for r in csv.DictReader(rows)
        ]


def put(folder: Path, rows: Sequence[Row]) -> None:
    """Rows of whole scenes in the place of those that SIX.md and six.csv have of them; the rest as it is."""
    scenes = {r.scene for r in rows}
    there = read(folder / "six.csv")
    all_rows: list[Row] = []
    for name in dict.fromkeys(r.scene for r in there):
        all_rows += [r for r in (rows if name in scenes else there) if r.scene == name]
    _, section, more = (folder / "SIX.md").read_text(encoding="utf-8").partition(SECTION)
    write(folder, all_rows, section + more)


def renew(folder: Path, section: str) -> None:
    """The section of other methods in the page that is there."""
    file = folder / "SIX.md"
    head = file.read_text(encoding="utf-8").split(SECTION)[0] if file.exists() else ""
    file.write_text(head + section, encoding="utf-8")
