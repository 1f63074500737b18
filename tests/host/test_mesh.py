"""Meshes from files and arrays: what is mended, what is refused, and what is said about it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import igl
import numpy as np
import numpy.typing as npt
import pytest
import trimesh
from crease.bake.surface import make_surface
from crease.base.errors import MeshError
from crease.mesh import topology
from crease.mesh.mesh import Mesh, load_mesh, make_mesh, read_arrays
from hypothesis import given, settings
from hypothesis import strategies as st

FIRST = np.array([[0, 1, 2]])
Arrays = tuple[npt.NDArray[Any], npt.NDArray[Any]]


def box(low: Any = (0, 0, 0), high: Any = (1, 1, 1)) -> Arrays:
    """A box of 12 triangles with 8 vertices."""
    mesh = trimesh.creation.box(bounds=[low, high])
    return np.array(mesh.vertices), np.array(mesh.faces)


def both(one: Arrays, two: Arrays) -> Arrays:
    """Two meshes as one."""
    return np.concatenate([one[0], two[0]]), np.concatenate([one[1], two[1] + len(one[0])])


def volume(mesh: Mesh) -> float:
    return float(topology.volumes_m3(mesh.vertices_m, mesh.triangles).sum())


def assert_sound(mesh: Mesh) -> None:
    """Closed, consistently oriented, positive volume: what Mesh promises."""
    assert mesh.vertices_m.dtype == np.float64
    assert mesh.triangles.dtype == np.int32
    assert len(topology.unbalanced_edges(mesh.triangles, len(mesh.vertices_m))) == 0
    assert volume(mesh) > 0.0


def test_sound_box_passes_without_warning() -> None:
    mesh = make_mesh(*box())
    assert_sound(mesh)
    assert mesh.warnings == ()
    assert volume(mesh) == pytest.approx(1.0)


def test_a_mesh_prints_its_name_counts_and_size() -> None:
    mesh = make_mesh(*box((0, 0, 0), (0.1, 0.06, 0.002)), source="plate")
    assert repr(mesh) == "Mesh('plate': 8 vertices, 12 triangles, 100 mm x 60 mm x 2 mm)"


def test_triangle_soup_is_welded_without_warning() -> None:
    vertices, triangles = box()
    mesh = make_mesh(vertices[triangles].reshape(-1, 3), np.arange(36).reshape(-1, 3))
    assert_sound(mesh)
    assert (len(mesh.vertices_m), mesh.warnings) == (8, ())


def test_rounded_soup_is_sewn_with_a_warning() -> None:
    vertices, triangles = box()
    noise = np.random.default_rng(0).normal(0.0, 1e-8, (36, 3))
    mesh = make_mesh(vertices[triangles].reshape(-1, 3) + noise, np.arange(36).reshape(-1, 3))
    assert_sound(mesh)
    assert "welded 28 vertices" in mesh.warnings[0]


def test_inverted_mesh_is_turned() -> None:
    vertices, triangles = box()
    mesh = make_mesh(vertices, triangles[:, ::-1], source="part.stl")
    assert_sound(mesh)
    assert mesh.warnings == ("part.stl: was inside out: turned 12 triangles",)


@given(st.sets(st.integers(0, 11), min_size=1, max_size=11))
def test_any_mix_of_turned_triangles_is_put_right(turned: set[int]) -> None:
    vertices, triangles = box()
    chosen = sorted(turned)
    triangles[chosen] = triangles[chosen][:, ::-1]
    mesh = make_mesh(vertices, triangles)
    assert_sound(mesh)
    assert volume(mesh) == pytest.approx(1.0)
    assert "turned" in mesh.warnings[0]


def test_moebius_strip_is_refused() -> None:
    u = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    rim = [
        np.stack([(1 + s * np.cos(u / 2)) * np.cos(u), (1 + s * np.cos(u / 2)) * np.sin(u), s * np.sin(u / 2)], 1)
        for s in (-0.3, 0.3)
    ]  # fmt: skip
    i = np.arange(39)
    triangles = np.concatenate(
        [np.stack([i, i + 1, i + 40], 1), np.stack([i + 1, i + 41, i + 40], 1), [[39, 40, 79], [40, 0, 79]]]
    )  # fmt: skip
    with pytest.raises(MeshError, match="open"):
        make_mesh(np.concatenate(rim), triangles)


def test_one_missing_triangle_is_closed() -> None:
    vertices, triangles = box()
    mesh = make_mesh(vertices, triangles[1:])
    assert_sound(mesh)
    assert "closed 1 hole with 1 triangle" in mesh.warnings[0]
    assert volume(mesh) == pytest.approx(1.0)


def test_round_hole_in_a_ball_is_capped() -> None:
    ball = trimesh.creation.icosphere(4)
    triangles = ball.faces[ball.triangles_center[:, 2] < 0.95]
    mesh = make_mesh(ball.vertices, triangles)
    assert_sound(mesh)
    assert "closed 1 hole" in mesh.warnings[0]


def test_box_without_lid_is_closed_with_a_place_and_strictly_refused() -> None:
    vertices, triangles = box()
    lid = (vertices[triangles][:, :, 2] == 1.0).all(axis=1)
    mesh = make_mesh(vertices, triangles[~lid], source="part")
    assert_sound(mesh)
    assert volume(mesh) == pytest.approx(1.0)
    assert "closed 1 opening, 20 % of the surface" in mesh.warnings[0]
    assert "near (0.5, 0.5, 1) m" in mesh.warnings[0]
    with pytest.raises(MeshError, match=r"part: closed 1 opening, .*; strict=True refuses"):
        make_mesh(vertices, triangles[~lid], source="part", strict=True)


def test_duplicate_triangles_are_dropped() -> None:
    vertices, triangles = box()
    mesh = make_mesh(vertices, np.concatenate([triangles, triangles[:3]]))
    assert_sound(mesh)
    assert len(mesh.triangles) == 12
    assert "dropped 3 duplicate triangles" in mesh.warnings[0]


def test_duplicate_triangle_of_other_winding_is_dropped() -> None:
    vertices, triangles = box()
    mesh = make_mesh(vertices, np.concatenate([triangles, triangles[:1, ::-1]]))
    assert_sound(mesh)
    assert len(mesh.triangles) == 12


def test_neighbours_that_stand_in_both_windings_are_no_holes() -> None:
    """Each of these was taken out as an inner wall, and the hole was capped or its piece left out as a sheet."""
    ball = trimesh.creation.icosphere(3)
    vertices, triangles = np.array(ball.vertices), np.array(ball.faces)
    chosen = np.random.default_rng(1).choice(len(triangles), len(triangles) // 3, replace=False)
    for doubled in (chosen, np.arange(len(triangles))):
        mesh = make_mesh(vertices, np.concatenate([triangles, triangles[doubled][:, ::-1]]))
        assert_sound(mesh)
        assert volume(mesh) == pytest.approx(ball.volume)
        assert len(mesh.triangles) == len(triangles)


def test_a_wall_that_two_boxes_share_goes_however_fine_it_is() -> None:
    one = trimesh.creation.box(bounds=[[0, 0, 0], [1, 1, 1]]).subdivide().subdivide()
    other = trimesh.Trimesh(one.vertices * [-1, 1, 1], one.faces[:, ::-1], process=False)
    mesh = make_mesh(*both((one.vertices, one.faces), (other.vertices, other.faces)))
    assert_sound(mesh)
    assert volume(mesh) == pytest.approx(2.0)
    middle = mesh.vertices_m[mesh.triangles].mean(axis=1)
    assert not (np.abs(middle[:, 0]) < 1e-6).any()


def test_a_sheet_with_two_sides_is_made_thick() -> None:
    square = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    triangles = [[0, 1, 2], [0, 2, 3], [0, 2, 1], [0, 3, 2]]
    with pytest.raises(MeshError, match=r"lies on its own back; .* sheet_m=0\.001"):
        make_mesh(square, triangles)
    mesh = make_mesh(square, triangles, sheet_m=0.01)
    assert_sound(mesh)
    assert volume(mesh) == pytest.approx(0.01)


def test_triangles_without_area_are_dropped() -> None:
    vertices, triangles = box()
    mesh = make_mesh(vertices, np.concatenate([triangles, [[0, 0, 1], [2, 2, 2]]]))
    assert_sound(mesh)
    assert "dropped 2 triangles without area" in mesh.warnings[0]


def test_triangles_laid_on_edges_leave_the_solid_as_it_is() -> None:
    """Corners on one line at edges that are closed without them: taken for surface, they cost a corner of the box."""
    vertices, faces = box((0, 0, 0), (40, 30, 20))
    edges = trimesh.Trimesh(vertices, faces).edges_unique
    middle = len(vertices) + np.arange(len(edges))
    vertices = np.concatenate([vertices, vertices[edges].mean(axis=1)])
    made = make_mesh(vertices, np.concatenate([faces, np.column_stack([edges, middle])]), 1e-3)
    assert_sound(made)
    assert made.warnings == ("mesh: dropped 18 triangles without area",)
    assert len(made.triangles) == 12
    assert volume(made) == pytest.approx(24e-6)


def test_a_tube_through_itself_along_its_own_edges_is_two_solids() -> None:
    """Nothing crosses where both sheets have their edges: one lobe of the eight was inside out, and felt so."""
    turn, round_ = (2.0 * np.pi * np.arange(n) / n for n in (48, 32))
    u, w = (grid.ravel() for grid in np.meshgrid(turn, round_, indexing="ij"))
    radius = 40.0 + 15.0 * np.sin(w)
    points = np.stack(
        [radius * np.cos(u), radius * np.sin(u), 15.0 * np.sin(w) * np.cos(w)], axis=1
    )
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(48), np.arange(32), indexing="ij"))
    near, far = i * 32, (i + 1) % 48 * 32
    a, b, c, d = near + j, far + j, far + (j + 1) % 32, near + (j + 1) % 32
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    made = make_mesh(points, faces, 1e-3)
    assert_sound(made)
    at = 1e-3 * np.random.default_rng(5).uniform([-56, -56, -8], [56, 56, 8], (5000, 3))
    wound = igl.fast_winding_number(points, faces, 1e3 * at)
    now = igl.fast_winding_number(made.vertices_m, made.triangles.astype(np.int64), at)
    assert np.array_equal(np.abs(wound) > 0.5, now > 0.5)
    assert now.min() > -0.1


def test_sliver_is_collapsed() -> None:
    fine = trimesh.Trimesh(*box(), process=False).subdivide()
    vertices = np.array(fine.vertices)
    vertices[np.argmin(np.linalg.norm(vertices - [0.5, 0.0, 0.0], axis=1))] = [1e-7, 0.0, 0.0]
    mesh = make_mesh(vertices, fine.faces)
    assert_sound(mesh)
    assert "collapsed 2 slivers" in mesh.warnings[0]
    assert volume(mesh) == pytest.approx(1.0, rel=1e-5)
    assert topology.altitudes_m(mesh.vertices_m, mesh.triangles).min() > 1e-6


def test_overlapping_shells_are_united() -> None:
    mesh = make_mesh(*both(box(), box((0.5, 0.5, 0.5), (1.5, 1.5, 1.5))))
    assert_sound(mesh)
    assert volume(mesh) == pytest.approx(1.875)
    assert "united 2 shells that meet into 1 shell" in mesh.warnings[0]


def test_touching_shells_lose_the_wall_between() -> None:
    mesh = make_mesh(*both(box(), box((1, 0, 0), (2, 1, 1))))
    assert_sound(mesh)
    assert volume(mesh) == pytest.approx(2.0)
    middle = (np.abs(mesh.vertices_m[mesh.triangles][:, :, 0] - 1.0) < 1e-9).all(axis=1)
    assert not middle.any()


def test_touching_cubes_leave_no_wall_of_two_sides() -> None:
    """Of a ball of voxels the union kept walls without thickness: inside was felt as outside behind them."""
    ball = trimesh.creation.icosphere(3, radius=12.0)
    voxels = ball.voxelized(2.0).fill()
    soup = voxels.as_boxes()
    mesh = make_mesh(soup.vertices, soup.faces, 1e-3)
    assert_sound(mesh)
    assert volume(mesh) == pytest.approx(8e-9 * voxels.filled_count)
    at = 1e-3 * np.random.default_rng(3).uniform(-14.0, 14.0, (5000, 3))
    inside = voxels.is_filled(1e3 * at)
    assert np.array_equal(make_surface(mesh, 30.0).signed_distance(at)[0] < 0.0, inside)


def test_separate_shells_stay() -> None:
    mesh = make_mesh(*both(box(), box((2, 2, 2), (3, 3, 3))))
    assert_sound(mesh)
    assert mesh.warnings == ()
    assert volume(mesh) == pytest.approx(2.0)


def test_one_inverted_of_two_shells_is_turned() -> None:
    vertices, triangles = box((2, 2, 2), (3, 3, 3))
    mesh = make_mesh(*both(box(), (vertices, triangles[:, ::-1])))
    assert_sound(mesh)
    assert "turned 1 of 2 shells" in mesh.warnings[0]
    assert volume(mesh) == pytest.approx(2.0)


def test_cavity_stays_a_cavity() -> None:
    vertices, triangles = box((0.25, 0.25, 0.25), (0.75, 0.75, 0.75))
    mesh = make_mesh(*both(box(), (vertices, triangles[:, ::-1])))
    assert_sound(mesh)
    assert mesh.warnings == ()
    assert volume(mesh) == pytest.approx(0.875)


def test_a_hollow_that_is_wholly_inside_out_stays_hollow() -> None:
    inner = box((0.25, 0.25, 0.25), (0.75, 0.75, 0.75))
    vertices, triangles = both(box(), (inner[0], inner[1][:, ::-1]))
    mesh = make_mesh(vertices, triangles[:, ::-1])
    assert_sound(mesh)
    assert "inside out" in mesh.warnings[0]
    assert volume(mesh) == pytest.approx(0.875)


@pytest.mark.parametrize("wound", [1, -1])
def test_solid_that_lies_free_in_a_hollow_stays(wound: int) -> None:
    """It was turned as the hollow is, or vanished in the solid round both."""
    hollow = box((0.25, 0.25, 0.25), (0.75, 0.75, 0.75))
    island = box((0.4, 0.4, 0.4), (0.6, 0.6, 0.6))
    vertices, triangles = both(both(box(), (hollow[0], hollow[1][:, ::-1])), island)
    mesh = make_mesh(vertices, triangles[:, ::wound])
    assert_sound(mesh)
    assert volume(mesh) == pytest.approx(0.875 + 0.008)


def test_shells_that_are_all_inside_out_cut_nothing_from_each_other() -> None:
    """The small box begins in the large one and reaches out of a notch: it was taken for a cavity."""
    solid = trimesh.creation.icosphere(3)
    small = trimesh.creation.box(bounds=[[0.4, 0.4, 0.4], [0.95, 0.95, 0.95]])
    vertices, triangles = both((solid.vertices, solid.faces), (small.vertices, small.faces))
    right = make_mesh(vertices, triangles)
    mesh = make_mesh(vertices, triangles[:, ::-1])
    assert_sound(mesh)
    assert volume(mesh) == pytest.approx(volume(right), rel=1e-9)
    assert volume(mesh) > solid.volume


def test_solid_inside_a_solid_vanishes() -> None:
    mesh = make_mesh(*both(box(), box((0.25, 0.25, 0.25), (0.75, 0.75, 0.75))))
    assert_sound(mesh)
    assert volume(mesh) == pytest.approx(1.0)
    assert "dropped 1 shell wholly inside another, 20 % of the surface" in mesh.warnings[0]


def test_thousand_shells_are_handled() -> None:
    vertices, triangles = box()
    corner = np.stack(np.meshgrid(*[np.arange(10) * 0.9] * 3), -1).reshape(-1, 1, 3)
    many = (vertices * 1.0 + corner).reshape(-1, 3)
    mesh = make_mesh(many * 0.1, np.concatenate([triangles + 8 * i for i in range(1000)]))
    assert_sound(mesh)
    assert volume(mesh) == pytest.approx(0.91**3, rel=1e-6)


def test_surface_through_itself_is_strictly_refused_with_a_place() -> None:
    ball = trimesh.creation.icosphere(3)
    vertices = np.array(ball.vertices)
    top = vertices[:, 2] > 0.5
    vertices[top, 2] = 2.5 - 4.0 * vertices[top, 2]
    with pytest.raises(MeshError, match=r"passed through itself: .* one near \(.*strict=True"):
        make_mesh(vertices, ball.faces, strict=True)


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 10_000))
def test_crossing_counts_agree_with_libigl(seed: int) -> None:
    """Random triangles in general position: the C search against libigl's exact distances being zero."""
    rng = np.random.default_rng(seed)
    vertices = rng.random((30, 3)) + np.repeat(rng.random((10, 3)), 3, axis=0)
    triangles = np.arange(30, dtype=np.int32).reshape(-1, 3)
    count, _ = topology.self_intersections(vertices, triangles, 1e-12)
    expected = sum(
        crosses(vertices[triangles[i]], vertices[triangles[j]]) for i in range(10) for j in range(i)
    )
    assert count == expected


def crosses(one: npt.NDArray[Any], two: npt.NDArray[Any]) -> bool:
    """Whether any side of one triangle hits the other: libigl's ray casting."""
    for a, b in ((one, two), (two, one)):
        for k in range(3):
            origin, way = a[k], a[(k + 1) % 3] - a[k]
            hits = igl.ray_mesh_intersect(origin, way, np.ascontiguousarray(b), FIRST)
            if any(0.0 <= hit[1] <= 1.0 for hit in hits):
                return True
    return False


def test_a_sheet_that_is_all_there_is_makes_100_percent() -> None:
    square = np.array([[0, 0, 0], [0.05, 0, 0], [0.05, 0.05, 0], [0, 0.05, 0]])
    mesh = make_mesh(square, [[0, 1, 2], [0, 2, 3]], sheet_m=2e-3)
    assert "made 1 sheet 2 mm thick, 100 % of the surface" in mesh.warnings[0]


def test_flat_sheet_is_refused() -> None:
    with pytest.raises(MeshError, match="flat"):
        make_mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 1]])


def test_wrong_unit_is_refused_with_the_likely_one() -> None:
    vertices, triangles = box((0, 0, 0), (200, 200, 100))
    with pytest.raises(MeshError, match=r"300 m across .* unit mm \(300 mm\)"):
        make_mesh(vertices, triangles, 1.0)


@pytest.mark.parametrize("unit_m", ["mm", np.nan, np.inf, 0.0, -1e-3, None])
def test_a_scale_that_is_none_is_refused_in_one_line(unit_m: Any) -> None:
    with pytest.raises(MeshError) as refused:
        make_mesh(*box((0, 0, 0), (30, 30, 30)), unit_m, source="plate")
    assert str(refused.value) == (
        f"plate: unit_m is {unit_m!r}; give a finite number, m per unit of the mesh (0.001 for mm), above 0"
    )


def test_unlikely_unit_gets_a_warning() -> None:
    mesh = make_mesh(*box((0, 0, 0), (30, 30, 30)), 1.0)
    assert "52 m across" in mesh.warnings[0]
    assert "unit mm (52 mm)" in mesh.warnings[0]


def test_a_mesh_far_from_its_origin_is_refused_before_any_work() -> None:
    vertices, triangles = box()
    make_mesh(vertices + 900.0, triangles)
    with pytest.raises(MeshError, match=r"lies .* from its origin, more than 1 km"):
        make_mesh(vertices + 2000.0, triangles)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_coordinates_that_are_not_finite_are_refused(bad: float) -> None:
    vertices, triangles = box()
    vertices[3, 1] = bad
    with pytest.raises(MeshError, match="vertex 3"):
        make_mesh(vertices, triangles)


def test_a_vertex_that_no_triangle_names_may_be_anything() -> None:
    vertices, triangles = box()
    mesh = make_mesh(np.concatenate([vertices, [[np.nan, 1e300, 0.0]]]), triangles)
    assert (len(mesh.vertices_m), mesh.warnings) == (8, ())


def test_mesh_without_triangles_is_refused() -> None:
    with pytest.raises(MeshError, match="no triangles"):
        make_mesh(np.zeros((4, 3)), np.zeros((0, 3), dtype=int))


def test_triangle_of_a_missing_vertex_is_refused() -> None:
    vertices, triangles = box()
    with pytest.raises(MeshError, match="not there"):
        make_mesh(vertices, triangles + 1)


def test_huge_mesh_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("crease.mesh.mesh.TRIANGLES_MAX", 10)
    with pytest.raises(MeshError, match="12 triangles, more than 10"):
        make_mesh(*box())


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 100_000), st.floats(0.01, 10.0))
def test_any_order_of_vertices_and_triangles_gives_the_same_solid(seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    ball = trimesh.creation.icosphere(1, radius=scale)
    order = rng.permutation(len(ball.vertices))
    place = np.argsort(order)
    triangles = place[ball.faces][rng.permutation(len(ball.faces))]
    mesh = make_mesh(ball.vertices[order], triangles)
    assert_sound(mesh)
    assert volume(mesh) == pytest.approx(ball.volume, rel=1e-9)


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply", "off", "glb"])
def test_every_format_is_read(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"part.{suffix}"
    trimesh.creation.box(extents=[20, 30, 40]).export(path)
    mesh = load_mesh(path, 1e-3)
    assert_sound(mesh)
    assert np.ptp(mesh.vertices_m, axis=0) == pytest.approx([0.02, 0.03, 0.04])
    assert mesh.digest_sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert (mesh.source, mesh.unit_m) == (str(path), 1e-3)


def test_a_binary_stl_is_read_as_trimesh_reads_it(tmp_path: Path) -> None:
    path = tmp_path / "ball.stl"
    trimesh.creation.icosphere(3, radius=20.0).export(path)
    vertices, corners = read_arrays(path, 1e-3)
    theirs = trimesh.load_mesh(path, process=False)
    assert np.array_equal(vertices, theirs.vertices)
    assert np.array_equal(corners, theirs.faces)


def test_loose_edges_are_looked_for_once_in_the_same_triangles(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    box = trimesh.creation.box(extents=[20.0, 30.0, 40.0])
    looked: list[int] = []
    find = topology.unbalanced_edges

    def counted(triangles: topology.Triangles, count: int) -> topology.Indices:
        looked.append(len(triangles))
        return find(triangles, count)

    monkeypatch.setattr(topology, "unbalanced_edges", counted)
    make_mesh(box.vertices, box.faces, 1e-3)
    assert looked == [12]
    looked.clear()
    make_mesh(box.vertices, box.faces[:, ::-1], 1e-3)
    assert looked == [12, 12]  # turned round they are others


def test_ascii_stl_is_read(tmp_path: Path) -> None:
    path = tmp_path / "part.stl"
    path.write_text(
        trimesh.exchange.stl.export_stl_ascii(trimesh.creation.box(extents=[20, 30, 40]))
    )
    assert volume(load_mesh(path, 1e-3)) == pytest.approx(24e-6)


@pytest.mark.parametrize(
    "spell",
    [
        lambda text: text.upper().encode(),
        lambda text: f"  {text}".encode(),
        lambda text: f"\ufeff{text}".encode(),
        lambda text: text.encode("utf-16"),
        lambda text: text.replace("\n", "\r").encode(),
        lambda text: text.replace("\n", "\r\n").encode(),
    ],
)
def test_ascii_stl_is_known_however_it_is_written(
    tmp_path: Path, spell: Callable[[str], bytes]
) -> None:
    path = tmp_path / "part.stl"
    ball = trimesh.creation.icosphere(2, radius=10.0)
    path.write_bytes(spell(trimesh.exchange.stl.export_stl_ascii(ball)))
    assert len(load_mesh(path, 1e-3).triangles) == len(ball.faces)


@pytest.mark.parametrize(("head", "tail"), [(b"solid facet by CAD", b""), (b"", b"\0" * 37)])
def test_a_binary_stl_is_known_by_its_count(tmp_path: Path, head: bytes, tail: bytes) -> None:
    path = tmp_path / "part.stl"
    data = trimesh.creation.box(extents=[20, 30, 40]).export(file_type="stl")
    path.write_bytes(head.ljust(80) + data[80:] + tail)
    assert volume(load_mesh(path, 1e-3)) == pytest.approx(24e-6)


@pytest.mark.parametrize("cut", [-1, -40, -2000])
def test_an_ascii_stl_without_its_end_is_cut_off(tmp_path: Path, cut: int) -> None:
    path = tmp_path / "part.stl"
    text = trimesh.exchange.stl.export_stl_ascii(trimesh.creation.icosphere(2, radius=10.0))
    path.write_text(text[: text.rindex("endsolid") + cut])
    with pytest.raises(MeshError, match="is cut off: it does not end with endsolid"):
        load_mesh(path, 1e-3)


def test_a_file_with_infinite_coordinates_is_refused_and_nothing_else_is_said(
    tmp_path: Path, recwarn: pytest.WarningsRecorder
) -> None:
    path = tmp_path / "part.stl"
    content = bytearray(trimesh.creation.box().export(file_type="stl"))
    content[96:100] = np.float32(np.inf).tobytes()
    path.write_bytes(bytes(content))
    with pytest.raises(MeshError, match="not finite numbers"):
        load_mesh(path, 1e-3)
    assert not recwarn.list


def test_parts_of_a_glb_scene_are_placed(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box(extents=[1, 1, 1]))
    move = trimesh.transformations.translation_matrix([3, 0, 0])
    scene.add_geometry(trimesh.creation.box(extents=[1, 1, 1]), transform=move)
    scene.export(tmp_path / "two.glb")
    mesh = load_mesh(tmp_path / "two.glb", 1.0)
    assert np.ptp(mesh.vertices_m, axis=0) == pytest.approx([4.0, 1.0, 1.0])


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("part.stl", b"", "empty file"),
        ("part.stl", b"solid nothing\nendsolid nothing\n", "part.stl"),
        ("part.stl", b"\x00" * 100, "part.stl"),
        ("part.stl", bytes(range(256)) * 10, "part.stl"),
        ("part.ply", b"ply\nformat ascii 1.0\nelement vertex 3\n", "part.ply"),
        ("part.obj", b"v 1 2 3\nv 1 2 3\n", "part.obj"),
        ("part.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "names vertex 0"),
        ("part.glb", b"glTF\x02\x00\x00\x00", "part.glb"),
        ("part.iges", b"S      1", "convert it"),
        ("part.step", b"ISO-10303-21;", "part.step"),
    ],
)
def test_broken_file_is_refused_on_one_line(
    tmp_path: Path, name: str, content: bytes, reason: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(MeshError) as caught:
        load_mesh(path, 1e-3)
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match="No such file"):
        load_mesh(tmp_path / "none.stl", 1.0)


@pytest.mark.slow
def test_a_million_triangles_are_checked_in_time(tmp_path: Path) -> None:
    """The limit is far above the measured 8 s, so that a busy machine does not fail it."""
    import time

    path = tmp_path / "big.stl"
    trimesh.creation.icosphere(8, radius=100.0).export(path)
    start_s = time.monotonic()
    mesh = load_mesh(path, 1e-3)
    assert len(mesh.triangles) == 1_310_720
    assert time.monotonic() - start_s < 60.0
