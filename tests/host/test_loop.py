"""The closed loop as an instrument: it is the loop of `crease hil`, agrees with theory, and what it says of creases."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
from crease.base.errors import CreaseError
from crease.base.native import lib
from crease.base.scene import Scene, open_scene
from crease.bus.drives import Fault, Frame
from crease.draw.plot import NOTICEABLE_TURN_DEG
from crease.loop import hil
from crease.loop.loop import (
    FIRM_GRIP,
    LIGHT_GRIP,
    Setup,
    at_speed,
    bound_N_m,
    hold,
    largest_stiffness,
    open_loop,
    settles,
)
from crease.loop.places import cases, pad_scene, press_N
from crease.replay.measures import buzz_m_s2, buzz_worst_m_s2, force_steps, loop_energy
from crease.replay.recording import RECORD
from crease.replay.trajectory import load_trajectory
from frame_by_frame import FrameByFrame
from host_tools import write_path
from loop_contact import BUILD, drag_case, linear_setup

# ------------------------------------------------------------------------------------------------------- measures


def test_buzz_is_the_rms_of_its_band() -> None:
    t_s = np.arange(4000) * 1e-3
    inside, outside = np.sin(2 * np.pi * 60 * t_s), np.sin(2 * np.pi * 5 * t_s)
    middle = (t_s > 1.0) & (t_s < 3.0)
    along = np.column_stack([inside, outside, np.zeros_like(t_s)])
    assert buzz_m_s2(along, middle) == pytest.approx(np.sqrt(0.5), rel=2e-3)
    assert buzz_worst_m_s2(along, middle) == pytest.approx(np.sqrt(0.5), rel=2e-3)


def test_slow_swing_of_the_hand_is_no_buzz_however_it_ends() -> None:
    t_s = np.arange(3456) * 1e-3
    swing = np.column_stack([np.sin(2 * np.pi * 1.1 * t_s)] * 3)
    assert buzz_m_s2(swing) < 2e-3


def test_loop_energy_of_a_spring_is_nothing_of_a_damper_less_and_of_a_whirl_its_area() -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 2001)
    ring_m = 1e-3 * np.column_stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)])
    k = 1000.0
    stored_J = 0.5 * k * 1e-6
    assert loop_energy(-k * ring_m, ring_m, k) == pytest.approx(0.0, abs=1e-9)
    speed = np.gradient(ring_m, turn, axis=0)
    assert loop_energy(-100.0 * speed, ring_m, 100.0) == pytest.approx(
        -100.0 * 2.0 * np.pi * 1e-6 / (0.5 * 100.0 * 1e-6), rel=1e-3
    )
    whirl = k * np.column_stack([-ring_m[:, 1], ring_m[:, 0], ring_m[:, 2]])
    assert loop_energy(whirl, ring_m, k) * stored_J == pytest.approx(
        k * 2.0 * np.pi * 1e-6, rel=1e-5
    )
    assert loop_energy(0.0 * ring_m, ring_m, k) == 0.0


def test_force_steps_are_shares_of_the_larger_force() -> None:
    force_N = np.array([[0.0, 0.0, 2.0], [0.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, 0.1, 0.0]])
    found = force_steps(force_N, 0.5)
    assert found == pytest.approx([0.5, 1.0 / np.sqrt(2.0), np.hypot(0.9, 1.0) / np.sqrt(2.0)])
    assert force_steps(0.1 * force_N, 0.5).max() == 0.0


# ---------------------------------------------------------------------------------------------------------- loop


def test_bisection_finds_the_edge_and_says_when_there_is_none() -> None:
    assert largest_stiffness(lambda k: k < 1234.0, 100.0, 10000.0, 1.01) == pytest.approx(
        1234.0, rel=0.01
    )
    assert largest_stiffness(lambda _: False, 100.0, 10000.0) == 0.0
    assert largest_stiffness(lambda _: True, 100.0, 10000.0) == np.inf


def test_lock_step_in_c_is_the_loop_frame_by_frame_to_the_bit(
    folder: Path, scene_crs: Path
) -> None:
    """Also under faults, with a tick that takes time, and in what passed over the wire."""
    down = np.linspace([0.0, 0.0, 0.014], [0.0, 0.0, 0.006], 700)
    path = load_trajectory(write_path(folder / "down.csv", down))
    scene = open_scene(scene_crs)
    faults = [Fault("drop", 1280, 2, 1, id=0x192), Fault("silent", 1800, 20, axis=2)]
    loop = hil.Loop(scene, faults=faults, compute_ns=30_000)
    frames: list[tuple[float, Frame]] = []
    loop.on_frame = lambda at_s, frame: frames.append((at_s, frame))
    targets = hil.hand_targets(hil.resample(path), loop.config)
    lead = hil.lead_in(targets, loop.drives.state.tip_pos_m)
    loop.bring_up(lead)
    hand = [*lead.tolist(), *[lead[-1].tolist()] * (loop.ticks - len(lead))]
    loop.command(int(lib.CR_COMMAND_START))
    loop.run(targets)
    other = FrameByFrame(scene, faults, compute_ns=30_000)
    for target in hand:
        other.tick(target)
    lib.cr_servo_input(other.servo.c, lib.CR_COMMAND_START)
    for target in targets.tolist():
        other.tick(target)
    ours = loop.result()
    assert ours.recording.rows["areas"].any()
    assert ours.recording.rows["faults"].any()
    for name in set(RECORD.names or ()) - {"tick_ns", "wake_late_ns"}:
        assert ours.recording.rows[name].tobytes() == other.records[name].tobytes(), name
    assert ours.mechanism.tobytes() == other.mechanism.tobytes()
    assert frames == other.frames


def test_trouble_of_a_listener_stops_the_loop(scene_crs: Path) -> None:
    loop = hil.Loop(open_scene(scene_crs))

    def listen(_at_s: float, _frame: Frame) -> None:
        raise CreaseError("the disk is full")

    loop.on_frame = listen
    with pytest.raises(CreaseError, match="the disk is full"):
        loop.bring_up(np.zeros((1, 6)))


def test_unknown_names_are_refused(scene_crs: Path) -> None:
    scene = open_scene(scene_crs)
    for setup in (
        Setup(response="soft"),
        Setup(control={"speed": 1.0}),
        Setup(params={"hand": 1.0}),
        Setup(stiffness_N_m=-1.0),
    ):
        with pytest.raises(CreaseError):
            open_loop(scene, setup)


def test_path_at_another_speed_keeps_its_way_and_starts_smoothly(folder: Path) -> None:
    rows = np.linspace([0.0, 0.0, 0.0], [0.1, 0.0, 0.0], 1000)
    path = at_speed(load_trajectory(write_path(folder / "way.csv", rows)), 0.5)
    speed = np.diff(path.position_m[:, 0]) / np.diff(path.t_s)
    assert path.position_m[-1] == pytest.approx([0.1, 0.0, 0.0])
    assert np.median(speed) == pytest.approx(0.05, rel=0.01)
    assert np.abs(np.diff(speed)).max() < 1e-3


def radius_of_pad_m(folder: Path) -> float:
    """For another process, which cannot be sent a scene."""
    return float(pad_scene(folder, 3e-3).meta.tool_radius_m)


@pytest.mark.slow
def test_several_may_make_an_image_at_once(tmp_path: Path) -> None:
    """Each of its files is there whole or not at all: one process read a mesh that another had begun to write."""
    with ProcessPoolExecutor(4, mp_context=get_context("spawn")) as pool:
        assert len(set(pool.map(radius_of_pad_m, [tmp_path] * 8))) == 1


# --------------------------------------------------------------------------------------------------------- claims


@pytest.fixture(scope="module")
def pad() -> Scene:
    """The pad on the block."""
    return pad_scene(BUILD / "loop")


@pytest.mark.slow
@pytest.mark.parametrize("delay_s", [None, 0.0])
def test_flat_wall_settles_below_the_bound_and_not_above(pad: Scene, delay_s: float | None) -> None:
    case = cases()[0]
    setup = replace(
        linear_setup(LIGHT_GRIP, delay_s, False, "way_out"), base_from_world=case.base_from_world
    )
    bound = bound_N_m(setup, case.direction)
    for share, expected in ((0.8, True), (1.3, False)):
        run = hold(
            pad, replace(setup, stiffness_N_m=share * bound), case.place, press_N(LIGHT_GRIP)
        )
        assert settles(run) is expected, f"{share} of {bound:.0f} N/m"


@pytest.mark.slow
@pytest.mark.parametrize("place", ["edge", "corner"])
def test_crease_allows_what_a_flat_wall_does(pad: Scene, place: str) -> None:
    case = next(c for c in cases() if c.place.name == place)
    setup = linear_setup(LIGHT_GRIP, None, False, "way_out")
    bound = bound_N_m(setup, case.direction)
    for share, expected in ((0.85, True), (1.5, False)):
        run = hold(
            pad, replace(setup, stiffness_N_m=share * bound), case.place, press_N(LIGHT_GRIP)
        )
        assert settles(run) is expected, f"{share} of {bound:.0f} N/m"
        assert (run.recording.rows["zones"][run.path_start - 50 :] >= 2).any()


@pytest.mark.slow
def test_the_way_out_goes_round_an_edge_quietly_and_fixed45_does_not() -> None:
    ours, _ = drag_case("edge90_sphere", 0.5, FIRM_GRIP, "way_out")
    theirs, _ = drag_case("edge90_sphere", 0.5, FIRM_GRIP, "fixed45")
    assert ours.faults == theirs.faults == "none"
    assert ours.buzz < 0.05
    assert theirs.worst > 3.0 * ours.worst
    assert ours.turn_deg < 0.1 * NOTICEABLE_TURN_DEG
    assert theirs.turn_deg > NOTICEABLE_TURN_DEG


@pytest.mark.slow
def test_the_way_out_goes_over_a_corner_quietly_and_fixed45_does_not() -> None:
    ours, _ = drag_case("corner3_sphere", 0.2, FIRM_GRIP, "way_out")
    theirs, _ = drag_case("corner3_sphere", 0.2, FIRM_GRIP, "fixed45")
    assert ours.faults == theirs.faults == "none"
    assert ours.buzz < 0.05
    assert theirs.worst > 3.0 * ours.worst
    assert ours.turn_deg < 0.1 * NOTICEABLE_TURN_DEG
    assert theirs.turn_deg > NOTICEABLE_TURN_DEG
