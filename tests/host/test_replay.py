"""Replay: the table of a path, and the world behind it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from crease.base.errors import SceneError
from crease.base.native import COVERAGES, RESPONSES, lib
from crease.base.scene import open_image, open_scene
from crease.base.table import read_table
from crease.replay.replay import (
    COLUMNS,
    RUNS,
    ReplayOptions,
    World,
    run_path,
    to_columns,
)
from crease.replay.trajectory import check_rows, load_trajectory
from host_tools import Run, write_path


def test_names_come_from_the_c_enumerations() -> None:
    """Those of other responses: test_rivals_apart.py."""
    assert {"way_out", "extent", "fixed45"} <= set(RESPONSES)
    assert RESPONSES["way_out"] == lib.CR_RESPONSE_WAY_OUT == lib.cr_config_default().response
    assert ReplayOptions().response == "way_out"
    assert set(COVERAGES) == {"soft", "hard"}


def test_table_has_the_documented_columns(press_out: Path) -> None:
    assert tuple(read_table(press_out)) == (*COLUMNS, RUNS)


def test_ball_on_a_block_gives_k_times_depth_upwards(press_out: Path) -> None:
    table = read_table(press_out)
    pressed = slice(250, 400)
    assert table["fz_N"][pressed] == pytest.approx(2.0, rel=0.02)
    assert np.abs(table["fx_N"][pressed]).max() < 0.02
    assert table["depth_m"][pressed] == pytest.approx(0.002, rel=0.02)
    assert table["nz"][pressed] == pytest.approx(1.0, abs=1e-4)
    assert (table["areas"][pressed] == 1).all()


def test_no_force_in_free_space(press_out: Path) -> None:
    table = read_table(press_out)
    free = slice(0, 90)
    for name in ("fx_N", "fy_N", "fz_N", "depth_m", "areas", "contacts"):
        assert (table[name][free] == 0.0).all()


def test_display_pose_rests_on_the_surface(press_out: Path) -> None:
    table = read_table(press_out)
    assert (table["dz_m"] >= 0.010 - 5e-5).all()


@pytest.mark.parametrize("response", sorted(RESPONSES))
@pytest.mark.parametrize("coverage", sorted(COVERAGES))
def test_every_response_and_coverage_pushes_out(
    scene_crs: Path, press_csv: Path, response: str, coverage: str
) -> None:
    options = ReplayOptions(response=response, coverage=coverage)
    if (response, coverage) == ("way_out", "hard"):
        with pytest.raises(SceneError, match=r"^coverage hard: .*; use response extent"):
            World(open_scene(scene_crs), options)
        return
    rows = run_path(open_scene(scene_crs), load_trajectory(press_csv), options)
    if response in ("way_out", "extent", "fixed45"):
        assert rows["force_N"][399, 2] == pytest.approx(2.0, rel=0.05)
    elif response == "god_object":  # a point in the middle of the tool, and it stays outside
        assert rows["force_N"][399, 2] == 0.0
    else:  # what they should push is in tests/unit/test_rivals.c
        assert rows["force_N"][399, 2] > 0.1


def test_god_object_says_where_it_is_silent(
    folder: Path, scene_crs: Path, press_csv: Path, crease: Run
) -> None:
    for response, warned in (("god_object", True), ("sphere_proxy", False)):
        words = ("-o", folder / f"point_{response}.csv", "--response", response)
        said = crease("replay", scene_crs, press_csv, *words)
        assert said.status == 0
        assert (
            "no force in 300 of 300 ticks in which the tool touches; it feels" in said.err
        ) == warned


def test_stiffness_scales_the_force(scene_crs: Path, press_csv: Path) -> None:
    scene, path = open_scene(scene_crs), load_trajectory(press_csv)
    soft = run_path(scene, path, ReplayOptions(stiffness_N_m=500.0))
    hard = run_path(scene, path, ReplayOptions(stiffness_N_m=1000.0))
    assert hard["force_N"] == pytest.approx(2.0 * soft["force_N"], rel=1e-5)


def test_repeat_keeps_everything_but_the_cost(scene_crs: Path, press_csv: Path) -> None:
    scene, path = open_scene(scene_crs), load_trajectory(press_csv)
    once, thrice = run_path(scene, path), run_path(scene, path, repeat=3)
    for name in once.dtype.names or ():
        if name != "tick_ns":
            assert np.array_equal(once[name], thrice[name]), name
    assert (thrice["tick_ns"] > 0).all()


def test_chunks_do_not_show(
    scene_crs: Path, press_csv: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, path = open_scene(scene_crs), load_trajectory(press_csv)
    options = ReplayOptions(damping_Ns_m=5.0)
    whole = run_path(scene, path, options)
    monkeypatch.setattr("crease.replay.replay._CHUNK", 7)
    parts = run_path(scene, path, options)
    assert np.array_equal(whole["force_N"], parts["force_N"])


def test_single_ticks_agree_with_the_loop(scene_crs: Path, press_csv: Path) -> None:
    scene, path = open_scene(scene_crs), load_trajectory(press_csv)
    rows = run_path(scene, path)
    world = World(scene)
    for i in range(0, 400, 50):
        out = world.tick(path.rows[i, 1:])
        assert out.force_world_N.z == rows["force_N"][i, 2]
        assert out.depth_m == rows["depth_m"][i]


def test_settings_out_of_range_are_refused(scene_crs: Path) -> None:
    with pytest.raises(SceneError, match=r"scene.crs: .*stiffness_N_m: 0\.\.1e6"):
        World(open_scene(scene_crs), ReplayOptions(stiffness_N_m=-1.0))


def test_samples_in_or_out_are_for_the_responses_compared_with(
    folder: Path, scene_crs: Path, press_csv: Path, crease: Run
) -> None:
    with pytest.raises(SceneError, match=r"^vertices_only: .*; use response extent"):
        World(open_scene(scene_crs), ReplayOptions(vertices_only=True))
    out = folder / "hard.csv"
    said = crease("replay", scene_crs, press_csv, "-o", out, "--coverage", "hard")
    assert (said.status, said.out, said.err.count("\n")) == (2, "", 1)
    assert said.err.startswith("error: --coverage hard: ")
    assert "give --response extent too" in said.err
    assert not out.exists()
    words = ("--coverage", "hard", "--response", "extent")
    assert crease("replay", scene_crs, press_csv, "-o", out, *words).status == 0


def test_none_stands_alone_in_a_list_of_skips(
    folder: Path, scene_crs: Path, press_csv: Path, crease: Run
) -> None:
    words = ("replay", scene_crs, press_csv, "-o", folder / "skips.csv", "--skips")
    said = crease(*words, "top,none")
    assert said.status == 2
    assert "'none' stands alone; leave it or the others out" in said.err
    assert "'x' is no skip; known are none, top" in crease(*words, "x").err


def test_damaged_image_is_refused(scene_crs: Path) -> None:
    image = bytearray(scene_crs.read_bytes())
    image[len(image) // 2] ^= 1
    for broken in (b"", b"short", bytes(image), bytes(image[:-64]), bytes(4096)):
        with pytest.raises(SceneError, match=r"^x\.crs: [^;]*[;:] (bake it again|give the .*)$"):
            open_image(broken, "x.crs")


def test_npz_and_csv_hold_the_same_numbers(
    folder: Path, scene_crs: Path, press_csv: Path, press_out: Path, crease: Run
) -> None:
    npz = folder / "press_out.npz"
    assert crease("replay", scene_crs, press_csv, "-o", npz).status == 0
    one, two = read_table(press_out), read_table(npz)
    for name in COLUMNS:
        if name != "tick_ns":
            assert np.array_equal(one[name].astype(two[name].dtype), two[name]), name


def test_path_in_millimetres_is_suspected(
    folder: Path, scene_crs: Path, press_csv: Path, crease: Run
) -> None:
    path = load_trajectory(press_csv)
    mm, off = folder / "mm.csv", folder / "off.csv"
    write_path(mm, 1e3 * path.position_m)
    write_path(off, path.position_m + np.array([0.0, 0.0, 0.1]))
    for source, warned in ((mm, True), (off, False)):
        said = crease("replay", scene_crs, source, "-o", folder / f"{source.stem}_out.csv")
        assert (said.status, "in metres?" in said.err) == (0, warned)


def test_columns_of_a_path_from_arrays(scene_crs: Path) -> None:
    rows = np.array([[0.0, 0, 0, 0.009, 1, 0, 0, 0], [0.001, 0, 0, 0.009, 1, 0, 0, 0]])
    path = check_rows(rows, "here")
    columns = to_columns(path, run_path(open_scene(scene_crs), path))
    assert columns["fz_N"] == pytest.approx([1.0, 1.0], rel=0.05)


@pytest.mark.slow
def test_hundred_thousand_poses_take_a_few_seconds(
    folder: Path, scene_crs: Path, crease: Run
) -> None:
    """The limit is far above the measured time, so that a busy machine does not fail it."""
    way = np.linspace([-0.02, 0.0, 0.008], [0.02, 0.0, 0.009], 100_000)
    path = write_path(folder / "long.csv", way)
    said = crease("replay", scene_crs, path, "-o", folder / "long_out.csv", "--json")
    assert said.status == 0
    assert said.json["ticks"] == 100_000
    assert said.json["time_s"] < 30.0
