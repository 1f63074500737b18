"""`crease check`: facts of meshes that are known beforehand, exit status, the picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from crease.bake.check import Findings, thinnest_wall
from crease.bake.surface import make_surface
from crease.draw import findings
from crease.mesh.mesh import make_mesh
from host_tools import Run
from mpl_toolkits.mplot3d.art3d import Line3DCollection  # type: ignore[import-untyped]


@pytest.fixture
def plate(tmp_path: Path) -> Path:
    """100 x 60 x 2 mm."""
    path = tmp_path / "plate.stl"
    trimesh.creation.box(extents=[100, 60, 2]).export(path)
    return path


def test_a_clean_mesh_is_taken_as_it_is(plate: Path, crease: Run) -> None:
    said = crease("check", plate, "--unit", "mm", "--voxel", "4", "--json")
    assert said.status == 0
    (one,) = said.json["meshes"]
    assert one["closed"]
    assert (one["crossings"], one["shells"], one["accepted"]) == (0, 1, True)
    assert one["volume_m3"] == pytest.approx(12e-6)
    assert one["thinnest_wall_m"] == pytest.approx(2e-3, rel=1e-3)
    assert one["sharpest_edge_deg"] == pytest.approx(90.0)
    assert (one["convex_creases"], one["concave_creases"]) == (12, 0)
    assert one["bake"] == []
    text = crease("check", plate, "--unit", "mm", "--voxel", "4").out
    assert "thinnest wall  2 mm, 0.5 voxels: thinner than a voxel" in text
    assert "takes it as it is" in text


def test_what_is_wrong_is_counted_with_places_in_the_unit_of_the_file(
    tmp_path: Path, crease: Run
) -> None:
    one, two = trimesh.creation.box(extents=[20] * 3), trimesh.creation.box(extents=[20] * 3)
    two.apply_translation([7, 8, 9])
    lid = one.triangles_center[:, 0] < -9.9
    one.update_faces(~lid)
    trimesh.util.concatenate([one, two]).export(tmp_path / "two.stl")
    said = crease("check", tmp_path / "two.stl", "--unit", "mm", "--json")
    assert said.status == 0
    (found,) = said.json["meshes"]
    assert not found["closed"]
    assert found["open_edges"] == 4
    assert found["open_at"][0] == pytest.approx(-10.0)
    assert found["crossings"] > 0
    assert np.all(np.abs(found["crossing_at"]) < 20.0)
    assert any("closed 1 hole" in line or "closed 1 opening" in line for line in found["bake"])


@pytest.mark.parametrize(
    ("sides", "told"),
    [
        ((100, 100, 0.05), "100 x 100 x 0.05 mm"),
        ((100, 100, 0.0123), "100 x 100 x 0.0123 mm"),
        ((1.0, 20.26, 30), "1 x 20.26 x 30 mm"),
    ],
)
def test_the_size_has_the_digits_of_its_smallest_side(
    sides: tuple[float, float, float], told: str, tmp_path: Path, crease: Run
) -> None:
    path = tmp_path / "thin.stl"
    trimesh.creation.box(extents=sides).export(path)
    assert f"12 triangles, {told}\n" in crease("check", path, "--unit", "mm").out


def test_a_shell_inside_another_meets_nothing(tmp_path: Path, crease: Run) -> None:
    boxes = [trimesh.creation.box(extents=[side] * 3) for side in (20.0, 8.0)]
    path = tmp_path / "nested.stl"
    trimesh.util.concatenate(boxes).export(path)
    said = crease("check", path, "--unit", "mm").out
    assert "dropped 1 shell wholly inside another" in said
    assert "meet" not in said
    boxes[1].apply_translation([10.0, 0.0, 0.0])
    trimesh.util.concatenate(boxes).export(path)
    assert "united 2 shells that meet into 1 shell" in crease("check", path, "--unit", "mm").out
    boxes[1].apply_translation([-4.0, 0.0, 0.0])  # inside, flush with a face
    trimesh.util.concatenate(boxes).export(path)
    assert "shells that meet" in crease("check", path, "--unit", "mm").out


def test_turned_triangles_are_told_and_not_called_open(
    tmp_path: Path, plate: Path, crease: Run
) -> None:
    box = trimesh.creation.box(extents=[100, 60, 2])
    faces = np.array(box.faces)
    faces[3] = faces[3, ::-1]
    turned, opened = tmp_path / "turned.stl", tmp_path / "opened.stl"
    trimesh.Trimesh(box.vertices, faces, process=False).export(turned)
    trimesh.Trimesh(box.vertices, faces[:-1], process=False).export(opened)
    said = crease("check", turned, opened, plate, "--unit", "mm")
    assert said.status == 0, said.err
    closed = [line for line in said.out.splitlines() if line.startswith("closed")]
    what = "3 edges with two triangles that run the same way, near ("
    assert f"  yes, but {what}" in closed[0]
    assert "  no: 3 open edges, 0 with" in closed[1]
    assert f"; {what}" in closed[1]
    assert closed[2].endswith("  yes")
    one, two, _ = crease("check", turned, opened, plate, "--unit", "mm", "--json").json["meshes"]
    assert (one["closed"], one["open_edges"], one["turned_edges"]) == (True, 0, 3)
    assert (two["closed"], two["open_edges"], two["turned_edges"]) == (False, 3, 3)


def test_a_mesh_without_a_sharp_edge_says_so(tmp_path: Path, crease: Run) -> None:
    trimesh.creation.icosphere(3, radius=20.0).export(tmp_path / "ball.stl")
    line = ["check", tmp_path / "ball.stl", "--unit", "mm", "--crease-angle", "25"]
    assert "sharpest edge  none over 25 deg\n" in crease(*line).out
    (one,) = crease(*line, "--json").json["meshes"]
    assert (one["sharpest_edge_deg"], one["sharpest_edge_at"]) == (None, None)


def test_a_mesh_that_would_be_refused_is_told_after_the_others(
    tmp_path: Path, plate: Path, crease: Run
) -> None:
    flat = tmp_path / "flat.stl"
    trimesh.Trimesh(
        [[0, 0, 0], [50, 0, 0], [50, 50, 0], [0, 50, 0]], [[0, 1, 2], [0, 2, 3]]
    ).export(flat)
    said = crease("check", flat, plate, "--unit", "mm")
    assert said.status == 1
    assert "1 of 2 would be refused" in said.err
    assert "--sheet 1mm" in said.err
    assert f"{plate}: 12 triangles" in said.out
    assert crease("check", flat, "--unit", "mm", "--sheet", "1").status == 0


def test_a_file_that_cannot_be_read_is_told_after_the_others(
    tmp_path: Path, plate: Path, crease: Run
) -> None:
    bad = tmp_path / "garbage.stl"
    bad.write_bytes(b"not a mesh at all")
    for order in ((plate, bad), (bad, plate)):
        said = crease("check", *order, "--unit", "mm")
        assert said.status == 1
        assert f"{plate}: 12 triangles" in said.out
        assert "1 of 2 cannot be read" in said.err
        assert f"{bad}: is cut off" in said.err
        assert said.err.count("error: ") == 1
    said = crease("check", plate, bad, "--unit", "mm", "--json")
    assert said.status == 1
    assert [one["triangles"] for one in said.json["meshes"]] == [12]


def test_every_file_that_cannot_be_read_is_listed_where_it_stands(
    tmp_path: Path, plate: Path, crease: Run
) -> None:
    gone, bad, picture = tmp_path / "gone.stl", tmp_path / "bad.xyz", tmp_path / "found.png"
    bad.write_text("junk")
    said = crease("check", gone, plate, bad, "--unit", "mm", "-o", picture)
    heads = [line.split()[:2] for line in said.out.splitlines() if line[:6] in ("unread", "mesh  ")]
    assert heads == [["unread", f"{gone}:"], ["mesh", f"{plate}:"], ["unread", f"{bad}:"]]
    assert said.status == 1
    assert said.err.startswith(f"error: 2 of 3 cannot be read; {gone}: ")
    assert picture.read_bytes()[:4] == b"\x89PNG"
    report = crease("check", gone, plate, bad, "--unit", "mm", "--json").json
    assert [text.split(": ")[0] for text in report["unread"]] == [str(gone), str(bad)]


def test_noise_is_told_as_a_bake_tells_it(tmp_path: Path, crease: Run) -> None:
    ball = trimesh.creation.icosphere(4, radius=20.0)
    ball.vertices += np.random.default_rng(3).normal(0.0, 0.35, ball.vertices.shape)
    ball.export(tmp_path / "noisy.stl")
    said = crease("check", tmp_path / "noisy.stl", "--unit", "mm")
    assert said.status == 0
    assert "this looks like noise; --crease-angle 90 leaves" in said.out


def test_the_picture_is_written(tmp_path: Path, plate: Path, crease: Run) -> None:
    picture = tmp_path / "found.png"
    assert crease("check", plate, "--unit", "mm", "-o", picture).status == 0
    assert picture.read_bytes()[:4] == b"\x89PNG"
    assert crease("check", plate, "--unit", "mm", "-o", picture).status == 1


def test_the_picture_shows_the_creases_of_a_part(
    tmp_path: Path, plate: Path, crease: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Any] = []
    draw = findings._draw_one

    def kept(axes: Any, one: Findings) -> None:
        draw(axes, one)
        drawn.extend(lines for lines in axes.collections if isinstance(lines, Line3DCollection))

    monkeypatch.setattr(findings, "_draw_one", kept)
    assert crease("check", plate, "--unit", "mm", "-o", tmp_path / "found.png").status == 0
    (lines,) = drawn
    sides = [np.ptp(ends, axis=0).sum() for ends in lines._segments3d]
    assert np.sort(sides) == pytest.approx([2.0] * 4 + [60.0] * 4 + [100.0] * 4)


def test_the_picture_names_its_axes_and_takes_any_name_of_a_file(
    tmp_path: Path,
    plate: Path,
    crease: Run,
    recwarn: pytest.WarningsRecorder,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    drawn: list[tuple[str, ...]] = []
    draw = findings._draw_one

    def kept(axes: Any, one: Findings) -> None:
        draw(axes, one)
        drawn.append((axes.get_xlabel(), axes.get_ylabel(), axes.get_zlabel()))

    monkeypatch.setattr(findings, "_draw_one", kept)
    other = plate.rename(tmp_path / "$x^{$ 立方.stl")
    said = crease("check", other, "--unit", "mm", "-o", tmp_path / "found.png")
    assert (said.status, said.err) == (0, "")
    assert drawn == [("x, mm", "y, mm", "z, mm")]
    assert not recwarn.list


@pytest.mark.slow
def test_the_thinnest_wall_of_a_hollow_ball_is_its_shell() -> None:
    outer = trimesh.creation.icosphere(4, radius=10.0)
    inner = trimesh.creation.icosphere(4, radius=9.0)
    inner.apply_translation([0.4, 0.0, 0.0])
    inner.invert()
    whole = trimesh.util.concatenate([outer, inner])
    mesh = make_mesh(whole.vertices, whole.faces, 1e-3)
    wall_m, at_m = thinnest_wall(make_surface(mesh, 30.0))
    assert wall_m == pytest.approx(0.6e-3, rel=0.05)
    assert at_m[0, 0] == pytest.approx(9.7e-3, rel=0.03)
