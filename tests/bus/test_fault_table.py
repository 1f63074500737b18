"""A short cut of `make bench-faults`: every kind of fault at four ticks of a contact, held against its rule."""

from __future__ import annotations

from pathlib import Path

import pytest
from crease.base.scene import open_scene
from faults import KINDS, Outcome, table

ROOT = Path(__file__).resolve().parents[2]
EVERY = 500


@pytest.fixture(scope="module")
def outcomes() -> dict[str, Outcome]:
    """Every kind, from one loop."""
    return table(open_scene(ROOT / "build" / "scenes" / "wall_cube.crs"), EVERY, 2.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_fault_in_contact_keeps_its_rule(outcomes: dict[str, Outcome], name: str) -> None:
    found, rule = outcomes[name], KINDS[name].rule
    assert found.runs == 4
    assert not found.wrong
    assert found.bad_frames == 0
    if rule.faults and rule.always:
        assert found.faulted == found.runs
        assert found.recovered == 1, "comes back on clear"
    elif not rule.faults:
        assert found.faulted == 0
