"""firmware/contact/CONSTANTS.md names every empirical constant of the contact core with the value that it has."""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests" / "bench")]

from constants import PAGE, find_constants, row_of  # noqa: E402

ROW = re.compile(r"^\| `(\w+)` \(([\w.]+)\) \| (\S+) \| (.*?) \| (.*?) \| (.*?) \|$", re.MULTILINE)


def test_the_page_has_every_constant_with_its_value_and_its_reason() -> None:
    told = {
        (name, file): (value, why)
        for name, file, value, why, _, _ in ROW.findall(PAGE.read_text("utf-8"))
    }
    assert told == {(c.name, c.file): (c.value, c.why.strip()) for c in find_constants()}


def test_every_constant_has_a_reason() -> None:
    assert [f"{c.file}: {c.name}" for c in find_constants() if len(c.why) < 20] == []


def test_a_constant_that_changes_is_noticed(tmp_path: Path) -> None:
    (tmp_path / "way_out.h").write_text(
        "/* How far a piece of face reaches, in half-widths. */\n#define REACH 1.82f\n"
    )
    (made,) = find_constants(tmp_path)
    assert (made.name, made.value, made.scaled(2.0)) == ("REACH", "1.82", "3.64000000e+00f")
    assert row_of(made, ["nothing", "nothing"]) not in PAGE.read_text("utf-8")
