"""`crease hil --couple`: a handle of six axes, its held tool, controller, limits and table; the wrist by itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from crease.base.attitude import to_matrix
from crease.base.errors import BusError, LoopError, TableError
from crease.base.scene import Scene
from crease.base.table import read_table
from crease.bus.drives import Fault, Params, Wrist, WristParams
from crease.draw.plot_loop import draw_loop
from crease.draw.view.page import Replay, path_of
from crease.loop.handle import HandleSetup
from crease.loop.held import (
    bound_along_N_m,
    held_setup,
    hold_held,
    points_pressing,
    stable_along_N_m,
)
from crease.loop.hil import LoopResult, run_inprocess
from crease.loop.places import feet_m, feet_scene
from crease.replay.replay import CoupleOptions
from crease.replay.trajectory import Trajectory, check_rows
from host_tools import Run
from scipy.spatial.transform import Rotation


@pytest.fixture(scope="module")
def feet4(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return feet_scene(tmp_path_factory.mktemp("feet"), 4)


def pressed_and_tilted() -> Trajectory:
    """Down by 4 mm below where the feet touch, then tilted by 0.1 rad about X, back, and off."""
    down, still = np.linspace(0.01, -0.004, 500), np.full(800, -0.004)
    z = np.concatenate([down, still, down[::-1], np.full(100, 0.01)])
    tilt = np.zeros(len(z))
    tilt[500:1300] = 0.1 * np.sin(np.linspace(0.0, np.pi, 800))
    x, y, qz, w = Rotation.from_rotvec(np.column_stack([tilt, 0 * z, 0 * z])).as_quat().T
    rows = np.column_stack([1e-3 * np.arange(len(z)), 0 * z, 0 * z, z, w, x, y, qz])
    return check_rows(rows, "pressed and tilted")


SETUP = HandleSetup(1000.0, 0.0, CoupleOptions(stiffness_Nm_rad=5.0))


@pytest.fixture(scope="module")
def run(feet4: Scene) -> LoopResult:
    return run_inprocess(feet4, pressed_and_tilted(), handle=SETUP)


def test_held_tool_stays_outside_and_its_spring_is_felt_in_six_axes(run: LoopResult) -> None:
    rows = run.handle[run.path_start :]
    assert not rows["faults"].any()
    assert not run.recording.rows["faults"].any()
    assert rows["held_pos_m"][:, 2].min() > -2e-5
    pressed = rows[rows["pressing"] > 0]
    drawn = pressed["held_pos_m"] - pressed["hand_pos_m"]
    assert pressed["contact_force_N"] == pytest.approx(1000.0 * drawn, abs=2e-3)
    assert 0.5 < rows["force_N"][:, 2].max() < 4.0
    turned = (
        Rotation.from_quat(pressed["held_rot"], scalar_first=True)
        * Rotation.from_quat(pressed["hand_rot"], scalar_first=True).inv()
    ).as_rotvec()
    assert pressed["contact_torque_Nm"] == pytest.approx(5.0 * turned, abs=2e-4)
    assert -0.3 < rows["torque_Nm"][:, 0].min() < -0.02
    # The hand feels the torque about the wrist's roll, within its friction.
    at = int(np.argmin(rows["torque_Nm"][:, 0]))
    assert rows["motor_Nm"][at, 2] == pytest.approx(rows["torque_Nm"][at, 0], abs=1e-3)
    assert rows["hand_torque_Nm"][at, 2] == pytest.approx(rows["motor_Nm"][at, 2], abs=0.03)
    free = rows["pressing"] == 0
    assert not rows["force_N"][free].any()


def test_force_goes_out_with_the_torque_frame_of_the_servo(run: LoopResult) -> None:
    """What the drives tell of their torque, one period later, is the force at the tip and the servo's compensation."""
    from crease.draw.plot_loop import motor_force_N

    at = slice(run.path_start + 600, run.path_start + 1100)
    told = motor_force_N(run.recording)[at]
    sent = run.handle["force_N"][run.path_start + 599 : run.path_start + 1099]
    assert np.abs(told - sent)[:, 2].mean() < 0.15
    assert sent[:, 2].mean() > 0.5


def test_a_run_gives_the_same_bits_twice(feet4: Scene, run: LoopResult) -> None:
    again = run_inprocess(feet4, pressed_and_tilted(), handle=SETUP)
    for name in run.handle.dtype.names or ():
        if name != "tick_ns":
            assert np.array_equal(run.handle[name], again.handle[name]), name


def test_limits_hold_and_keep_the_wrench_finite(feet4: Scene) -> None:
    limits = {"force_max_N": 0.5, "torque_max_Nm": 0.01}
    run = run_inprocess(feet4, pressed_and_tilted(), handle=replace(SETUP, passivity=limits))
    rows = run.handle
    assert np.linalg.norm(rows["force_N"], axis=1).max() == pytest.approx(0.5, rel=1e-5)
    assert np.linalg.norm(rows["torque_Nm"], axis=1).max() <= 0.01 * (1 + 1e-5)
    assert np.linalg.norm(rows["contact_force_N"], axis=1).max() > 0.6
    assert rows["limits"].any()


def test_a_fault_of_the_bus_ends_force_and_torque(feet4: Scene) -> None:
    path = pressed_and_tilted()
    whole = run_inprocess(feet4, path, handle=SETUP)
    tick = int(whole.recording.rows["tick"][whole.path_start + 700])
    faults = [Fault("encoder_jump", tick, axis=0, value=2000)]
    run = run_inprocess(feet4, path, faults=faults, handle=SETUP)
    struck = np.flatnonzero(run.recording.rows["faults"])[0]
    assert run.handle["force_N"][struck - 1].any()
    assert not run.handle["force_N"][struck:].any()
    assert not run.handle["motor_Nm"][struck:].any()


def test_a_lost_state_halves_what_was_sent(feet4: Scene) -> None:
    path = pressed_and_tilted()
    whole = run_inprocess(feet4, path, handle=SETUP)
    tick = int(whole.recording.rows["tick"][whole.path_start + 700])
    run = run_inprocess(feet4, path, faults=[Fault("drop", tick, id=0x192)], handle=SETUP)
    at = int(np.flatnonzero(run.recording.rows["fresh"][run.path_start + 400 :] & 7 != 7)[0])
    at += run.path_start + 400
    for name in ("force_N", "torque_Nm"):
        assert run.handle[name][at] == pytest.approx(0.5 * run.handle[name][at - 1], abs=1e-6)
    assert not run.handle["faults"].any()


def test_delay_may_be_set(feet4: Scene) -> None:
    params = Params(torque_delay_s=3e-3)
    run = run_inprocess(feet4, pressed_and_tilted(), params=params, handle=SETUP, at_once=True)
    assert not run.handle["faults"].any()
    assert run.handle["force_N"][:, 2].max() > 0.5
    with pytest.raises(LoopError, match="delay of 8 periods; give 0 to 7"):
        run_inprocess(
            feet4,
            pressed_and_tilted(),
            params=Params(torque_delay_s=8e-3),
            handle=SETUP,
            at_once=True,
        )


def test_command_writes_a_table_that_is_drawn_with_torque(
    feet4: Scene, tmp_path: Path, crease: Run
) -> None:
    feet4.save(tmp_path / "feet.crs")
    np.savetxt(
        tmp_path / "path.csv",
        pressed_and_tilted().rows,
        delimiter=",",
        header="t_s,x_m,y_m,z_m,qw,qx,qy,qz",
        comments="",
    )
    (tmp_path / "device.toml").write_text("[wrist]\ncoulomb_Nm = [0.02, 0.02, 0.02]\n", "ascii")
    line = ["hil", tmp_path / "feet.crs", "--operator", tmp_path / "path.csv"]
    more = ["--friction", "0.3", "--stiffness", "1500", "--stiffness-turn", "8", "--damping", "1"]
    held = [*line, "--couple", *more, "--device", tmp_path / "device.toml"]
    said = crease(*held, "-o", tmp_path / "out.csv", "--json")
    assert said.status == 0, said.err
    assert said.json["torque_max_Nm"] > 0.02
    assert said.json["couple_faults"] == 0
    assert said.json["inside_max_m"] < 2e-5
    table = read_table(tmp_path / "out.csv")
    pressed = table["areas"] > 0
    assert pressed.sum() == said.json["ticks_in_contact"]
    assert table["dz_m"][pressed].min() > -2e-5
    assert np.abs(table["tx_Nm"]).max() == pytest.approx(said.json["torque_max_Nm"], rel=0.1)
    figure = draw_loop(table, "held")
    assert [axes.get_ylabel() for axes in figure.axes][1] == "|torque|, N m"
    assert crease("plot", tmp_path / "out.csv", "-o", tmp_path / "out.png").status == 0
    with pytest.raises(TableError, match="out: is of a loop with a held tool"):
        path_of(Replay("out", table))
    assert crease(*held, "--delay", "2", "-o", tmp_path / "out2.npz").status == 0
    for words, text in (
        ([*line, "-o", tmp_path / "o.crr", "--friction", "0.3"], "--friction is of a held tool"),
        ([*line, "-o", tmp_path / "o.crr", "--delay", "1"], "--delay is of a held tool"),
        ([*line, "-o", tmp_path / "o.crr", "--damping", "1"], "--damping is of a held tool"),
        ([*held, "-o", tmp_path / "o.crr"], "suffix is not one of .csv, .npz"),
        (
            [*held, "-o", tmp_path / "o.csv", "--table", tmp_path / "t.csv"],
            "--couple has no --table",
        ),
        ([*held, "-o", tmp_path / "o.csv", "--response", "extent"], "no response but its own"),
        ([*held, "-o", tmp_path / "o.csv", "-i", "socketcan"], "only with -i inprocess"),
    ):
        said = crease(*words)
        assert said.status == (1 if "suffix" in text else 2)
        assert text in said.err


def test_wrist_is_a_damped_mass_on_the_spring_of_its_hand() -> None:
    """Step of a motor torque against theory: rest at torque / stiffness, on the way the swing of the damped mass."""
    wrist = Wrist(WristParams(coulomb_Nm=[0.0] * 3, hand_damping_Nms_rad=0.01, substeps=100))
    inertia, damping, stiffness = 8e-4 + 1.5e-3, 0.015, 2.0
    omega, decay = np.sqrt(stiffness / inertia), damping / (2 * inertia)
    ring = np.sqrt(omega**2 - decay**2)
    for k in range(1, 401):
        wrist.advance([0.0] * 3, [0.1, 0.0, -2.0])
        t = 1e-3 * k
        swing = np.exp(-decay * t) * (np.cos(ring * t) + decay / ring * np.sin(ring * t))
        assert wrist.read("angle_rad")[0] == pytest.approx(0.05 * (1 - swing), abs=2e-4)
    assert wrist.read("motor_Nm").tolist() == [0.1, 0.0, -1.0]  # cut to the motor's limit
    assert wrist.read("counts")[0] == round(wrist.read("angle_rad")[0] / np.deg2rad(0.01))
    assert wrist.read("angle_rad")[1] == 0.0


def test_dry_friction_of_the_wrist_holds_up_to_its_torque() -> None:
    wrist = Wrist(WristParams(coulomb_Nm=[0.05, 0.05, 0.05], hand_stiffness_Nm_rad=0.0))
    for _ in range(200):
        wrist.advance([0.0] * 3, [0.049, 0.051, float("nan")])
    assert wrist.read("angle_rad")[0] == wrist.read("angle_rad")[2] == 0.0
    assert wrist.read("angle_rad")[1] > 0.0


def test_bad_wrists_are_refused() -> None:
    for values, text in (
        ({"inertia_kgm2": [1.0, 1.0]}, "is not three numbers"),
        ({"inertia": 1.0}, "'inertia' is not known"),
        ({"step_rad": float("nan")}, "not a finite number"),
    ):
        with pytest.raises(BusError, match=text):
            WristParams(**values)
    for name, value in (("inertia_kgm2", [0.0, 1.0, 1.0]), ("substeps", 0), ("path_Hz", 0.0)):
        with pytest.raises(BusError, match="a parameter of the wrist is out of range"):
            Wrist(WristParams(**{name: value}))


@pytest.mark.slow
def test_stable_stiffness_does_not_depend_on_the_number_of_contacts(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """One period of delay; a coarse search: the full one is `make bench-loop`."""
    folder, setup = tmp_path_factory.mktemp("feet"), held_setup()
    bound = bound_along_N_m(setup)
    one = stable_along_N_m(feet_scene(folder, 1), setup, 0.7 * bound, 1.5 * bound, 1.03)
    assert 0.9 * bound < one < 1.2 * bound
    low, high = one / 1.033, one * 1.015  # all between these: within 5 %
    for feet in (4, 24):  # which are tried alone: 0 is at rest at neither, infinity at both
        found = stable_along_N_m(feet_scene(folder, feet), setup, low, high, high / low)
        assert low < found < high, (feet, one, found)


@pytest.mark.slow
@pytest.mark.parametrize("feet", [1, 24])
def test_all_feet_rest_on_the_block_and_no_more_press_than_a_wrench_has_components(
    tmp_path: Path, feet: int
) -> None:
    """Three would hold the plate; a nanometre of gap, the last bit there, is 24 mN, so that some more may press."""
    result = hold_held(feet_scene(tmp_path, feet), held_setup(), 0.0, 0.0)
    last = result.handle[-1]
    assert min(feet, 3) <= points_pressing(result) <= min(feet, 6)
    assert not result.handle["left_out"].any()
    tips = feet_m(feet) @ to_matrix(last["held_rot"].astype(np.float64)).T + last["held_pos_m"]
    assert len(tips) == feet
    assert np.abs(tips[:, 2]).max() < 5e-6
