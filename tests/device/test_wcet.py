"""`make wcet`: the table is of the sources, and a listing is read as it stands. What is compiled: wcet_of_code.py."""

from __future__ import annotations

from pathlib import Path

import flow
import pytest
from longest import BoundError, NamedLoop, Programme, read
from wcet import TABLE, Constants, exceeded, read_table

LISTING = """
00008000 <hand>:
    8000:\tb510      \tpush\t{r4, lr}
    8002:\t2408      \tmovs\tr4, #8
    8004:\tb110      \tcbz\tr0, 800c <hand+0xc>
    8006:\tf000 f804 \tbl\t8012 <leaf>
    800a:\te000      \tb.n\t800e <hand+0xe>
    800c:\tbf00      \tnop
    800e:\t3c01      \tsubs\tr4, #1
    8010:\td1f8      \tbne.n\t8004 <hand+0x4>
    8011:\tbd10      \tpop\t{r4, pc}

00008012 <leaf>:
    8012:\t3000      \tadds\tr0, #0
    8014:\t4770      \tbx\tlr
"""


def test_listing_has_the_bound_that_is_counted_by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """Eight times round by the call: 3 + 8 (5 + 2)."""
    monkeypatch.setattr(
        flow, "output_of", lambda words, _said=None: LISTING if "-d" in words else ""
    )

    def eight(_loop: NamedLoop, _copy: tuple[str, str]) -> float:
        return 8.0

    code = read(Path("hand.elf"), ["hand"])
    assert [loop.name for loop in code.loops] == ["hand/library #1"]
    assert Programme(code, "hand", {}, eight).longest().instructions == 3 + 8 * (5 + 2)


def test_constants_are_those_of_the_sources() -> None:
    constants = Constants({"GROUPS": 421})
    assert constants.value("CR_LANES") == 16
    assert constants.value("16 * GROUPS") == 16 * 421
    assert constants.value("relate.c:SWEEPS + resolve.c:SWEEPS") == 32 + 32
    assert constants.value("CR_WAY_EXITS_MAX") == 12
    assert constants.but(CR_KIND_FACETS_MAX=3).value("CR_WAY_EXITS_MAX") == 9
    for wrong in ("SWEEPS", "NOBODY", "relate.c:CR_LANES", "CR_LANES; 1"):
        with pytest.raises(BoundError):
            constants.value(wrong)


def test_each_row_of_the_table_has_its_reason_and_a_value() -> None:
    table, constants = read_table(), Constants({"GROUPS": 421})
    for kind in ("bound", "library", "fact", "work"):
        assert all(row["why"] for row in table.rows[kind]), f"{TABLE}: {kind}"
    assert all(constants.value(row["most"]) > 0 for row in table.rows["bound"])
    loops = [name for row in table.rows["bound"] for name in row["loops"]]
    assert len(loops) == len(set(loops))


def test_tick_that_exceeds_the_bound_is_said() -> None:
    assert exceeded(1000, {"a": 999, "b": 1000}) == []
    assert exceeded(1000, {"a": 999, "b": 1001}) == [
        "b: 1,001 instructions were measured, 1,000 derived"
    ]
