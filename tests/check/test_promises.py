"""`make promises` has no gap, and finds each kind of gap."""

from __future__ import annotations

from pathlib import Path

import evidence
import misra
import pytest
from promises import README, ROOT, Promise, blocks, gaps, main, read_promises

GOOD = read_promises()


def test_every_promise_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    status = main(["--count"])
    said = capsys.readouterr()
    assert status == 0, said.err
    assert len(GOOD) > 50


def test_the_table_names_every_promise(capsys: pytest.CaptureFixture[str]) -> None:
    main([])
    assert capsys.readouterr().out.count("\n| ") >= len(GOOD)


@pytest.mark.parametrize(
    ("says", "by", "why"),
    [
        ("Rigid and open", ("make lint",), "the page does not say so any more"),
        ("Both bodies are rigid", (), "no test shows it"),
        ("Both bodies are rigid", ("make sure",), "runs no such target"),
        ("Both bodies are rigid", ("tests/unit/test_none.c::x",), "no such file"),
        ("Both bodies are rigid", ("tests/unit/test_tick.c::tick_tocks",), "cmocka runs no such"),
        ("Both bodies are rigid", ("tests/host/test_units.py::test_none",), "no such test"),
    ],
)
def test_a_gap_is_found(says: str, by: tuple[str, ...], why: str) -> None:
    (line,) = gaps([*GOOD, Promise(README, says, by)])
    assert why in line


def test_a_paragraph_that_no_row_speaks_of_is_found(tmp_path: Path) -> None:
    for page in {p.page for p in GOOD}:
        (tmp_path / page).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / page).write_text((ROOT / page).read_text("utf-8"), "utf-8")
    with (tmp_path / README).open("a", encoding="utf-8") as file:
        file.write("\nIt also cooks coffee, in less than three minutes and without any heap.\n")
    (line,) = gaps(GOOD, tmp_path)
    assert "It also cooks coffee" in line


def test_blocks_are_paragraphs_tables_and_points() -> None:
    text = "# Head\n\nOne two three four five six seven eight nine.\n\n"
    text += "```sh\nten words that are code and are run by other tests\n```\n"
    text += "\n- a b c d e f g h i j\n- k l m n o p q r s t\n\nshort\n"
    assert [b.split()[0] for b in blocks(text)] == ["One", "-", "-"]


# -------------------------------------------------------------------------------------------------------- evidence


@pytest.mark.parametrize("mark", ["budgets", "poses", "fuzz"])
def test_figures_of_the_evidence_are_those_of_their_files(mark: str) -> None:
    page = (ROOT / "firmware/EVIDENCE.md").read_text("utf-8")
    assert evidence.between(page, mark) == evidence.PAGES["EVIDENCE.md"][mark]()


def test_every_block_of_the_evidence_is_filled() -> None:
    for name, marks in evidence.PAGES.items():
        page = (ROOT / "firmware" / name).read_text("utf-8")
        for mark in marks:
            assert evidence.between(page, mark).startswith("| "), f"{name}: {mark}"


def test_the_table_of_misra_has_the_rules_that_are_deviated_from() -> None:
    page = (ROOT / "firmware/MISRA.md").read_text("utf-8")
    rows = evidence.rows_of(misra.DEVIATIONS)
    assert [r for r in rows if f"| {r['rule']} | " not in page or r["reason"] not in page] == []


def test_a_page_without_its_marks_is_an_error() -> None:
    with pytest.raises(ValueError, match="no marks"):
        evidence.fill("nothing", "figures", "")
