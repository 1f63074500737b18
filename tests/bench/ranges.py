"""The ranges of the empirical constants and the tests that guard them: tests/bench/constants_guards.toml, read."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

TABLE = Path(__file__).with_name("constants_guards.toml")
GOLDEN = "tests/golden/test_golden.py::test_figure_stays_within_its_bound"
WORK = "tests/check/test_work_units.py::test_a_unit_costs_what_it_did"
ENDS = ("low", "high")


@dataclass(frozen=True)
class End:
    """An end of a range: the test passes at `value` and fails at `fails`; or the reason why there is no test."""

    value: float | None
    fails: float | None
    test: str
    why: str

    @property
    def short(self) -> str:
        """The test, as the page has it."""
        path, _, name = self.test.partition("::")
        return f"`{Path(path).name}` {name.removeprefix('test_figure_stays_within_its_bound')}"


@dataclass(frozen=True)
class Guard:
    """What is claimed about a constant."""

    name: str
    file: str
    low: End
    high: End

    @property
    def ends(self) -> tuple[End, End]:
        """Both."""
        return self.low, self.high

    @property
    def range(self) -> str:
        """As the page has it."""
        ends = (f"{end.value:g}" if end.value is not None else "" for end in self.ends)
        low, high = (end.replace("e-0", "e-") for end in ends)
        if low and high:
            told = f"{low} alone" if low == high else f"{low} to {high}"
        else:
            told = f"from {low}" if low else f"to {high}"
        return "; ".join([told, *(end.why for end in self.ends if end.why)])

    @property
    def tests(self) -> str:
        """As the page has them."""
        return "; ".join(dict.fromkeys(end.short for end in self.ends if end.test))


def read_guards(path: Path = TABLE) -> list[Guard]:
    """The claims, in the order of the table."""
    found = []
    for row in tomllib.loads(path.read_text("utf-8"))["guard"]:
        ends = []
        for end in ENDS:
            bare = end not in row or f"{end}_why" in row
            test = "" if bare else row.get(f"{end}_test", row.get("test", ""))
            ends.append(End(row.get(end), row.get(f"{end}_fails"), test, row.get(f"{end}_why", "")))
        found.append(Guard(row["name"], row["file"], *ends))
    return found


def by_constant(guards: Iterable[Guard]) -> dict[tuple[str, str], Guard]:
    """Of each (name, file)."""
    return {(guard.name, guard.file): guard for guard in guards}
