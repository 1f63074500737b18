"""`crease view`: contacts read out of the ticks, meshes beside the image, numbers packed, bad input refused."""

from __future__ import annotations

import base64
import gzip
import html
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from crease.bake.bodies import Body, read_bodies, reduce_body
from crease.base.attitude import to_matrix
from crease.base.errors import CreaseError, SceneError
from crease.base.native import ffi, lib
from crease.base.scene import Scene, meshes_path, open_scene
from crease.base.table import read_table, write_table
from crease.draw.plot import forces_N
from crease.draw.view.felt import amplifications, areas_of, jumps, stiffness_N_m
from crease.draw.view.pack import LIMIT, Packer
from crease.draw.view.scripts import load_scripts
from crease.replay.contacts import (
    NO_PATCH,
    Contacts,
    find_contacts,
    tool_samples_m,
)
from crease.replay.measures import angle_deg
from crease.replay.replay import ReplayOptions, run_path, to_columns
from crease.replay.trajectory import check_rows, load_trajectory
from host_tools import Run, write_path

PUBLISHED = ReplayOptions(response="extent", coverage="hard")
"""Samples in or out: those in contact are those inside."""
METHODS = (ReplayOptions(), ReplayOptions(response="extent"), PUBLISHED)
"""Responses that part contact into areas and zones in their own way."""
BUILD = Path(__file__).resolve().parents[2] / "build"


def states_after(contacts: Contacts, tick: int, samples: int) -> np.ndarray[Any, Any]:
    """Area and patch of every sample after a tick, (samples, 2): all changes up to it, one by one."""
    states = np.tile(np.array([0, NO_PATCH]), (samples, 1))
    for change in contacts.changes[: int(contacts.ticks["changes"][: tick + 1].sum())]:
        states[int(change["sample"])] = int(change["area"]), int(change["patch"])
    return states


@pytest.mark.parametrize("options", METHODS, ids=lambda o: f"{o.response}-{o.coverage}")
def test_contacts_are_those_of_the_replay(
    folder: Path, scene_crs: Path, press_csv: Path, crease: Run, options: ReplayOptions
) -> None:
    out = folder / f"contacts_{options.response}_{options.coverage}.csv"
    words = ("--response", options.response, "--coverage", options.coverage)
    assert crease("replay", scene_crs, press_csv, "-o", out, *words).status == 0
    table = read_table(out)
    ticks = find_contacts(open_scene(scene_crs), load_trajectory(press_csv), options).ticks
    for name in ("areas", "zones", "contacts"):
        assert np.array_equal(ticks[name], table[name]), name


@pytest.mark.parametrize("response", ["extent", "deepest_group", "god_object", "voxmap"])
def test_other_methods_are_shown_with_the_contacts_of_ours(
    folder: Path, scene_crs: Path, press_csv: Path, crease: Run, response: str
) -> None:
    out, page = folder / f"{response}.csv", folder / f"{response}.html"
    assert crease("replay", scene_crs, press_csv, "-o", out, "--response", response).status == 0
    said = crease("view", out, "--scene", scene_crs, "-o", page)
    assert (said.status, said.err) == (0, "")
    assert page.stat().st_size > 100_000


def test_samples_in_contact_are_those_below_the_plane(scene_crs: Path, press_csv: Path) -> None:
    scene, path = open_scene(scene_crs), load_trajectory(press_csv)
    samples_m = tool_samples_m(scene)
    assert len(samples_m) == scene.meta.point_count
    assert np.linalg.norm(samples_m, axis=1) == pytest.approx(0.01, rel=0.01)
    contacts = find_contacts(scene, path, PUBLISHED)
    for tick in (150, 199, 300, 399):
        touching = states_after(contacts, tick, len(samples_m))[:, 0] > 0
        height_m = samples_m[:, 2] + path.position_m[tick, 2]  # the top of the block is z = 0
        assert touching[height_m < -1e-5].all()
        assert not touching[height_m > 1e-5].any()


def test_one_flat_face_is_one_zone_and_one_area(scene_crs: Path, press_csv: Path) -> None:
    scene, path = open_scene(scene_crs), load_trajectory(press_csv)
    contacts = find_contacts(scene, path, ReplayOptions())
    (patch,) = set(contacts.zones["patch"].tolist())
    touched = contacts.changes[contacts.changes["area"] > 0]
    assert set(touched["area"].tolist()) == {1}
    assert set(touched["patch"].tolist()) == {patch}
    assert contacts.zones["normal"] == pytest.approx(
        np.tile([0.0, 0.0, 1.0], (len(contacts.zones), 1))
    )
    assert contacts.zones["share"] == pytest.approx(1.0)
    points_m = contacts.ticks["point_m"][250:]
    assert points_m[:, :2] == pytest.approx(path.position_m[250:, :2], abs=5e-4)


@pytest.mark.slow
def test_an_area_keeps_its_label_while_it_lasts(folder: Path, block_stl: Path, crease: Run) -> None:
    legs = [
        trimesh.creation.box(bounds=[[x, -5, 0], [x + 8, 5, 20]]).apply_translation([0, 0, 0])
        for x in (-20, 12)
    ]
    bridge = trimesh.creation.box(bounds=[[-20, -5, 15], [20, 5, 25]])
    tool, scene_path = folder / "legs.stl", folder / "legs.crs"
    trimesh.boolean.union([*legs, bridge]).export(tool)
    said = crease("bake", block_stl, tool, "-o", scene_path, "--unit", "mm", "--spacing", "1.5mm")
    assert said.status == 0, said.err
    # Rocking about y: left leg alone, both, right leg alone.
    tilt = np.linspace(0.06, -0.06, 400)
    rows = np.zeros((400, 8))
    rows[:, 0] = 1e-3 * np.arange(400)
    rows[:, 3] = 0.2e-3 - 0.019 * np.abs(np.sin(tilt)) + 0.019 * np.abs(tilt)
    rows[:, 3] -= 0.6e-3
    rows[:, 4], rows[:, 6] = np.cos(tilt / 2), np.sin(-tilt / 2)
    scene = open_scene(scene_path)
    contacts = find_contacts(scene, check_rows(rows, "rocking"), PUBLISHED)
    samples_m = tool_samples_m(scene)
    sides: list[set[int]] = [set(), set()]
    both = 0
    for tick in range(0, 400, 10):
        states = states_after(contacts, tick, len(samples_m))
        now = [set(states[(samples_m[:, 0] * s > 0) & (states[:, 0] > 0), 0]) for s in (-1, 1)]
        both += all(now)
        sides = [side | labels for side, labels in zip(sides, now, strict=True)]
    assert both > 3
    assert [len(side) for side in sides] == [1, 1]
    assert sides[0] != sides[1]


@pytest.mark.parametrize("name", ["bar_u", "edge90_cube"])
def test_samples_in_contact_are_those_inside_the_voxmap(name: str) -> None:
    scene = open_scene(BUILD / "scenes" / f"{name}.crs")
    path = load_trajectory(BUILD / "meshes" / f"{name}.csv")
    contacts = find_contacts(scene, path, PUBLISHED)
    samples_m = tool_samples_m(scene)
    checked = 0
    for tick in range(0, len(path), 97):
        turned_m = samples_m @ to_matrix(path.rows[tick, 4:]).T
        phi_m = look_up_m(scene, turned_m + path.position_m[tick])
        touching = states_after(contacts, tick, len(samples_m))[:, 0] > 0
        if contacts.ticks["areas"][tick] == 0:
            assert not touching.any()
            continue
        assert touching[phi_m < -1e-6].all(), tick
        assert not touching[phi_m > 1e-6].any(), tick
        checked += int(touching.sum())
    assert checked > 500


def look_up_m(scene: Scene, points_m: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Distance at world points, one by one, without tree, clusters or coherence."""
    points = np.ascontiguousarray(points_m, dtype=np.float32)
    phi_m, gradient = np.zeros(len(points), np.float32), np.zeros_like(points)
    kind, facet = np.zeros((2, len(points)), np.uint32)
    floats = [ffi.from_buffer("float[]", a) for a in (points, phi_m, gradient)]
    integers = [ffi.from_buffer("uint32_t[]", a) for a in (kind, facet)]
    lib.crp_look_up(scene.handle, floats[0], len(points), *floats[1:], *integers)
    return phi_m


def decode(packer: Packer, name: str) -> np.ndarray[Any, Any]:
    """An array as the page reads it, written from the description of the format alone."""
    data = gzip.decompress(base64.b64decode(packer.encode()))
    place = packer.header[name]
    size = place["rows"] * place["columns"]
    columns = []
    for c in range(place["columns"]):
        total, column = 0, []
        for i in range(place["rows"]):
            at = place["start"] + c * place["rows"] + i
            folded = sum(data[at + k * size] << 8 * k for k in range(place["width"]))
            total += folded // 2 if folded % 2 == 0 else -(folded + 1) // 2
            column.append(total)
        columns.append(column)
    return np.asarray(place["step"] * np.array(columns).T)


def test_packed_numbers_come_back_within_the_resolution() -> None:
    rng = np.random.default_rng(4)
    packer = Packer()
    walk = np.cumsum(rng.normal(0.0, 1e-4, (300, 3)), axis=0)
    jumps = rng.integers(-LIMIT, LIMIT + 1, 300)
    packer.add_numbers("walk", walk, 1e-6)
    packer.add_integers("jumps", jumps)
    packer.add_numbers("huge", walk * 1e12, 1e-6)
    packer.add_integers("none", np.zeros((0, 2), np.int64))
    assert np.abs(decode(packer, "walk") - walk).max() <= 0.5001e-6
    assert np.array_equal(decode(packer, "jumps")[:, 0], jumps)
    assert np.abs(decode(packer, "huge") - walk * 1e12).max() <= 1e12 * np.abs(walk).max() / LIMIT
    assert packer.header["none"]["rows"] == 0


def test_bake_keeps_the_meshes_beside_the_image(scene_crs: Path) -> None:
    static, tool = read_bodies(open_scene(scene_crs))
    assert static.vertices_m.min(axis=0) == pytest.approx([-0.04, -0.04, -0.04])
    assert static.vertices_m.max(axis=0) == pytest.approx([0.04, 0.04, 0.0])
    volume_m3 = trimesh.Trimesh(tool.vertices_m, tool.triangles, process=False).volume
    assert volume_m3 == pytest.approx(4 / 3 * np.pi * 0.01**3, rel=0.02)


def test_large_bodies_are_reduced_and_keep_their_shape() -> None:
    ball = trimesh.creation.icosphere(subdivisions=6, radius=0.1)
    body = Body(np.asarray(ball.vertices), np.asarray(ball.faces))
    small = reduce_body(body, 10_000)
    assert 4_000 < len(small.triangles) <= 10_000
    assert np.linalg.norm(small.vertices_m, axis=1) == pytest.approx(0.1, abs=1e-9)
    mesh = trimesh.Trimesh(small.vertices_m, small.triangles, process=False)
    assert mesh.area == pytest.approx(4 * np.pi * 0.1**2, rel=0.02)
    assert reduce_body(body, 10**6) is body


def test_a_table_is_a_path(folder: Path, scene_crs: Path, press_out: Path, crease: Run) -> None:
    again = folder / "again.csv"
    assert crease("replay", scene_crs, press_out, "-o", again).status == 0
    before, after = read_table(press_out), read_table(again)
    for name in before:
        if name != "tick_ns":
            assert np.array_equal(before[name], after[name]), name


def test_libraries_are_those_of_the_lock_file() -> None:
    lock = json.loads((BUILD.parent / "host/package-lock.json").read_text("utf-8"))["packages"]
    scripts = load_scripts()
    for name in ("three", "uplot"):
        locked = lock[f"node_modules/{name}"]
        assert f"{name} {locked['version']} ({locked['license']}, Copyright" in scripts.notice
        assert "resolved" not in locked
    assert "Three.js Authors" in scripts.three[:200]
    assert "leeoniya" in scripts.uplot[:200]
    assert "</script" not in scripts.three + scripts.uplot


def test_libraries_that_are_not_there_are_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("crease.draw.view.scripts.FOLDER", tmp_path)
    with pytest.raises(CreaseError, match=r"three\.js and uPlot are not there; run"):
        load_scripts()


def test_page_needs_no_other_file(
    folder: Path, scene_crs: Path, press_out: Path, crease: Run
) -> None:
    page = folder / "press.html"
    said = crease("view", press_out, "--scene", scene_crs, "-o", page, "--json")
    assert said.status == 0, said.err
    assert said.json["page_bytes"] == page.stat().st_size < 2_000_000
    assert said.json["ticks"] == 400
    assert said.json["warnings"] == []
    text = page.read_text(encoding="utf-8")
    assert "default-src 'none'" in text
    assert html.escape(load_scripts().notice) in text
    assert "@@" not in text.split("<script>")[0]


def refuse(said: Any, page: Path, *words: str) -> None:
    """One line that says all the words, and no page."""
    assert said.status == 1
    assert said.err.startswith("error: ")
    assert said.err.count("\n") == 1, said.err
    for word in words:
        assert word in said.err, said.err
    assert not page.exists()


def test_missing_meshes_are_named(
    folder: Path, scene_crs: Path, press_out: Path, crease: Run
) -> None:
    bare, page = folder / "bare.crs", folder / "bare.html"
    bare.write_bytes(scene_crs.read_bytes())
    said = crease("view", press_out, "--scene", bare, "-o", page)
    refuse(said, page, "bare.crs.glb", "bake it again")
    meshes_path(bare).write_bytes(b"glTF and then rubbish")
    refuse(
        crease("view", press_out, "--scene", bare, "-o", page), page, "is a GLB of version", "bake"
    )


@pytest.mark.slow
def test_meshes_of_another_scene_are_refused(
    folder: Path, scene_crs: Path, block_stl: Path, crease: Run
) -> None:
    tool, other = folder / "die.stl", folder / "die.crs"
    trimesh.creation.box(extents=[12, 12, 12]).export(tool)
    assert (
        crease("bake", block_stl, tool, "-o", other, "--unit", "mm", "--spacing", "2mm").status == 0
    )
    mixed = folder / "mixed.crs"
    mixed.write_bytes(scene_crs.read_bytes())
    meshes_path(mixed).write_bytes(meshes_path(other).read_bytes())
    with pytest.raises(SceneError, match="other meshes"):
        read_bodies(open_scene(mixed))


@pytest.mark.slow
def test_table_of_another_scene_is_refused(
    folder: Path, press_out: Path, block_stl: Path, crease: Run
) -> None:
    tool, other, page = folder / "bead.stl", folder / "bead.crs", folder / "bead.html"
    trimesh.creation.icosphere(subdivisions=3, radius=6.0).export(tool)
    assert (
        crease("bake", block_stl, tool, "-o", other, "--unit", "mm", "--spacing", "2mm").status == 0
    )
    said = crease("view", press_out, "--scene", other, "-o", page)
    refuse(said, page, "does not give the contacts of press_out")


def test_old_and_damaged_tables_are_refused(
    folder: Path, scene_crs: Path, press_out: Path, crease: Run
) -> None:
    page, table = folder / "damaged.html", read_table(press_out)
    old, bad, short = folder / "old.npz", folder / "nan.npz", folder / "short.npz"
    write_table(old, {name: table[name] for name in table if name != "qw"})
    refuse(crease("view", old, "--scene", scene_crs, "-o", page), page, "no column qw", "replay it")
    force = table["fx_N"].copy()
    force[7] = np.nan
    write_table(bad, {**table, "fx_N": force})
    refuse(crease("view", bad, "--scene", scene_crs, "-o", page), page, "fx_N", "finite")
    np.savez(short, **{**table, "depth_m": table["depth_m"][:-1]})  # type: ignore[arg-type]
    refuse(crease("view", short, "--scene", scene_crs, "-o", page), page, "one length")


def test_damaged_meshes_of_a_scene_are_told_in_plain_words(
    folder: Path, scene_crs: Path, press_out: Path, crease: Run
) -> None:
    image, page = folder / "hurt.crs", folder / "hurt.html"
    image.write_bytes(scene_crs.read_bytes())
    data = meshes_path(scene_crs).read_bytes()
    for hurt, reason in (
        (b"", "is an empty file"),
        (data[:1], "is no GLB"),
        (data[:12], "is cut off within its head: 12 bytes"),
        (data[:-1], f"is cut off: it holds {len(data) - 1:,} of {len(data):,} bytes"),
    ):
        meshes_path(image).write_bytes(hurt)
        said = crease("view", press_out, "--scene", image, "-o", page)
        refuse(said, page, f"{meshes_path(image)}: {reason}", "bake the scene again")


def test_outputs_and_numbers_of_replays_are_checked(
    folder: Path, scene_crs: Path, press_out: Path, crease: Run
) -> None:
    page = folder / "five.html"
    said = crease("view", *[press_out] * 5, "--scene", scene_crs, "-o", page)
    refuse(said, page, "4 at most")
    wrong = folder / "page.pdf"
    refuse(crease("view", press_out, "--scene", scene_crs, "-o", wrong), wrong, ".html")
    page.write_text("mine")
    said = crease("view", press_out, "--scene", scene_crs, "-o", page)
    assert (said.status, page.read_text()) == (1, "mine")


def test_bake_does_not_replace_meshes_unasked(
    folder: Path, block_stl: Path, ball_stl: Path, crease: Run
) -> None:
    image = folder / "asked.crs"
    meshes_path(image).write_bytes(b"mine")
    said = crease("bake", block_stl, ball_stl, "-o", image, "--unit", "mm")
    assert said.status == 1
    assert "asked.crs.glb: exists already" in said.err
    assert meshes_path(image).read_bytes() == b"mine"


def test_options_of_the_loop_that_runs_are_refused_without_it(
    tmp_path: Path, scene_crs: Path, press_csv: Path, crease: Run
) -> None:
    line = ["view", scene_crs, press_csv, "-o", tmp_path / "page.html"]
    for option in (
        ["--stiffness", "500"],
        ["--response", "extent"],
        ["--port", "8000"],
        ["--seconds", "1"],
        ["--no-open"],
    ):
        said = crease(*line, *option)
        assert (said.status, said.err) == (
            2,
            f"error: {option[0]} is of the loop while it runs; give --live too; see `crease view --help`\n",
        )
    assert not (tmp_path / "page.html").exists()


def test_a_path_with_a_column_of_text_is_a_path(
    tmp_path: Path, scene_crs: Path, press_csv: Path, crease: Run
) -> None:
    head, *rows = press_csv.read_text().splitlines()
    path = tmp_path / "noted.csv"
    path.write_text("\n".join([f"{head},note", *(f"{row},a" for row in rows)]))
    said = crease("view", scene_crs, path, "-o", tmp_path / "page.html")
    assert said.status == 0, said.err


def test_free_path_makes_a_page(folder: Path, scene_crs: Path, crease: Run) -> None:
    path = write_path(folder / "free.csv", np.tile([0.0, 0.0, 0.05], (1, 1)))
    out, page = folder / "free_out.csv", folder / "free.html"
    assert crease("replay", scene_crs, path, "-o", out).status == 0
    said = crease("view", out, "--scene", scene_crs, "-o", page)
    assert said.status == 0, said.err


def test_times_of_a_replay_are_the_least_of_its_repeats(
    folder: Path, scene_crs: Path, press_csv: Path, crease: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    from crease.replay import replay

    calls: list[int] = []
    run = replay.World.run

    def late_once(self: replay.World, *args: Any) -> Any:
        rows = run(self, *args)
        calls.append(len(rows))
        rows["tick_ns"][len(calls)] = 5_000_000  # the scheduler came, each time in another tick
        return rows

    monkeypatch.setattr(replay.World, "run", late_once)
    out = folder / "repeats.npz"
    assert crease("replay", scene_crs, press_csv, "-o", out).status == 0
    assert len(calls) == 5
    assert read_table(out)["tick_ns"].max() < 5_000_000
    assert set(read_table(out)["runs"]) == {5}
    assert crease("replay", scene_crs, press_csv, "-o", out, "--force", "--repeat", "1").status == 0
    assert read_table(out)["tick_ns"].max() == 5_000_000
    assert set(read_table(out)["runs"]) == {1}


@pytest.mark.parametrize(
    ("response", "damping"), [("way_out", 0), ("extent", 0), ("fixed45", 0), ("way_out", 5)]
)
def test_forces_of_the_areas_make_the_force_of_the_table(response: str, damping: int) -> None:
    scene = open_scene(BUILD / "scenes" / "part_spanner.crs")
    path = load_trajectory(BUILD / "meshes" / "part_spanner.csv")
    options = ReplayOptions(700.0, damping, response)
    table = to_columns(path, run_path(scene, path, options))
    assert stiffness_N_m(table) == pytest.approx(700.0, rel=0.01)
    areas = areas_of(scene, path, options, table)
    assert np.array_equal(areas.counts, table["areas"])
    force_N = forces_N(table)
    total_N = np.array([areas.of(i)["force_N"].sum(axis=0) for i in range(len(path))])
    assert np.linalg.norm(total_N, axis=1) == pytest.approx(
        np.linalg.norm(force_N, axis=1), abs=1e-4
    )
    off_deg = angle_deg(total_N, force_N)
    if damping == 0:
        assert off_deg.max() < 0.01
    else:  # it is shared among the areas in another way
        assert np.percentile(off_deg, 95) < 5.0


def test_a_jump_is_the_largest_of_its_neighbours() -> None:
    force_N = np.zeros((100, 3))
    force_N[10:, 0], force_N[12:, 0], force_N[50:, 0] = 1.0, 3.0, 2.5
    amplification = amplifications(force_N, 1000.0, np.full(99, 1e-5))
    assert amplification[[9, 10, 12, 50]].tolist() == pytest.approx([0.0, 100.0, 200.0, 50.0])
    assert jumps(force_N, amplification).tolist() == [12, 50]
    assert jumps(force_N, amplification / 51.0).tolist() == []
