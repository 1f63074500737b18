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
        ("this one", 63.25, 72.9, 920.0, True, 1225),
        ("default EMCY identifiers", 63.25, 72.9, 1900.0, False, 825),
        ("one torque frame per axis", 80.25, 87.3, 2940.0, False, 650),
        ("CAN FD, 1 and 5 Mbit/s", 31.33, 35.8, 460.8, True, 2425),
    ],
)
def test_layouts_cost_what_the_design_says(
    layout: str, cyclic: float, total: float, last_us: float, feasible: bool, rate_Hz: int
) -> None:
    items = LAYOUTS[layout]
    assert 100 * schedule.load(items, cyclic_only=True) == pytest.approx(cyclic, abs=0.006)
    assert 100 * schedule.load(items) == pytest.approx(total, abs=0.06)
    assert schedule.worst_cyclic_us(items) == pytest.approx(last_us)
    assert schedule.feasible(items) is feasible
    assert schedule.highest_rate_Hz(items) == rate_Hz


def test_can_fd_frame_costs_what_its_bits_add_up_to() -> None:
    """12 bytes: 34 nominal bits; ESI 1, DLC 4, data 96, stuff 25, stuff count 4, CRC 17, fixed stuff 6 at 5 Mbit/s."""
    assert schedule.fd_frame_us(12) == pytest.approx(34 + (1 + 4 + 96 + 25 + 4 + 17 + 6) * 0.2)
    assert schedule.fd_frame_us(0) == pytest.approx(34 + (1 + 4 + 0 + 1 + 4 + 17 + 6) * 0.2)
    assert schedule.fd_frame_us(64) == pytest.approx(34 + (5 + 512 + 129 + 4 + 21 + 7) * 0.2)
    with pytest.raises(ValueError, match="9 bytes"):
        schedule.fd_frame_us(9)


def test_schedule_survives_one_bus_error_in_ten_milliseconds() -> None:
    assert schedule.feasible(LAYOUTS["this one"], 10_000)
    assert schedule.compute_budget_us(LAYOUTS["this one"]) == 425.0


@pytest.mark.parametrize("layout", list(LAYOUTS))
def test_critical_instant_reaches_the_bound_exactly(layout: str) -> None:
    items = LAYOUTS[layout]
    for at, found in enumerate(schedule.analyse(items)):
        seen_us = schedule.simulate_critical(items, at, 200_000.0)
        assert seen_us == pytest.approx(found.response_us, rel=1e-12), found.name


@pytest.mark.parametrize("layout", list(LAYOUTS))
@pytest.mark.parametrize("seed", range(8))
def test_no_random_run_exceeds_the_bound(layout: str, seed: int) -> None:
    items = LAYOUTS[layout]
    bounds = {found.name: found.response_us for found in schedule.analyse(items)}
    for name, seen_us in schedule.simulate(items, 1e6, seed).items():
        bound = bounds[name]
        assert bound is not None
        assert 0.0 < seen_us <= bound * (1 + 1e-12), name


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
