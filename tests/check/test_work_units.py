"""Units of work cost what they did: the weights that they are counted with stand for instructions."""

from __future__ import annotations

from pathlib import Path

import pytest
from work_units import WEIGHTS, Weight, compile_core, cost_of, count_units, is_as_before

Parts = dict[str, tuple[int, float]]


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory) -> Parts:
    folder: Path = tmp_path_factory.mktemp("work_units")
    return count_units(compile_core(folder), folder)


@pytest.mark.slow
@pytest.mark.parametrize("weight", WEIGHTS, ids=lambda weight: "-".join(reversed(weight)))
def test_a_unit_costs_what_it_did(parts: Parts, weight: tuple[str, str]) -> None:
    cost = cost_of(WEIGHTS[weight], parts)
    assert is_as_before(WEIGHTS[weight], cost), cost


@pytest.mark.slow
def test_no_unit_costs_much_more_than_a_lookup(parts: Parts) -> None:
    """Else a step of a search would take longer than the lookups that it is bounded by."""
    assert max(cost_of(weight, parts) for weight in WEIGHTS.values()) < 1.5


def test_a_weight_that_is_doubled_or_halved_is_noticed() -> None:
    weight = Weight("more", "less", 0.5)
    for units, noticed in ((10, False), (5, True), (20, True)):
        cost = cost_of(weight, {"more": (6000, units), "less": (1000, 0), "lookup": (1000, 1)})
        assert is_as_before(weight, cost) is not noticed
    nothing = {"more": (6000, 0), "less": (1000, 0), "lookup": (1000, 1)}
    assert not is_as_before(weight, cost_of(weight, nothing))
