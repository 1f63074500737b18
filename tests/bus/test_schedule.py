"""Response times: the analysis against an event simulation, and against published numbers."""

from __future__ import annotations

import random
import re
import tomllib
from pathlib import Path

import pytest
from crease.bus import schedule
from crease.bus.dictionary import Message, load
from crease.loop.hil import DEADLINE_NS

ROOT = Path(__file__).resolve().parents[2]

LAYOUTS = schedule.layouts(load())
BOUNDED = [name for name in LAYOUTS if name != "six axes, classical"]
"""That one asks for more than all of the bus."""


def test_frame_bits_are_those_of_the_worst_stuffing() -> None:
    assert [schedule.frame_bits(n) for n in (0, 1, 2, 3, 6, 8)] == [55, 65, 75, 85, 115, 135]


@pytest.mark.parametrize(
    ("layout", "cyclic", "total", "last_us", "feasible", "rate_Hz"),
    [
        ("this one", 63.25, 75.6, 920.0, True, 1225),
        ("default EMCY identifiers", 63.25, 75.6, 1900.0, False, 825),
        ("one torque frame per axis", 80.25, 90.0, 2940.0, False, 650),
        ("CAN FD, 1 and 5 Mbit/s", 31.33, 36.9, 460.8, True, 2425),
        ("six axes, CAN FD", 44.48, 53.28, 566.0, True, 1750),
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


def test_six_axes_fit_into_fd_frames_and_not_into_classical_ones() -> None:
    """By hand. FD: 34 nominal bits, and at 5 Mbit/s ESI 1, DLC 4, data, stuff, count 4, CRC 17, 6 fixed stuff bits.

    Classical: SYNC 55, six states of 135, two torque frames of 115 are over a period by themselves.
    """
    sync_us, state_us = 34 + (5 + 0 + 1 + 27) * 0.2, 34 + (5 + 64 + 17 + 27) * 0.2
    torque_us, beat_us = 34 + (5 + 96 + 25 + 27) * 0.2, 34 + (5 + 8 + 3 + 27) * 0.2
    cost = {item.name: item.cost_us for item in LAYOUTS["six axes, CAN FD"]}
    assert cost["SYNC"] == pytest.approx(sync_us)
    assert cost["TORQUE"] == pytest.approx(torque_us)
    assert cost["HEARTBEAT_ROLL"] == pytest.approx(beat_us)
    states = [name for name in cost if name.startswith("STATE")]
    assert len(states) == 6
    assert all(cost[name] == pytest.approx(state_us) for name in states)
    assert "WRIST" not in cost
    found, quiet = schedule.six_cycle(load()), sync_us + 20 + 6 * state_us
    assert found.states_us == pytest.approx(quiet)
    assert found.answers_us == pytest.approx(quiet + 3 * beat_us)
    assert found.deadline_us == 550
    assert found.budget_us == pytest.approx(1000 - quiet - 3 * beat_us - torque_us)
    assert found.bridged_us == pytest.approx(550 + beat_us + torque_us)
    assert schedule.feasible(LAYOUTS["six axes, CAN FD"], 10_000)
    classical = LAYOUTS["six axes, classical"]
    assert 55 + 6 * 135 + 2 * 115 > 1000
    assert 1000 * schedule.load(classical, cyclic_only=True) == pytest.approx(
        55 + 6 * 135 + 2 * 115
    )
    assert not schedule.feasible(classical)
    assert len({item.cob for item in classical}) == len(classical)


def test_schedule_survives_one_bus_error_in_ten_milliseconds() -> None:
    assert schedule.feasible(LAYOUTS["this one"], 10_000)


@pytest.mark.parametrize("layout", BOUNDED)
def test_critical_instant_reaches_the_bound_exactly(layout: str) -> None:
    items = LAYOUTS[layout]
    for at, found in enumerate(schedule.analyse(items)):
        seen_us = schedule.simulate_critical(items, at, 200_000.0)
        assert seen_us == pytest.approx(found.response_us, rel=1e-12), found.name


@pytest.mark.parametrize("layout", BOUNDED)
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


# ---------------------------------------------------------------------------------------- one period while torque flows


def last_state_us(beats: list[float], host_beat: bool = False) -> float:
    """When the third state is through: heartbeats of 65 bits ready at `beats`, SYNC at 0, drives 20 us after its end.

    Arbitration played out by hand, one frame after the other; the host's heartbeat stands in its queue before SYNC.
    """
    host = [65.0, 55.0] if host_beat else [55.0]
    ready, waiting, now, states = sorted(beats), [], min([0.0, *beats]), 0
    sync_end = None
    while True:
        waiting = [t for t in ready if t <= now]
        if sync_end is not None and now >= sync_end + 20.0:
            now += 135.0
            states += 1
            if states == 3:
                return now
        elif sync_end is None and now >= 0.0:
            now += host.pop(0)
            sync_end = now if not host else None
        elif waiting:
            ready.remove(waiting[0])
            now += 65.0
        else:
            ends = [t for t in (*ready, 0.0 if sync_end is None else sync_end + 20.0) if t > now]
            now = min(ends)


def test_period_while_torque_flows_is_the_sum_of_its_phases() -> None:
    """55 + 20 + 3 x 135; a heartbeat (65) before SYNC, one after it, the host's own; one before TORQUE (115)."""
    found = schedule.cycle(load())
    assert found.states_us == 55 + 20 + 3 * 135
    assert found.answers_us == 480 + 65 + 65 + 65
    assert found.deadline_us == 700
    assert found.budget_us == 1000 - (480 + 65 + 65) - 65 - 115
    assert found.budget_quiet_us == 1000 - 480 - 115
    assert found.bridged_us == 700 + 115 + 115 < 1000


def test_no_phase_of_the_heartbeats_delays_the_states_beyond_the_bound() -> None:
    found, dice = schedule.cycle(load()), random.Random(5)
    assert last_state_us([]) == found.states_us
    worst = 0.0
    for _ in range(20_000):
        host_beat = dice.random() < 0.5
        seen = last_state_us([dice.uniform(-70.0, 200.0) for _ in range(3)], host_beat)
        assert seen <= found.answers_us
        worst = max(worst, seen)
    assert worst > found.answers_us - 10.0, "and the bound is no larger than it has to be"


def test_every_loop_waits_for_the_states_as_long_as_the_schedule_says() -> None:
    deadline_us = schedule.cycle(load()).deadline_us
    assert 1000 * deadline_us == DEADLINE_NS
    controller = (ROOT / "firmware/port/cortex-m7/controller.c").read_text(encoding="ascii")
    found = re.search(r"#define DEADLINE_NS (\d+)u", controller)
    assert found is not None
    assert int(found[1]) == 1000 * deadline_us
    device = tomllib.loads((ROOT / "firmware/port/linux/device.toml").read_text(encoding="ascii"))
    assert device["loop"]["deadline_us"] == deadline_us
