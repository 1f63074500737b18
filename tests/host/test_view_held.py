"""`crease view` of a held tool: what holds it, found again by the settings in its table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from browser import Page
from crease import Coupling
from crease.base.attitude import to_matrix
from crease.base.scene import open_scene
from crease.base.table import read_table, write_table
from crease.draw.plot import forces_N, torques_Nm
from crease.draw.view.felt import who_answered
from crease.replay.contacts import find_held
from crease.replay.replay import (
    COUPLE_COLUMNS,
    CoupleOptions,
    ReplayOptions,
    couple_columns,
    couple_options_of,
)
from crease.replay.trajectory import load_trajectory
from host_tools import Run, write_path

PICTURES = Path(__file__).resolve().parents[2] / "build" / "view"
STAGE = (250, 150, 1430, 530)
"""Part of the window that one pane draws in, beside its text."""
SETTINGS = (
    "--stiffness",
    "1500",
    "--stiffness-turn",
    "4",
    "--friction",
    "0.3",
    "--centre",
    "0,0,10mm",
)


@pytest.fixture(scope="module")
def held(folder: Path, block_stl: Path, crease: Run) -> tuple[Path, Path]:
    """A cube pressed 3 mm into the block, slid and turned: image and table."""
    tool, scene, poses, out = (folder / f"held.{end}" for end in ("stl", "crs", "csv", "npz"))
    trimesh.creation.box(extents=[20, 20, 20]).export(tool)
    said = crease("bake", block_stl, tool, "-o", scene, "--unit", "mm", "--spacing", "2mm")
    assert said.status == 0, said.err
    down = np.linspace([0.0, 0.0, 0.012], [0.0, 0.0, 0.007], 150)
    along = np.linspace([0.0, 0.0, 0.007], [0.008, 0.003, 0.007], 150)
    write_path(poses, np.concatenate([down, along]))
    said = crease("replay", scene, poses, "-o", out, "--couple", *SETTINGS, "--repeat", "1")
    assert said.status == 0, said.err
    return scene, out


def test_table_of_a_held_tool_has_its_settings(held: tuple[Path, Path]) -> None:
    table = read_table(held[1])
    assert all(len(set(table[name].tolist())) == 1 for name in COUPLE_COLUMNS)
    options = couple_options_of(table)
    assert options is not None
    assert options.couple is not None
    told = (options.stiffness_N_m, options.damping_Ns_m, options.couple.stiffness_Nm_rad)
    assert told == (1500.0, 0.0, 4.0)
    assert options.couple.friction == pytest.approx(0.3)
    assert options.couple.centre_tool_m == pytest.approx((0.0, 0.0, 0.01))
    assert couple_options_of({"t_s": table["t_s"]}) is None
    answered = who_answered(open_scene(held[0]), load_trajectory(held[1]), table)
    assert (answered.options, answered.differ) == (options, 0)


def test_points_that_press_carry_the_wrench(held: tuple[Path, Path]) -> None:
    """By statics: what the points hold the tool with is what the spring pulls it with.

    A gap has steps of 1 nm in 32 bits, 24 mN a point.
    """
    scene, table, path = open_scene(held[0]), read_table(held[1]), load_trajectory(held[1])
    options = couple_options_of(table)
    assert options is not None
    nothing, points = find_held(scene, path, options)
    assert len(nothing.changes) == len(nothing.zones) == 0
    sure = (
        np.linalg.norm(forces_N(table), axis=1) > 2.0
    )  # below, points are nanometres behind their planes, or not
    assert np.array_equal(points.counts[sure], table["areas"][sure])
    assert not points.counts[table["z_m"] > 0.0101].any()
    force_N, torque_Nm = forces_N(table), torques_Nm(table)
    centre = np.array([0.0, 0.0, 0.01])
    checked = 0
    for tick in np.flatnonzero((points.counts > 0) & (table["z_m"] < 9.9e-3))[::10]:
        of = points.of(tick)
        turn = to_matrix(path.rows[tick : tick + 1, 4:])[0]
        held_turn = to_matrix(np.array([[table[f"dq{part}"][tick] for part in "wxyz"]]))[0]
        origin_m = np.array([table[f"d{axis}_m"][tick] for axis in "xyz"])
        moment = np.cross(of["point_m"] - (origin_m + held_turn @ centre), of["force_N"]).sum(
            axis=0
        )
        felt = torque_Nm[tick] - np.cross(turn @ centre, force_N[tick])  # about the springs' centre
        assert of["force_N"].sum(axis=0) == pytest.approx(force_N[tick], abs=0.16)
        assert moment == pytest.approx(felt, abs=2e-3)
        assert (of["force_N"][:, 2] > 0).all()
        slip_N = np.hypot(of["force_N"][:, 0], of["force_N"][:, 1])
        assert (slip_N <= 0.3 * of["force_N"][:, 2] + 0.08).all()
        checked += 1
    assert checked > 10
    assert np.abs(force_N[-1, :2]).max() > 0.2  # friction was there


def test_what_python_saves_is_drawn_too(held: tuple[Path, Path], folder: Path, crease: Run) -> None:
    table = folder / "saved.csv"
    poses = load_trajectory(held[1])
    Coupling(held[0], stiffness=1500.0, friction=0.2).replay(poses).save(table)
    options = couple_options_of(read_table(table))
    assert options is not None
    assert options.couple == CoupleOptions(friction=pytest.approx(0.2))  # type: ignore[arg-type]
    said = crease("view", held[0], table, "-o", folder / "saved.html")
    assert (said.status, said.err) == (0, "")


def test_table_of_another_scene_is_refused(
    held: tuple[Path, Path], folder: Path, scene_crs: Path, crease: Run
) -> None:
    said = crease("view", scene_crs, held[1], "-o", folder / "other.html")
    assert said.status == 1
    assert "name the scene that was replayed" in said.err
    table = dict(read_table(held[1]))
    table["couple_late"] = np.zeros(len(table["t_s"]))
    write_table(folder / "loop.npz", table)
    said = crease("view", held[0], folder / "loop.npz", "-o", folder / "loop.html")
    assert said.status == 1
    assert "crease replay --couple" in said.err


@pytest.mark.slow
def test_page_shows_the_held_tool_and_the_hand(held: tuple[Path, Path], crease: Run) -> None:
    PICTURES.mkdir(parents=True, exist_ok=True)
    path, shown = PICTURES / "held.html", PICTURES / "held.png"
    said = crease("view", held[0], held[1], "-o", path, "--force")
    assert said.status == 0, said.err
    table = read_table(held[1])
    tick = len(table["t_s"]) - 1
    with Page() as page:
        page.open(path)
        page.seek(tick)
        look = page.run("crease.look(0)")
        held_m = [table[f"d{axis}_m"][tick] for axis in "xyz"]
        assert look["tool"][12:15] == pytest.approx(held_m, abs=1e-6)
        assert page.run("crease.player.stage.hand.group.visible")
        hand = page.run("crease.player.stage.hand.group.matrix.elements")
        assert hand[12:15] == pytest.approx([table[f"{a}_m"][tick] for a in "xyz"], abs=1e-6)
        parts = page.run("crease.player.stage.parts.filter((part) => part.group.visible).length")
        assert parts == table["areas"][tick] > 1
        page.picture(shown)
        page.run("crease.player.setDisplay(false)")
        look = page.run("crease.look(0)")
        assert look["tool"][12:15] == pytest.approx(hand[12:15], abs=1e-6)
        assert not page.run("crease.player.stage.hand.group.visible")
        assert page.complaints == []


def test_options_of_a_table_come_back() -> None:
    options = ReplayOptions(700.0, 2.5, couple=CoupleOptions(3.0, 0.25, 0.5, (1e-3, -2e-3, 3e-3)))
    again = couple_options_of(couple_columns(options, 4))
    assert again is not None
    assert again.couple is not None
    assert (again.stiffness_N_m, again.damping_Ns_m) == (700.0, 2.5)
    assert again.couple.centre_tool_m == pytest.approx((1e-3, -2e-3, 3e-3), rel=1e-6)
    assert couple_columns(ReplayOptions(), 4) == {}
