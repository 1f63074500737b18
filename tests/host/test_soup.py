"""Triangles that are no clean solid: what is accepted has the inside that libigl's winding number gives it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import igl
import numpy as np
import numpy.typing as npt
import pytest
import trimesh
from crease.base.errors import MeshError
from crease.mesh import topology
from crease.mesh.arrange import Winding, cut_crossings
from crease.mesh.mesh import Mesh, make_mesh
from hypothesis import given, settings
from hypothesis import strategies as st

F64 = npt.NDArray[np.float64]
Arrays = tuple[npt.NDArray[Any], npt.NDArray[Any]]
POINTS = 20_000


def arrays(*parts: trimesh.Trimesh) -> Arrays:
    """Meshes as one soup."""
    whole = trimesh.util.concatenate(list(parts))
    return np.array(whole.vertices), np.array(whole.faces)


def ball(x: float = 0.0, y: float = 0.0, z: float = 0.0, radius: float = 1.0) -> trimesh.Trimesh:
    mesh = trimesh.creation.icosphere(3, radius=radius)
    mesh.apply_translation([x, y, z])
    return mesh


def cube(x: float = 0.0, y: float = 0.0, z: float = 0.0, side: float = 1.0) -> trimesh.Trimesh:
    mesh = trimesh.creation.box(extents=[side] * 3)
    mesh.apply_translation([x, y, z])
    return mesh


def winding(vertices: F64, triangles: npt.NDArray[Any], points: F64) -> F64:
    """libigl's."""
    return np.asarray(
        igl.fast_winding_number(
            np.ascontiguousarray(vertices), np.ascontiguousarray(triangles, np.int64), points
        )
    )


def points_round(vertices: F64) -> F64:
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    return np.asarray(low + (high - low) * np.random.default_rng(5).random((POINTS, 3)))


def assert_sound(mesh: Mesh) -> None:
    """Closed, oriented, free of crossings, winding round its inside once."""
    assert len(topology.unbalanced_edges(mesh.triangles, len(mesh.vertices_m))) == 0
    diagonal = float(np.linalg.norm(np.ptp(mesh.vertices_m, axis=0)))
    assert topology.self_intersections(mesh.vertices_m, mesh.triangles, 2e-6 * diagonal)[0] == 0
    w = winding(mesh.vertices_m, mesh.triangles, points_round(mesh.vertices_m))
    assert np.abs(w - np.round(w)).max() < 0.05
    assert set(np.unique(np.round(w))) <= {0.0, 1.0}


def folded_ball() -> Arrays:
    """A ball whose top is pushed down through its middle."""
    mesh = trimesh.creation.icosphere(3)
    vertices = np.array(mesh.vertices)
    top = vertices[:, 2] > 0.5
    vertices[top, 2] = 2.5 - 4.0 * vertices[top, 2]
    return vertices, np.array(mesh.faces)


def holed_ball() -> Arrays:
    """A ball with forty triangles missing here and there, and a tenth of its triangles turned."""
    mesh = trimesh.creation.icosphere(3)
    rng = np.random.default_rng(2)
    faces = np.array(mesh.faces)
    turned = rng.choice(len(faces), 128, replace=False)
    faces[turned] = faces[turned][:, ::-1]
    return np.array(mesh.vertices), np.delete(faces, rng.choice(len(faces), 40, replace=False), 0)


def shaken_ball() -> Arrays:
    """Noise that folds triangles over each other."""
    mesh = trimesh.creation.icosphere(3)
    noise = np.random.default_rng(4).normal(0.0, 0.06, mesh.vertices.shape)
    return np.array(mesh.vertices) + noise, np.array(mesh.faces)


def walled_box() -> Arrays:
    """A box with a wall inside, whose rim lies on edges of the box: three triangles meet there."""
    solid = trimesh.creation.box(extents=[2.0, 1.0, 1.0]).slice_plane([0, 0, 0], [1, 0, 0])
    other = trimesh.creation.box(extents=[2.0, 1.0, 1.0]).slice_plane([0, 0, 0], [-1, 0, 0])
    rim = np.array([[0, -0.5, -0.5], [0, 0.5, -0.5], [0, 0.5, 0.5], [0, -0.5, 0.5]])
    wall = trimesh.Trimesh(rim, [[0, 1, 2], [0, 2, 3]], process=False)
    return arrays(solid, other, wall)


def split_box() -> Arrays:
    """A box of which one side is tessellated more finely than its neighbours: vertices lie on their edges."""
    vertices, faces = arrays(cube())
    fine = trimesh.Trimesh(vertices, faces, process=False).subdivide(face_index=[0, 1, 4])
    return np.array(fine.vertices), np.array(fine.faces)


SOUPS: dict[str, Callable[[], Arrays]] = {
    "crossing balls": lambda: arrays(ball(), ball(0.3, 0.2, 0.1), ball(-0.1, 0.4, 0.3)),
    "folded ball": folded_ball,
    "folded ball across a cube": lambda: arrays(
        trimesh.Trimesh(*folded_ball(), process=False), cube(0.7, 0.1, 0.2)
    ),
    "ball with holes and turned triangles": holed_ball,
    "noise": shaken_ball,
    "box with a wall": walled_box,
    "vertices on edges": split_box,
    "coplanar boxes": lambda: arrays(cube(), cube(0.5), cube(0.25, 0.25)),
    "box in a ball": lambda: arrays(ball(), cube(side=0.5)),
}


@pytest.mark.parametrize("name", SOUPS)
def test_the_inside_of_a_soup_is_where_it_winds(name: str) -> None:
    vertices, triangles = SOUPS[name]()
    mesh = make_mesh(vertices, triangles, source=name)
    assert_sound(mesh)
    assert mesh.warnings
    points = points_round(vertices)
    whole = trimesh.Trimesh(vertices, triangles, process=False)
    if "turned" in name:
        whole = ball()  # the file's own windings say nothing; the ball it came from does
    before = winding(np.array(whole.vertices), np.array(whole.faces), points)
    after = winding(mesh.vertices_m, mesh.triangles, points)
    wrong = (before > 0.5) != (after > 0.5)
    # Caps are flat where the winding number bulges, and points may lie within the rounding of a surface.
    assert np.count_nonzero(wrong) <= 1e-3 * POINTS


def copies(gap: float, holes: float, turn: float) -> tuple[Arrays, trimesh.Trimesh]:
    """A ball and its copy `gap` beside it, a hole in each, their directions `turn` apart; and the ball as it was."""
    whole = ball(radius=20.0)
    other = whole.copy().apply_translation(gap * np.array([0.6, 0.7, 0.3]))
    parts = []
    for shell, angle in ((whole, 0.0), (other, turn)):
        way = np.array([np.cos(angle), np.sin(angle), 0.3]) / np.hypot(1.0, 0.3)
        kept = shell.triangles_center @ way < 20.0 * (1.0 - holes)
        parts.append(trimesh.Trimesh(shell.vertices, shell.faces[kept], process=False))
    return arrays(*parts), whole


@pytest.mark.parametrize("gap", [1e-4, 1e-3, 1e-2, 1e-1])
@pytest.mark.parametrize("turn", [0.0, 0.3, 2.0])
def test_a_shell_and_its_copy_a_little_beside_it_are_not_sewn_to_nothing(
    gap: float, turn: float
) -> None:
    """Both with a hole: sewn at their rims, and one of them turned, they enclosed only what is between them."""
    (vertices, triangles), whole = copies(gap, 0.3, turn)
    mesh = make_mesh(vertices, triangles, 1e-3)
    points = points_round(np.array(whole.vertices))
    before = winding(np.array(whole.vertices), np.array(whole.faces), points) > 0.5
    after = winding(1e3 * mesh.vertices_m, mesh.triangles, points) > 0.5
    # Where both are open the cap is flat, and the ball bulges: 6 % of it.
    assert np.count_nonzero(before != after) <= 0.1 * np.count_nonzero(before)


def test_our_winding_number_is_that_of_libigl() -> None:
    vertices, triangles = holed_ball()
    points = points_round(vertices)
    ours = Winding(vertices, triangles).at(points)
    exact = np.asarray(igl.winding_number(vertices, triangles.astype(np.int64), points[:4000]))
    error = ours[:4000] - exact
    assert np.abs(error).max() < 0.03
    assert np.sqrt((error**2).mean()) < 0.006


def test_cuts_leave_no_crossing_and_no_gap() -> None:
    vertices, triangles = SOUPS["crossing balls"]()
    made = cut_crossings(vertices, triangles.astype(np.int32))
    assert made.failed == 0
    assert made.crossings > 100
    assert len(topology.unbalanced_edges(made.triangles, len(made.vertices))) == 0
    assert topology.self_intersections(made.vertices, made.triangles, 1e-9)[0] == 0
    moved = np.abs(made.vertices[: len(vertices)] - vertices).max()
    assert moved < 1e-8


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32), st.integers(2, 40))
def test_pieces_of_random_triangles_cover_them(seed: int, count: int) -> None:
    """Triangles through each other in lines and points of three: none is left whole, no area comes or goes."""
    vertices = np.random.default_rng(seed).random((3 * count, 3))
    triangles = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    made = cut_crossings(vertices, triangles)
    assert made.failed == 0
    assert topology.crossing_pairs(made.vertices, made.triangles, 1e-9).shape[0] == 0
    area = topology.areas_m2(made.vertices, made.triangles).sum()
    assert area == pytest.approx(topology.areas_m2(vertices, triangles).sum(), rel=1e-7)


def test_volume_of_crossing_boxes_is_exact() -> None:
    mesh = make_mesh(*arrays(cube(), cube(0.5, 0.5, 0.5), cube(-0.5, -0.5, 0.5)))
    assert topology.volumes_m3(mesh.vertices_m, mesh.triangles).sum() == pytest.approx(2.75)


def hemisphere() -> Arrays:
    mesh = trimesh.creation.icosphere(4)
    return np.array(mesh.vertices), np.array(mesh.faces[mesh.triangles_center[:, 2] > 0.0])


def grid_sheet() -> Arrays:
    mesh = trimesh.creation.box(extents=[1.0, 1.0, 1.0]).subdivide().subdivide()
    return np.array(mesh.vertices), np.array(mesh.faces[mesh.triangles_center[:, 2] > 0.49])


@pytest.mark.parametrize("sheet", [hemisphere, grid_sheet])
def test_a_sheet_is_refused_with_the_option_and_made_thick_with_it(
    sheet: Callable[[], Arrays],
) -> None:
    vertices, triangles = sheet()
    with pytest.raises(MeshError, match=r"sheet_m=0\.001"):
        make_mesh(vertices, triangles, 1e-1)
    mesh = make_mesh(vertices, triangles, 1e-1, sheet_m=1e-3)
    assert_sound(mesh)
    area_m2 = 1e-2 * topology.areas_m2(vertices, triangles).sum()
    volume_m3 = topology.volumes_m3(mesh.vertices_m, mesh.triangles).sum()
    assert volume_m3 == pytest.approx(1e-3 * area_m2, rel=0.02)
    assert any("thick" in warning for warning in mesh.warnings)


def test_pages_that_share_a_spine_are_each_as_thick_as_wished() -> None:
    """Offset by the mean of their normals at the spine they were wedges, of half the volume."""
    turn = 2.0 * np.pi * np.arange(5) / 5
    rims = [[(np.cos(a), np.sin(a), z) for z in (0.0, 1.0)] for a in turn]
    points = np.concatenate([[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]], *rims])
    faces = [f for k in range(2, 12, 2) for f in ([0, 1, k + 1], [0, k + 1, k])]
    mesh = make_mesh(points, np.array(faces), 1e-1, sheet_m=1e-3)
    assert_sound(mesh)
    assert topology.volumes_m3(mesh.vertices_m, mesh.triangles).sum() == pytest.approx(
        5 * 1e-2 * 1e-3, rel=0.02
    )


def test_sheets_that_cross_are_united() -> None:
    """Judge: a point is inside when it lies within half the thickness of a triangle, along its normal."""
    rng = np.random.default_rng(1)
    corners = rng.uniform(0.0, 0.04, (60, 3, 3))
    mesh = make_mesh(corners.reshape(-1, 3), np.arange(180).reshape(-1, 3), sheet_m=1e-3)
    assert_sound(mesh)
    points = rng.uniform(0.0, 0.04, (5000, 3))
    inside = np.zeros(len(points), bool)
    for tri in corners:
        normal = np.cross(tri[1] - tri[0], tri[2] - tri[0])
        normal /= np.linalg.norm(normal)
        sides = [np.cross(tri[k - 2] - tri[k], points - tri[k]) @ normal for k in range(3)]
        inside |= (np.abs((points - tri[0]) @ normal) < 5e-4) & (np.min(sides, axis=0) > 0.0)
    now = igl.fast_winding_number(mesh.vertices_m, mesh.triangles.astype(np.int64), points) > 0.5
    assert np.count_nonzero(now != inside) < 5


def test_what_cutting_cannot_part_is_told_with_its_share() -> None:
    """Faces that lie in one plane and hang together over corners."""
    rng = np.random.default_rng(2)
    points = rng.uniform(0.0, 0.04, (12, 3)) * [1.0, 1.0, 0.0]
    faces = np.array([rng.choice(12, 3, replace=False) for _ in range(20)])
    mesh = make_mesh(points, faces, sheet_m=1e-3)
    assert any("the shape may be off there" in warning for warning in mesh.warnings)


def test_a_sheet_beside_a_solid_is_left_out_with_its_share() -> None:
    solid, (vertices, triangles) = cube(side=3.0), grid_sheet()
    mesh = make_mesh(*arrays(solid, trimesh.Trimesh(vertices + 4.0, triangles, process=False)))
    assert topology.volumes_m3(mesh.vertices_m, mesh.triangles).sum() == pytest.approx(27.0)
    assert any("left out 1 open sheet" in warning for warning in mesh.warnings)


@pytest.mark.parametrize("count", [1, 100])
def test_what_has_no_shape_is_refused_in_one_line(count: int) -> None:
    corners = np.zeros((3 * count, 3))
    corners[:, 0] = np.arange(3 * count)
    with pytest.raises(MeshError) as caught:
        make_mesh(corners, np.arange(3 * count).reshape(-1, 3), 1e-2)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_thousands_of_sheets_are_refused_at_once() -> None:
    vertices, triangles = grid_sheet()
    count = 3000
    cell = 1.5 * np.ptp(vertices, axis=0).max()
    place = np.stack(np.unravel_index(np.arange(count), (15, 15, 14)), axis=1) * cell
    many = (vertices[None] + place[:, None]).reshape(-1, 3)
    soup = (triangles[None] + len(vertices) * np.arange(count)[:, None, None]).reshape(-1, 3)
    start_s = time.process_time()
    with pytest.raises(MeshError, match=r"encloses nothing.*sheet_m=0\.001"):
        make_mesh(many, soup, 1e-3)
    # 12 s when each edge and each rim was looked at alone.
    assert time.process_time() - start_s < 5e-5 * len(soup) + 1.0
