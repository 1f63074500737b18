"""The mechanism against mechanics: masses, friction, vibration, lag, limits, hand, and the sampled loop."""

from __future__ import annotations

import numpy as np
import pytest
from crease.bus.drives import AXES, F64, Drives, Frame, Mech, Params
from loop import CASES, Case, eigenvalue_N_m, formula_N_m, settles

LINK_M = 0.45
ARM_INERTIA = 1.2 * LINK_M**2
BARE = {"coulomb_N": 0.0, "step_m": 0.0, "viscous_Ns_m": 0.0}
ALL_BARE = {axis: dict(BARE) for axis in "XYZ"}


def run(mech: Mech, torque: list[float], periods: int, name: str = "joint") -> F64:
    """Constant torque; one reading after each period, shape (periods, 3)."""
    mech.command(torque)
    rows = np.zeros((periods, AXES))
    for row in rows:
        mech.advance(10)
        row[:] = mech.read(name)
    return rows


@pytest.mark.parametrize("case", CASES, ids=str)
def test_largest_stable_stiffness_is_that_of_theory_within_five_percent(case: Case) -> None:
    exact = eigenvalue_N_m(case)
    assert exact == pytest.approx(formula_N_m(case), rel=0.01)
    assert settles(case, 0.95 * exact)
    assert not settles(case, 1.05 * exact)


@pytest.mark.parametrize(
    ("case", "stiffness_N_m"), list(zip(CASES, (7001, 2334, None, 637, 6002), strict=True)), ids=str
)
def test_eigenvalues_are_the_published_ones(case: Case, stiffness_N_m: float | None) -> None:
    if stiffness_N_m is not None:
        assert eigenvalue_N_m(case) == pytest.approx(stiffness_N_m, rel=0.002)


@pytest.mark.parametrize("axis", range(AXES))
def test_apparent_mass_is_that_of_the_table(axis: int) -> None:
    torque = [0.0] * AXES
    torque[axis] = 1.0
    mech = Mech(Params(linear=True, axes=ALL_BARE))
    start = mech.read("joint")
    moved = run(mech, torque, 50)[-1] - start
    inertia = (5.4, ARM_INERTIA, ARM_INERTIA)[axis]
    assert moved[axis] == pytest.approx(0.5 * 0.05**2 / inertia, rel=0.002)


def test_tip_follows_the_joints_of_the_parallelogram() -> None:
    mech = Mech(Params(linear=True, axes=ALL_BARE))
    run(mech, [3.0, 0.4, -0.3], 200)
    x, upper, fore = mech.read("joint")
    want = [x, LINK_M * (np.cos(upper) + np.cos(fore)), LINK_M * (np.sin(upper) + np.sin(fore))]
    assert mech.read("tip_pos_m") == pytest.approx(want, abs=1e-6)


@pytest.mark.parametrize(("axis", "mode_Hz"), [(0, 50.0), (1, 60.0), (2, 60.0)])
def test_first_vibration_mode_is_where_the_table_has_it(axis: int, mode_Hz: float) -> None:
    mech = Mech(Params(axes=ALL_BARE, hand_mass_kg=0.0, gravity_N=0.0, amplifier_Hz=0.0))
    torque = [0.0] * AXES
    torque[axis] = 1.0
    run(mech, torque, 1)
    rate = run(mech, [0.0] * AXES, 2000, "joint_rate")[:, axis]
    spectrum = np.abs(np.fft.rfft((rate - rate.mean()) * np.hanning(len(rate)), 16384))
    frequencies = np.fft.rfftfreq(16384, 1e-3)
    found = frequencies[10:][spectrum[10:].argmax()]
    assert found == pytest.approx(mode_Hz, rel=0.02)


@pytest.mark.parametrize("rigid", [0, 1])
@pytest.mark.parametrize(("axis", "friction"), [(0, 1.0), (1, 0.4 * LINK_M), (2, 0.4 * LINK_M)])
def test_coulomb_friction_holds_up_to_its_limit(rigid: int, axis: int, friction: float) -> None:
    for share, moves in ((0.9, False), (1.2, True)):
        mech = Mech(Params(rigid=rigid, hand_mass_kg=0.0, gravity_N=0.0))
        start = mech.read("joint")
        torque = [0.0] * AXES
        torque[axis] = share * friction
        moved = abs(run(mech, torque, 400)[-1] - start)[axis]
        assert bool(moved > 1e-4) is moves, f"{share} of the friction moved {moved}"


def test_amplifier_lags_by_its_time_constant() -> None:
    mech = Mech(Params(hand_mass_kg=0.0))
    mech.command([10.0, 0.0, 0.0])
    reached = []
    for _ in range(20):
        mech.advance(1)
        reached.append(mech.read("joint_torque")[0])
    time_s = (np.arange(20) + 0.5) * 1e-4
    want = 10.0 * (1.0 - np.exp(-2 * np.pi * 500.0 * time_s))
    assert reached == pytest.approx(want, rel=1e-6)


def test_encoder_reads_whole_counts_of_the_table() -> None:
    mech = Mech(Params(hand_mass_kg=0.0))
    step = np.array([60e-6, 40e-6 / LINK_M, 40e-6 / LINK_M])
    run(mech, [9.0, 1.0, -1.0], 137)
    assert (np.abs(mech.read("counts") * step - mech.read("joint")) <= 0.5001 * step).all()
    mech.target([0.0, 0.6, 0.0], [0.1, -0.2, 0.3])
    wrist = np.deg2rad(0.05)
    assert mech.read("wrist_counts") == pytest.approx(np.round(np.array([0.1, -0.2, 0.3]) / wrist))


def test_gravity_residual_pulls_the_tip_down() -> None:
    mech = Mech(Params(rigid=1, axes=ALL_BARE, hand_mass_kg=0.0, gravity_N=0.2))
    run(mech, [0.0] * AXES, 100)
    assert mech.read("tip_acc_m_s2") == pytest.approx([0.0, 0.0, -0.2 / 1.2], abs=0.01)


def test_hand_follows_its_target_through_a_low_pass_of_ten_hertz() -> None:
    mech = Mech(Params())
    start = mech.read("tip_pos_m")
    seen = []
    for k in range(2000):
        sway = 0.01 * np.sin(2 * np.pi * 10.0 * k * 1e-3)
        mech.target([start[0] + sway, start[1], start[2]])
        mech.advance(10)
        seen.append(mech.read("hand_target_m")[0])
    assert max(seen[1000:]) == pytest.approx(0.01 / np.sqrt(2.0), rel=0.02)


def test_hand_feels_what_the_motors_push() -> None:
    mech = Mech(
        Params(linear=True, hand_mass_kg=0.8, hand_damping_Ns_m=30.0, hand_stiffness_N_m=600.0)
    )
    run(mech, [5.0, 0.0, 0.0], 3000)
    assert mech.read("hand_force_N") == pytest.approx([5.0, 0.0, 0.0], abs=0.01)
    assert mech.read("tip_pos_m")[0] == pytest.approx(5.0 / 600.0, rel=0.01)


def test_stops_hold_the_device_and_say_so() -> None:
    drives = Mech(Params(hand_mass_kg=0.0))
    run(drives, [20.0, 0.0, 0.0], 2000)
    assert drives.read("joint")[0] == pytest.approx(0.75, abs=0.02)
    folded = Mech(Params(hand_mass_kg=0.0))
    for _ in range(3000):
        folded.command([0.0, 3.0, -3.0])
        folded.advance(10)
    upper, fore = folded.read("joint")[1:]
    assert np.pi - (upper - fore) > np.deg2rad(38.0)


def test_whatever_is_commanded_the_state_stays_finite() -> None:
    mech = Mech(Params())
    for torque in ([np.nan] * 3, [np.inf] * 3, [1e3, -1e3, 1e3]):
        rows = run(mech, torque, 200)
        assert np.isfinite(rows).all()


def test_two_runs_agree_to_the_bit_and_the_live_one_keeps_time() -> None:
    def drive(wall_clock: bool) -> list[tuple[int, bytes]]:
        drives = Drives(wall_clock=wall_clock)
        frames: list[tuple[int, bytes]] = []
        drives.receive(Frame(0, b"\x01\x00"), 0)
        for tick in range(300):
            drives.target([0.01, 0.64, 0.0])
            drives.receive(Frame(0x80, b""), 1000 * tick)
            drives.poll(1000 * tick)
            frames += drives.send()
        assert drives.state.time_s == pytest.approx(0.299 if wall_clock else 0.3)
        return frames

    assert drive(False) == drive(False)
    assert drive(True) == drive(True)


def test_operator_path_begins_when_the_drives_are_enabled() -> None:
    drives = Drives(path=np.column_stack([np.linspace(0, 0.1, 50), *np.zeros((5, 50))]))
    for tick in range(100):
        drives.receive(Frame(0x80, b""), 1000 * tick)
    assert drives.state.hand_target_m[0] == 0.0
