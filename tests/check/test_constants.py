"""firmware/contact/CONSTANTS.md has every empirical constant of the contact core with its value, range and guard."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests" / "bench"), str(ROOT / "tests" / "golden")]

import test_golden  # noqa: E402
from constants import LINE, PAGE, Constant, find_constants, row_of  # noqa: E402
from guards import main as show  # noqa: E402
from ranges import ENDS, GOLDEN, WORK, Guard, by_constant, read_guards  # noqa: E402
from work_units import WEIGHTS  # noqa: E402

GUARDS = by_constant(read_guards())
CONSTANTS = find_constants()
UNGUARDED_ENDS = {
    ("SWEEPS", "high"),
}
"""Ends without a test: sweeps beyond those that converge are not made."""


def is_test(test: str) -> bool:
    """Whether there is such a test."""
    path, _, name = test.partition("::")
    text = (ROOT / path).read_text("utf-8") if (ROOT / path).is_file() else ""
    if path.endswith(".c"):
        return (
            re.search(rf"^        cmocka_unit_test(_setup)?\({name}[,)]", text, re.MULTILINE)
            is not None
        )
    function, _, parameter = test.removesuffix("]").partition("[")
    if function == GOLDEN:
        return tuple(parameter.split("-")) in set(test_golden.read_bounds())
    return function == WORK and tuple(reversed(parameter.split("-"))) in WEIGHTS


def test_the_page_has_every_constant_with_all_that_is_told_of_it() -> None:
    told = LINE.findall(PAGE.read_text("utf-8"))
    lines = {line for line in PAGE.read_text("utf-8").splitlines() if line.startswith("| `")}
    assert len(lines) == len(told) == len(CONSTANTS)
    cells = {(name, file): rest[-2:] for name, file, *rest in told}
    assert lines == {row_of(c, GUARDS[c.name, c.file], cells[c.name, c.file]) for c in CONSTANTS}


def test_every_constant_has_a_reason() -> None:
    assert [f"{c.file}: {c.name}" for c in CONSTANTS if len(c.why) < 20] == []


def test_every_constant_has_a_guard_and_every_guard_a_constant() -> None:
    assert set(GUARDS) == {(c.name, c.file) for c in CONSTANTS}
    assert len(read_guards()) == len(GUARDS)


@pytest.mark.parametrize("constant", CONSTANTS, ids=lambda c: f"{c.file}-{c.name}")
def test_a_constant_lies_within_its_range_and_tests_hold_it_there(constant: Constant) -> None:
    guard, value = GUARDS[constant.name, constant.file], float(constant.value)
    bare = {
        (guard.name, which) for which, end in zip(ENDS, guard.ends, strict=True) if not end.test
    }
    assert bare <= UNGUARDED_ENDS
    assert len(bare) < 2
    assert all(end.why for end in guard.ends if not end.test)
    assert all(is_test(end.test) for end in guard.ends if end.test)
    low, high = guard.ends
    assert low.value is None or low.value <= value
    assert high.value is None or value <= high.value
    if low.test:
        assert low.value is not None
        assert low.fails is not None
        assert value / 3.0 <= low.fails < low.value
    if high.test:
        assert high.value is not None
        assert high.fails is not None
        assert high.value < high.fails <= 2.001 * value


def test_no_guard_is_taken_for_a_test_that_is_not_there() -> None:
    assert is_test("tests/unit/test_resolve.c::resolve_ends")
    assert not is_test("tests/unit/test_resolve.c::resolve_end")
    assert not is_test("tests/unit/test_related.c::resolve_ends")
    assert is_test(f"{GOLDEN}[bar_u-amplification]")
    assert not is_test(f"{GOLDEN}[bar_u-colour]")
    assert is_test(f"{WORK}[detect.c-PARTS_OF_CELLS]")
    assert not is_test(f"{WORK}[detect.c-PARTS_OF_PLAY]")


@pytest.mark.slow
def test_a_guard_is_seen_to_fail(capsys: pytest.CaptureFixture[str]) -> None:
    """Of one constant; of all: tests/bench/guards.py."""
    assert show(["--only", "MINOR"]) == 0
    assert capsys.readouterr().out.endswith("1 constants, 0 not as claimed\n")


def test_a_constant_that_changes_is_noticed(tmp_path: Path) -> None:
    (tmp_path / "way_out.h").write_text(
        "/* How far a piece of face reaches, in half-widths. */\n#define REACH 1.82f\n"
    )
    (made,) = find_constants(tmp_path)
    assert (made.name, made.value, made.scaled(2.0)) == ("REACH", "1.82", "3.64000000e+00f")
    guard: Guard = GUARDS["MINOR", "relate.c"]
    assert row_of(made, guard, ["nothing", "nothing"]) not in PAGE.read_text("utf-8")
