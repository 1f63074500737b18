"""Fine points of a tool's surface in cells: nearest sites and sums, judged by scipy's k-d tree and by plain sums."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
import trimesh
from crease.bake import gather
from crease.bake.cells import (
    DENSE_PER_SAMPLE,
    NORMAL_WEIGHT,
    fine_points,
    first_cells,
    make_cells,
    without_gaps,
    without_slim,
)
from crease.bake.gather import FINE_SPREAD, FinePoints, Gathered
from crease.bake.surface import make_surface
from crease.mesh.mesh import make_mesh
from scipy.spatial import cKDTree

F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]

SPACING_M = 2e-3
LIFT_M = NORMAL_WEIGHT * SPACING_M


def fine_of(shape: trimesh.Trimesh) -> FinePoints:
    mesh = make_mesh(shape.vertices, shape.faces)
    return fine_points(mesh.vertices_m[mesh.triangles], SPACING_M**2 / 24)


def lifted(fine: FinePoints) -> F64:
    return np.hstack([fine.position_m, LIFT_M * fine.normal[fine.triangle]])


@pytest.fixture(scope="module", params=["ball", "plate", "torus"])
def fine(request: pytest.FixtureRequest) -> FinePoints:
    """A curved part, one with two sheets nearer than the samples, and one that bends both ways."""
    if request.param == "ball":
        return fine_of(trimesh.creation.icosphere(subdivisions=3, radius=0.02))
    if request.param == "plate":
        return fine_of(trimesh.creation.box((0.04, 0.03, 0.5e-3)))
    return fine_of(trimesh.creation.torus(0.02, 0.004, major_sections=48, minor_sections=24))


def test_slim_triangles_are_halved_across_and_others_are_as_they_were() -> None:
    corners = 1e-3 * np.array(
        [
            [[0, 0, 0], [48, 0, 0], [0, 0.65, 0]],
            [[0, 0, 0], [8, 0, 0], [0, 8, 0]],
            [[0, 0, 0], [9, 0, 0], [18, 0, 0]],
        ],
        np.float64,
    )
    area_m2 = SPACING_M**2 / DENSE_PER_SAMPLE
    cut, owner = without_slim(corners, area_m2, SPACING_M)
    assert np.array_equal(cut[owner == 1], corners[1:2])
    area = 0.5 * np.cross(cut[:, 1] - cut[:, 0], cut[:, 2] - cut[:, 0])[:, 2]
    assert np.bincount(owner, area) == pytest.approx([15.6e-6, 32e-6, 0.0], rel=1e-12, abs=1e-20)
    sides = np.linalg.norm(cut - np.roll(cut, -1, axis=1), axis=2).max(axis=1)
    assert (sides <= SPACING_M * np.maximum(np.ceil(np.sqrt(area / area_m2)), 1.0)).all()


def test_pieces_of_a_bar_of_slim_triangles_reach_each_other() -> None:
    """A round bar whose side is 96 quads, evenly: its pieces cover what is between them, as many as its area says."""
    bar = trimesh.creation.cylinder(radius=0.01, height=0.04, sections=96)
    surface = make_surface(make_mesh(bar.vertices, bar.faces), 30.0)
    cells = make_cells(surface, SPACING_M, even=True)
    assert len(cells.area_m2) == pytest.approx(bar.area / SPACING_M**2, rel=0.1)
    side = np.abs(cells.area_m2[:, 2]) < 0.1 * np.linalg.norm(cells.area_m2, axis=1)
    inner = side & (np.abs(cells.position_m[:, 2]) < 0.017)
    along = np.sqrt(12.0 * cells.spread_m2[inner, 2, 2])
    area = np.linalg.norm(cells.area_m2[inner], axis=1)
    across = np.sqrt(12.0 * (cells.spread_m2[inner, 0, 0] + cells.spread_m2[inner, 1, 1]))
    covered = along * across / area
    assert np.median(covered) == pytest.approx(1.0, abs=0.1)
    assert covered.min() > 0.5


@pytest.mark.parametrize("cell", [0.2, 1.0, 5.0])
def test_nearest_sites_are_those_of_a_kd_tree(fine: FinePoints, cell: float) -> None:
    points = Gathered(fine, LIFT_M, cell * SPACING_M)
    guess = first_cells(fine, SPACING_M)
    sites = points.means(guess)
    assert np.array_equal(points.nearest(sites, guess), cKDTree(sites).query(lifted(fine))[1])


def test_nearest_sites_do_not_depend_on_the_guess(fine: FinePoints) -> None:
    points = Gathered(fine, LIFT_M, SPACING_M)
    guess = first_cells(fine, SPACING_M)
    sites = points.means(guess)
    wrong = guess.copy()
    wrong[::97] = np.random.default_rng(1).integers(0, len(sites), len(wrong[::97]))
    assert np.array_equal(points.nearest(sites, guess), points.nearest(sites, wrong))


def test_equally_near_sites_are_taken_as_a_kd_tree_does() -> None:
    """A grid of points between a grid of sites: nearly every point has two or four nearest ones."""
    side = np.arange(12) * SPACING_M
    place = np.stack(np.meshgrid(side, side, [0.0], indexing="ij"), -1).reshape(-1, 3)
    up = np.array([[0.0, 0.0, 1.0]])
    between = place + 0.5 * SPACING_M
    between[:, 2] = 0.0
    fine = FinePoints(between, np.zeros(len(between), np.int32), up, up, np.ones(1))
    sites = np.hstack([place, np.repeat(LIFT_M * up, len(place), axis=0)])
    found = Gathered(fine, LIFT_M, SPACING_M).nearest(sites, np.zeros(len(between), np.int32))
    assert np.array_equal(found, cKDTree(sites).query(lifted(fine))[1])


@pytest.mark.parametrize("merged", [1, 4])
def test_points_nearest_to_middles_are_as_near_as_a_kd_tree_has_them(
    fine: FinePoints, merged: int
) -> None:
    """Also where cells that are apart count as one, so that the nearest point of all is not its own."""
    points = Gathered(fine, LIFT_M, SPACING_M)
    label = first_cells(fine, SPACING_M) // merged
    middle = np.ascontiguousarray(points.means(label)[:, :3])
    near = points.closest(middle, label)
    far = np.linalg.norm(fine.position_m[near] - middle, axis=1)
    assert far == pytest.approx(cKDTree(fine.position_m).query(middle)[0], rel=1e-12, abs=1e-18)


@pytest.mark.slow
def test_closest_of_a_site_without_points_is_the_nearest_too(fine: FinePoints) -> None:
    points = Gathered(fine, LIFT_M, SPACING_M)
    label = first_cells(fine, SPACING_M)
    middle = np.ascontiguousarray(points.means(label)[:, :3])
    with_more = np.vstack([middle, middle[:3] + 0.1 * SPACING_M])
    near = points.closest(with_more, label)
    far = np.linalg.norm(fine.position_m[near] - with_more, axis=1)
    assert far == pytest.approx(cKDTree(fine.position_m).query(with_more)[0], rel=1e-12, abs=1e-18)


def test_sums_are_plain_sums_in_the_order_of_the_points(fine: FinePoints) -> None:
    points = Gathered(fine, LIFT_M, SPACING_M)
    label = first_cells(fine, SPACING_M)
    weight = fine.weight_m2[fine.triangle]
    total, place = np.bincount(label, weight), lifted(fine)
    mean = np.stack([np.bincount(label, weight * column) for column in place.T], axis=1)
    assert np.array_equal(points.means(label), mean / total[:, None])
    middle = np.ascontiguousarray(points.means(label)[:, :3])
    d = fine.position_m - middle[label]
    normal = fine.normal[fine.triangle]
    across = np.eye(3) - normal[:, :, None] * normal[:, None, :]
    moment = d[:, :, None] * d[:, None, :] + FINE_SPREAD * weight[:, None, None] * across
    columns = [np.bincount(label, weight * column) for column in moment.reshape(-1, 9).T]
    assert np.array_equal(
        points.spreads(middle, label).reshape(-1, 9), np.stack(columns, axis=1) / total[:, None]
    )


def test_pieces_reach_behind_a_plane_as_far_as_their_rims_do(fine: FinePoints) -> None:
    points = Gathered(fine, LIFT_M, SPACING_M)
    label = first_cells(fine, SPACING_M)
    mean = points.means(label)
    site, up = mean[:, :3].copy(), mean[:, 3:] / np.linalg.norm(mean[:, 3:], axis=1)[:, None]
    normal, size = fine.normal[fine.triangle], np.sqrt(fine.weight_m2[fine.triangle])
    tilt = np.linalg.norm(np.cross(normal, up[label]), axis=1)
    behind = size * tilt - np.einsum("nx,nx->n", fine.position_m - site[label], up[label])
    deepest = np.zeros(len(site))
    np.maximum.at(deepest, label, behind)
    assert points.bows(site, up, label) == pytest.approx(deepest, abs=1e-15)


def test_cells_do_not_depend_on_how_the_work_is_shared(monkeypatch: pytest.MonkeyPatch) -> None:
    shape = trimesh.creation.icosphere(subdivisions=3, radius=0.02)
    surface = make_surface(make_mesh(shape.vertices, shape.faces), 30.0)
    whole = make_cells(surface, SPACING_M)
    for threads, chunk in ((1, 10**9), (3, 1_000)):
        monkeypatch.setattr(gather, "THREADS", threads)
        monkeypatch.setattr(gather, "CHUNK", chunk)
        shared = make_cells(surface, SPACING_M)
        assert np.array_equal(shared.position_m, whole.position_m)
        assert np.array_equal(shared.spread_m2, whole.spread_m2)


def test_first_cells_are_counted_as_their_coordinates_are(fine: FinePoints) -> None:
    box = np.floor(lifted(fine) / ([SPACING_M] * 3 + [0.9 * LIFT_M] * 3) + 0.5)
    rank = np.unique(box, axis=0, return_inverse=True)[1].reshape(-1)
    assert np.array_equal(first_cells(fine, SPACING_M), rank)


def test_first_cells_have_room_for_a_part_far_larger_than_its_spacing() -> None:
    """Boxes whose numbers fit into no 64 bits together are still counted in order."""
    up = np.array([[0.0, 0.0, 1.0]])
    place = np.array([[1e7, 0, 0], [0, 1e7, 0], [0, 0, 1e7], [0, 0, 0], [1e7, 1e7, 1e7]])
    fine = FinePoints(place, np.zeros(5, np.int32), up, up, np.ones(1))
    assert first_cells(fine, SPACING_M).tolist() == [3, 2, 1, 0, 4]


def test_labels_that_nothing_has_are_left_out() -> None:
    assert without_gaps(np.array([5, 2, 2, 7], np.int32)).tolist() == [1, 0, 0, 2]
