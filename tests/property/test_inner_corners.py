"""Tools with inner corners: where their parts meet, samples are of the part that they lie on, and reach no further."""

from __future__ import annotations

from functools import cache
from itertools import product

import crease
import manifold3d
import numpy as np
import numpy.typing as npt
import pytest
from crease.bake.reflex import ReflexCorners, cut_at, reflex_corners
from crease.bake.surface import make_surface
from crease.base.scene import Scene
from crease.mesh.mesh import make_mesh
from property_scenes import bake, surface_of
from scipy.spatial.transform import Rotation

F64 = npt.NDArray[np.float64]
STIFFNESS_N_M = 1000.0
WITHIN_MM = 0.02
Boxes = list[tuple[float, float, float, float, float, float]]
"""Ranges along x, y and z, mm."""

PARTS: dict[str, tuple[Boxes, Boxes]] = {
    "comb": (
        [(-5, 5, -50, 50, -5, 5)],
        [
            (-28, 28, -12, 12, 10, 15),
            *((x - 3, x + 3, -12, 12, -6, 12) for x in (-25, -8.3, 8.3, 25)),
        ],
    ),
    "runners": (
        [(-40, 40, 6, 12, -5, 5)],
        [(-20, 20, -18, 18, 8, 11), *((-20, 20, y - 2, y + 2, 0, 8) for y in (-16, 0, 16))],
    ),
    "lid": (
        [(-20, 20, -15, 15, -20, 0)],
        [
            (-25, 25, -20, 20, 0.3, 5),
            (-25, -20.3, -20, 20, -12, 5),
            (20.3, 25, -20, 20, -12, 5),
            (-25, 25, -20, -15.3, -12, 5),
            (-25, 25, 15.3, 20, -12, 5),
        ],
    ),
    "tongue": (
        [
            (-30, -4.2, -40, 40, -10, 0),
            (4.2, 30, -40, 40, -10, 0),
            (-30, 30, -40, 40, -16, -7),
        ],
        [(-20, 20, -25, 25, 0, 6), (-4, 4, -25, 25, -6, 0)],
    ),
    "nut": (
        [
            (-30, 30, -40, 40, -20, -14),
            (-30, -10.3, -40, 40, -14, -7),
            (10.3, 30, -40, 40, -14, -7),
            (-30, -5.3, -40, 40, -7, 0),
            (5.3, 30, -40, 40, -7, 0),
        ],
        [(-10, 10, -12, 12, -13.7, -7.3), (-5, 5, -12, 12, -8, 8)],
    ),
    "L": ([(-40, 0, -40, 40, -40, 0)], [(-30, 5, -15, 15, 0, 5), (0, 5, -15, 15, -30, 5)]),
}
"""The static object and the tool: a bar under a comb of four teeth, a block beside the runners of a plate, a lid with
a skirt, a tongue in a groove, a nut in a T-slot, an L over an edge."""


def solid(boxes: Boxes) -> manifold3d.Manifold:
    """Their union. What its triangles are, and so where samples lie, depends on how it is made."""
    hulls = [
        manifold3d.Manifold.hull_points(np.array([*product(x, y, z)], np.float64))
        for x, y, z in (((b[0], b[1]), (b[2], b[3]), (b[4], b[5])) for b in boxes)
    ]
    return manifold3d.Manifold.batch_boolean(hulls, manifold3d.OpType.Add).simplify(1e-6)


@cache
def scene_of(name: str, spacing_mm: float = 1.0, edge_mm: float | None = None) -> Scene:
    """Voxels of 1 mm; edges of the triangles as they come, or of at most edge_mm."""
    static, tool = (solid(boxes) for boxes in PARTS[name])
    if edge_mm is not None:
        static, tool = static.refine_to_length(edge_mm), tool.refine_to_length(edge_mm)
    return bake(static, tool, 1.0, spacing_mm)


def pushed_mm(
    scene: Scene,
    at_mm: tuple[float, float, float],
    turned_deg: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> F64:
    """Force by stiffness, from a fresh world, the tool turned by a rotation vector."""
    world = crease.World(scene, stiffness=STIFFNESS_N_M, force_max=1e6)
    x, y, z, w = Rotation.from_rotvec(turned_deg, degrees=True).as_quat()
    out = world.tick([*(1e-3 * np.array(at_mm)), w, x, y, z])
    return np.asarray(1e3 * out.force_N.astype(np.float64) / STIFFNESS_N_M)


@pytest.mark.parametrize(
    ("name", "at_mm", "out_mm"),
    [
        ("lid", (0.25, 0.0, 11.87), (0.0, 0.0, 0.0)),
        ("lid", (0.25, 0.0, 11.7), (0.0, 0.0, 0.0)),
        ("lid", (0.43, -0.235, 7.08), (-0.13, 0.0, 0.0)),
        ("tongue", (0.46, -14.73, 0.11), (-0.26, 0.0, 0.0)),
        ("tongue", (0.46, -14.73, 0.2), (-0.26, 0.0, 0.0)),
        ("L", (0.06, -24.887, 0.3484), (0.0, 0.0, 0.0)),
    ],
)
def test_a_face_with_an_inner_corner_does_not_reach_into_the_hollow(
    name: str, at_mm: tuple[float, float, float], out_mm: tuple[float, float, float]
) -> None:
    """As it did, by the second moment of the cell round the corner, a lid that is clear was lifted by up to 0.3 mm, and
    one that is beside its box by 0.68; a tongue was pushed along its groove by 0.52, an L that is clear by 0.48."""
    assert pushed_mm(scene_of(name), at_mm) == pytest.approx(out_mm, abs=WITHIN_MM)


@pytest.mark.parametrize(
    ("at_mm", "turned_deg"),
    [
        ((-0.155, -27.842, 0.824), (-0.034, 0.039, 0.309)),
        ((-0.127, -27.956, 0.603), (-0.378, 0.069, 0.316)),
        ((-0.151, -27.882, 0.776), (0.245, 0.031, 0.192)),
        ((-0.182, -27.995, 0.815), (0.384, 0.027, 0.002)),
        ((-0.157, 28.035, 0.679), (-0.312, 0.234, -0.155)),
    ],
)
def test_the_end_of_a_nut_does_not_push_it_along_its_slot(
    at_mm: tuple[float, float, float], turned_deg: tuple[float, float, float]
) -> None:
    """Lifted against the slot's lips near its mouth. Two samples of its end, hardly touched, pushed it by 0.6 mm."""
    pushed = pushed_mm(scene_of("nut"), at_mm, turned_deg)
    assert abs(pushed[1]) < 0.1 * abs(pushed[2])


@pytest.mark.slow
@pytest.mark.parametrize("at_mm", [(-0.3, 0.0, -0.1), (-0.3, 0.0, -0.3), (-1.0, 10.0, -1.0)])
def test_an_inner_corner_is_as_deep_whatever_its_triangles(
    at_mm: tuple[float, float, float],
) -> None:
    """Cut more finely an L over an edge was lifted by 0.05 mm more than it is deep."""
    for edge_mm in (None, 6.0):
        pushed = pushed_mm(scene_of("L", 1.0, edge_mm), at_mm)
        assert pushed == pytest.approx((-at_mm[0], 0.0, -at_mm[2]), abs=WITHIN_MM)


def test_cells_are_cut_where_they_reach_round_a_corner_alone() -> None:
    """A square of fine points whose upper right quarter is a hollow: one cell round the corner, and one beside it."""
    at = 0.1 * np.arange(-4.5, 5.0)
    position_mm = np.array([(x, y, 0.0) for x in at for y in at if min(x, y) < 0.0])
    hollow = np.array([[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])
    corners = ReflexCorners(np.zeros(1, np.int64), np.zeros((1, 3)), hollow)
    for left_mm, count in ((-1.0, 2), (-0.2, 3), (0.0, 2)):
        label = (position_mm[:, 0] > left_mm).astype(np.int32)
        label -= label.min()
        cut = cut_at(corners, position_mm, label, 1.0)
        assert np.unique(cut).tolist() == list(range(count))
        assert len(np.unique(np.column_stack([label, cut]), axis=0)) == count
        for cell in np.unique(cut):
            assert not (position_mm[cut == cell, :2] > 0.0).any(axis=0).all()


def test_a_floor_between_two_walls_is_not_cut() -> None:
    """The crease between them ends on it; none of its cells is round a corner."""
    position_mm = np.array([(x, y, 0.0) for x in (0.1, 0.3) for y in (0.1, 0.3)])
    walls = np.array([[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])
    corners = ReflexCorners(np.zeros(1, np.int64), np.zeros((1, 3)), walls)
    assert not cut_at(corners, position_mm, np.zeros(4, np.int32), 1.0).any()


def test_reflex_corners_are_where_concave_creases_end() -> None:
    """Of an L both ends of its one concave crease, on the faces that it ends on, with the planes of its hollow."""
    corners = reflex_corners(make_surface(make_mesh(*surface_of(solid(PARTS["L"][1])), 1e-3), 30.0))
    assert sorted(1e3 * corners.corner_m[:, 1]) == pytest.approx([-15.0, 15.0])
    assert len(np.unique(corners.patch)) == 2
    for normal in corners.normal:
        assert sorted(map(tuple, normal)) == [(-1.0, 0.0, 0.0), (0.0, 0.0, -1.0)]


@pytest.mark.parametrize(
    ("name", "spacing_mm", "at_mm", "out_mm"),
    [
        ("comb", 1.0, (0.4, 15.0, -5.5), (-0.1, 0.0, 0.5)),
        ("comb", 1.1, (0.4, 15.0, -5.5), (-0.1, 0.0, 0.5)),
        ("comb", 1.1, (0.65, 15.0, -5.75), (-0.35, 0.0, 0.75)),
        ("comb", 0.8, (-0.4, -15.0, -5.5), (0.1, 0.0, 0.5)),
        ("runners", 1.0, (0.0, -1.99, -4.0), (0.0, 0.0, 1.0)),
        ("runners", 1.0, (0.0, -2.1, -3.4), (0.0, 0.1, 0.4)),
    ],
)
def test_samples_at_an_inner_corner_are_of_the_part_that_they_lie_on(
    name: str,
    spacing_mm: float,
    at_mm: tuple[float, float, float],
    out_mm: tuple[float, float, float],
) -> None:
    """Those behind the planes of no piece were of the first of their cluster, so that of a comb's teeth two were felt
    as one: pushed out by up to 2.6 mm, and the plate aside by 0.5 where its runner stands clear."""
    pushed = pushed_mm(scene_of(name, spacing_mm), at_mm)
    assert pushed == pytest.approx(out_mm, abs=WITHIN_MM)


def bar(profile_mm: list[tuple[float, float]], end_mm: float) -> manifold3d.Manifold:
    """The hull of a profile in x and z along y, to both sides."""
    ends = product(profile_mm, (-end_mm, end_mm))
    return manifold3d.Manifold.hull_points(np.array([(x, y, z) for (x, z), y in ends]))


@cache
def dovetail() -> Scene:
    """A slide that has 0.3 mm of play in its guide, whose walls overhang."""
    right = [(30.0, -10.0), (16.4, -10.0), (10.4, 0.0), (30.0, 0.0)]
    guide = [bar([(s * x, z) for x, z in right], 40.0) for s in (-1.0, 1.0)]
    flanks = bar([(-16.0, -10.0), (-10.0, 0.0), (10.0, 0.0), (16.0, -10.0)], 25.0)
    plate, neck = solid([(-20, 20, -25, 25, 0.4, 6)]), solid([(-10, 10, -25, 25, -1, 1)])
    parts = ([solid([(-30, 30, -40, 40, -16, -10)]), *guide], [flanks, plate, neck])
    static, tool = (manifold3d.Manifold.batch_boolean(p, manifold3d.OpType.Add) for p in parts)
    return bake(static.simplify(1e-6), tool.simplify(1e-6), 1.0, 1.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("at_mm", "out_mm"),
    [
        ((0.3, 0.0, 0.7), (-0.235, 0.0, -0.141)),
        ((0.7, 0.0, 0.2), (-0.309, 0.0, -0.185)),
        ((0.7, 0.0, 0.5), (-0.441, 0.0, -0.265)),
        ((0.7, 0.0, 0.8), (-0.574, 0.0, -0.344)),
        ((-0.7, 0.0, 0.8), (0.574, 0.0, -0.344)),
        ((0.89, -15.0, 0.51), (-0.585, 0.0, -0.351)),
    ],
)
def test_both_sides_of_an_edge_are_of_one_piece(
    at_mm: tuple[float, float, float], out_mm: tuple[float, float, float]
) -> None:
    """A dovetail slide that is lifted: its way out is along the normal of the wall that overhangs. The slide's bottom
    was of another piece than its flank, which alone was led upwards: into the wall, by up to 1.1 mm."""
    assert pushed_mm(dovetail(), at_mm) == pytest.approx(out_mm, abs=WITHIN_MM)
