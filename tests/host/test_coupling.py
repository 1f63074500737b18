"""`crease.Coupling`: the bits of the command, its points, its errors; where the springs are tied."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import crease
import numpy as np
import pytest
from crease.base.units import parse_place
from crease.cli import main
from crease.replay.replay import CoupleOptions, ReplayOptions, run_path
from crease.replay.trajectory import load_trajectory

FREE = [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0]
DEEP = [0.0, 0.0, 0.008, 1.0, 0.0, 0.0, 0.0]
BALL_M = 0.01


@pytest.fixture(scope="module")
def scene(scene_crs: Path) -> crease.Scene:
    return crease.Scene.open(scene_crs)


def test_ticks_and_replay_give_the_bits_of_the_command(
    scene: crease.Scene, press_csv: Path
) -> None:
    path = load_trajectory(press_csv)
    settings: dict[str, Any] = {"damping": 2.0, "friction": 0.3, "centre": (0.0, 0.0, 0.02)}
    coupling = crease.Coupling(scene, stiffness=800.0, stiffness_turn=3.0, **settings)
    options = ReplayOptions(800.0, 2.0, couple=CoupleOptions(3.0, 0.0, 0.3, (0.0, 0.0, 0.02)))
    known = run_path(scene, path, options, repeat=1)
    felt = coupling.replay(path)
    names = [name for name in known.dtype.names or () if name != "tick_ns"]
    assert all(np.array_equal(known[name], felt.rows[name]) for name in names)
    assert (felt.areas > 0).any()
    coupling.reset()
    for pose, row in zip(path.rows[:, 1:], known, strict=True):
        out = coupling.tick(pose)
        assert np.array_equal(out.force_N, row["force_N"])
        assert np.array_equal(out.torque_Nm, row["torque_Nm"])
        assert np.array_equal(out.held_position_m, row["display_pos_m"])
        assert np.array_equal(out.held_quaternion, row["display_rot"])
        assert (out.pressing, len(out.points)) == (row["contacts"], row["zones"])
        assert out.stats["near"] == row["points"]
        assert out.late == bool(row["late_ticks"])
        assert out.left_out == row["overflow"]


def test_points_lie_where_the_held_tool_touches(scene: crease.Scene) -> None:
    coupling = crease.Coupling(scene, stiffness=1000.0)
    assert len(coupling.tick(FREE).points) == 0
    coupling.reset()
    turned = [np.cos(0.4), 0.48 * np.sin(0.4), 0.6 * np.sin(0.4), 0.64 * np.sin(0.4)]
    for z in np.linspace(0.012, DEEP[2], 60):
        out = coupling.tick([0.02, 0.01, z, *turned])
    assert out.force_N == pytest.approx(
        [0.0, 0.0, 1000.0 * (out.held_position_m[2] - DEEP[2])], abs=0.02
    )
    assert out.held_position_m[2] == pytest.approx(BALL_M, abs=1e-4)
    pressing = out.points[out.points["gap_m"] < 0.0]
    assert len(pressing) == out.pressing > 0
    away_m = pressing["point_world_m"] - np.array([0.02, 0.01, 0.0])
    assert np.abs(away_m[:, :2]).max() < 2e-3
    assert np.abs(away_m[:, 2]).max() < 5e-5
    assert pressing["normal_world"] == pytest.approx(
        np.tile([0.0, 0.0, 1.0], (len(pressing), 1)), abs=1e-3
    )
    assert out.inside_m < 2e-5
    assert repr(out).startswith("Held(force_N=[")
    assert repr(out).endswith(", faults=0)")


def test_a_pose_that_is_not_sane_latches_a_fault(scene: crease.Scene) -> None:
    coupling = crease.Coupling(scene)
    for z in np.linspace(0.012, DEEP[2], 60):
        coupling.tick([0.0, 0.0, z, 1.0, 0.0, 0.0, 0.0])
    assert coupling.tick([0, 0, float("nan"), 1, 0, 0, 0]).faults == 1
    out = coupling.tick(DEEP)
    assert out.faults == 1
    assert not out.force_N.any()
    assert not out.torque_Nm.any()
    coupling.reset()
    assert coupling.tick(FREE).faults == 0


WRONG: dict[str, tuple[Callable[[crease.Scene], object], str]] = {
    "stiffness": (lambda s: crease.Coupling(s, stiffness=0.0), "stiffness is 0.0; give a number from 1 to"),
    "turn": (lambda s: crease.Coupling(s, stiffness_turn=1e9), "stiffness_turn is 1000000000.0; give"),
    "friction": (lambda s: crease.Coupling(s, friction=2), "friction is 2; give a number from 0 to 1"),
    "damping": (lambda s: crease.Coupling(s, damping=-1), "damping is -1; give a number from 0 to 10000 N s/m"),
    "centre": (lambda s: crease.Coupling(s, centre=(0.0, 0.0)), "centre: give x, y and z in m"),
    "far centre": (lambda s: crease.Coupling(s, centre=(0, 0, 1e9)), "centre_tool_m must be within"),
    "pose": (lambda s: crease.Coupling(s).tick([0, 0, 1]), "a pose is 7 numbers"),
    "poses": (lambda s: crease.Coupling(s).replay(np.zeros((3, 5))), r"poses of shape \(3, 5\)"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_an_error_is_one_line_of_the_one_tree(name: str, scene: crease.Scene) -> None:
    call, text = WRONG[name]
    with pytest.raises(crease.CreaseError, match=text) as error:
        call(scene)
    assert str(error.value).split() == str(error.value).split(
        " "
    )  # no line ends, no blank at the end


def test_a_place_is_three_lengths() -> None:
    assert parse_place("0, -5mm,1in") == (0.0, -0.005, 0.0254)
    for text in ("1,2", "1,2,3,4", "a,0,0", "1mm", "0,0,1e999"):
        with pytest.raises(crease.UnitError):
            parse_place(text)


def test_the_command_ties_the_springs_where_it_is_told(
    scene_crs: Path, press_csv: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["replay", str(scene_crs), str(press_csv), "--repeat", "1", "--couple"]
    more = ["--centre=-2mm,0,0.03", "--damping-turn", "0.01", "--damping", "1"]
    assert main([*line, "-o", str(tmp_path / "out.npz"), *more]) == 0
    table = np.load(tmp_path / "out.npz")
    couple = CoupleOptions(damping_Nms_rad=0.01, centre_tool_m=(-0.002, 0.0, 0.03))
    path = load_trajectory(press_csv)
    known = run_path(
        crease.Scene.open(scene_crs), path, ReplayOptions(1000.0, 1.0, couple=couple), 1
    )
    assert np.array_equal(table["ty_Nm"], known["torque_Nm"][:, 1])
    assert known["torque_Nm"][:, 1].any()
    assert main([*line[:-1], "-o", str(tmp_path / "o.csv"), "--centre", "0,0,1mm"]) == 2
    assert "--centre is of a held tool; give --couple too" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main([*line, "-o", str(tmp_path / "o.csv"), "--centre", "1,2"])


def test_springs_tied_far_from_the_tool_are_suspected_to_be_in_mm(
    scene_crs: Path, press_csv: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["replay", str(scene_crs), str(press_csv), "--repeat", "1", "--couple", "--force"]
    for centre, warned in (("0,0,40", True), ("0,0,40mm", False)):
        assert main([*line, "-o", str(tmp_path / "out.csv"), "--centre", centre]) == 0
        said = capsys.readouterr().err
        assert ("--centre ties the springs 40 m away from a tool of" in said) == warned
        assert ("write lengths like 40mm" in said) == warned


def test_a_held_tool_has_no_coverage(
    scene_crs: Path, press_csv: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["replay", str(scene_crs), str(press_csv), "-o", str(tmp_path / "out.csv")]
    assert main([*line, "--couple", "--coverage", "hard"]) == 2
    said = capsys.readouterr().err
    assert said == "error: --couple has no --coverage; leave it out; see `crease replay --help`\n"


@pytest.mark.parametrize("verb", ["replay", "hil"])
def test_a_spring_to_the_hand_is_no_weaker_than_it_may_be(
    verb: str, scene_crs: Path, press_csv: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = [str(press_csv)] if verb == "replay" else ["--operator", str(press_csv)]
    line = [verb, str(scene_crs), *path, "-o", str(tmp_path / "out.csv"), "--couple"]
    assert main([*line, "--stiffness", "0"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: --stiffness 0: with --couple it is of the spring to the hand, ")
    with pytest.raises(SystemExit):
        main([verb, "--help"])
    assert "0 to 1e6; with --couple 1 to 1e6 (default: 1000)" in " ".join(
        capsys.readouterr().out.split()
    )
