"""Response times: the analysis against an event simulation, and against published numbers."""

from __future__ import annotations

import pytest
from crease.bus import schedule
from crease.bus.dictionary import Message, load

LAYOUTS = schedule.layouts(load())


def test_frame_bits_are_those_of_the_worst_stuffing() -> None:
    assert [schedule.frame_bits(n) for n in (0, 1, 2, 3, 6, 8)] == [55, 65, 75, 85, 115, 135]


@pytest.mark.parametrize(
    ("layout", "cyclic", "total", "last_us", "feasible", "rate_Hz"),
    [
        ("this one", 57.5, 67.1, 805.0, True, 1225),
        ("default EMCY identifiers", 57.5, 67.1, 1650.0, False, 825),
        ("one torque frame per axis", 74.5, 81.6, 2060.0, False, 700),
    ],
)
def test_layouts_cost_what_the_design_says(
    layout: str, cyclic: float, total: float, last_us: float, feasible: bool, rate_Hz: int
) -> None:
    items = LAYOUTS[layout]
    assert round(100 * schedule.load(items, cyclic_only=True), 1) == cyclic
    assert round(100 * schedule.load(items), 1) == total
    assert schedule.worst_cyclic_us(items) == last_us
    assert schedule.feasible(items) is feasible
    assert schedule.highest_rate_Hz(items) == rate_Hz


def test_schedule_survives_one_bus_error_in_ten_milliseconds() -> None:
    assert schedule.feasible(LAYOUTS["this one"], 10_000)
    assert schedule.compute_budget_us(LAYOUTS["this one"]) == 425.0


@pytest.mark.parametrize("layout", list(LAYOUTS))
def test_critical_instant_reaches_the_bound_exactly(layout: str) -> None:
    items = LAYOUTS[layout]
    for at, found in enumerate(schedule.analyse(items)):
        assert schedule.simulate_critical(items, at, 200_000.0) == found.response_us, found.name


@pytest.mark.parametrize("layout", list(LAYOUTS))
@pytest.mark.parametrize("seed", range(8))
def test_no_random_run_exceeds_the_bound(layout: str, seed: int) -> None:
    items = LAYOUTS[layout]
    bounds = {found.name: found.response_us for found in schedule.analyse(items)}
    for name, seen_us in schedule.simulate(items, 1e6, seed).items():
        bound = bounds[name]
        assert bound is not None
        assert 0.0 < seen_us <= bound, name


def test_second_instance_in_a_busy_period_can_be_the_worst() -> None:
    """Davis et al., table 2: 125 kbit/s in units of ms; the first instance of C answers in 3.0, the second in 3.5."""
    items = [
        schedule.Timing("A", 1, 1.0, 2.5, 0.0, True),
        schedule.Timing("B", 2, 1.0, 3.5, 0.0, True),
        schedule.Timing("C", 3, 1.0, 3.5, 0.0, True),
    ]
    found = [schedule.response(items, at, bit_us=0.001) for at in range(3)]
    assert found == [2.0, 3.0, 3.5]


def test_overloaded_bus_has_no_bound() -> None:
    messages = [Message(f"M{i}", i, 8, 250, 0, True) for i in range(3)]
    items = schedule.timings(messages)
    assert schedule.analyse(items)[-1].response_us is None
    assert not schedule.feasible(items)
