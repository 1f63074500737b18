"""Convex pieces of a tool's surface, on solids whose pieces are plain."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from crease.bake.bake import BakeOptions, bake_scene
from crease.bake.layout import CLUSTER, LANES
from crease.bake.pieces import (
    BESIDE,
    PIECE_NONE,
    RISE_MAX,
    WITNESSES,
    _beside,
    _needed,
    find_pieces,
)
from crease.bake.shell import hanging_together, part_pieces
from crease.bake.surface import Surface, make_surface
from crease.base.errors import MeshError
from crease.base.native import lib
from crease.base.scene import Scene, open_image
from crease.mesh.mesh import Mesh


def mesh_of(solid: trimesh.Trimesh, name: str) -> Mesh:
    """A mesh in metres of a solid in millimetres."""
    corners, sides = 1e-3 * np.asarray(solid.vertices), np.asarray(solid.faces, np.int32)
    return Mesh(corners, sides, "00" * 32, name)


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> trimesh.Trimesh:
    """A box by two corners, mm."""
    return trimesh.creation.box(bounds=[low, high])


def bake(tool: trimesh.Trimesh, spacing_mm: float = 2.0) -> Scene:
    """A scene with this tool."""
    floor = mesh_of(box((-30, -30, -10), (30, 30, 0)), "floor")
    options = BakeOptions(voxel_m=2e-3, spacing_m=1e-3 * spacing_mm)
    return open_image(bake_scene(floor, mesh_of(tool, "tool"), options).image, "test")


def clusters_of(scene: Scene) -> np.ndarray:
    """Records of the image's clusters."""
    from crease.base.native import ffi

    handle = scene.handle
    size = handle.cluster_count * CLUSTER.itemsize
    return np.frombuffer(ffi.buffer(handle.clusters, size), CLUSTER).copy()


SOLIDS = {
    "cube": (box((-10, -10, -10), (10, 10, 10)), 1),
    "ball": (trimesh.creation.icosphere(3, 10.0), 1),
    "pin": (
        trimesh.creation.cylinder(10.0, 40.0, sections=96),
        1,
    ),  # samples in rows, as its strips lie
    "ell": (
        trimesh.boolean.union(
            [box((-20, -6, 0), (20, 6, 10)), box((10, -6, -20), (20, 6, 10))], engine="manifold"
        ),
        2,
    ),
    "pads": (
        trimesh.boolean.union(
            [
                box((-20, -6, 0), (20, 6, 6)),
                box((-20, -6, -8), (-10, 6, 6)),
                box((10, -6, -8), (20, 6, 6)),
            ],
            engine="manifold",
        ),
        3,
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SOLIDS)
def test_large_pieces_are_the_convex_parts(name: str) -> None:
    solid, parts = SOLIDS[name]
    records = clusters_of(bake(solid))
    piece, count = np.unique(records["piece"][:, 0], return_counts=True)
    large = np.flatnonzero(count >= 0.05 * count.sum())
    assert len(large) == parts
    assert (records["piece"][:, 0] != PIECE_NONE).all()
    # A convex part's clusters lie behind each other's planes, but for those that span an elbow.
    for p in piece[large]:
        rows = records[(records["piece"] == p).any(axis=1)]
        middle = np.array(
            [[rows[i][a][: rows[i]["count"]].mean() for a in "xyz"] for i in range(len(rows))]
        )
        normal = rows["normal"]
        above = np.einsum("jx,ijx->ij", normal, middle[:, None] - middle[None])
        far = np.linalg.norm(middle[:, None] - middle[None], axis=2)
        assert (above <= 0.16 * far + 1e-6).mean() > 0.97


ARM, LEG = ((-20, -6, 0), (20, 6, 10)), ((10, -6, -20), (20, 6, 10))
"""The two convex parts of "ell", mm."""


@pytest.mark.slow
@pytest.mark.parametrize("spacing_mm", [0.9, 1.0, 1.3, 2.0])
@pytest.mark.parametrize("turn_deg", [0.0, 20.0])
def test_samples_are_of_the_part_they_lie_on(spacing_mm: float, turn_deg: float) -> None:
    """Up to a sample: those of the leg's inner face that counted for the arm as well kicked by 2.3 mm over an edge."""
    turn = trimesh.transformations.rotation_matrix(np.radians(turn_deg), [1.0, 2.0, 3.0])
    tool = SOLIDS["ell"][0].copy().apply_transform(turn)
    records = clusters_of(bake(tool, spacing_mm))
    assert len(np.unique(records["piece"][records["piece"] != PIECE_NONE])) == 2
    used = np.arange(LANES) < records["count"][:, None]
    points = 1e3 * np.stack([records[a] for a in "xyz"], axis=-1) @ turn[:3, :3]
    parts = []
    for piece in (0, 1):
        lanes = (records["piece"] == piece)[:, :, None] & (
            records["piece_lanes"][:, :, None] >> np.arange(LANES) & 1 > 0
        )
        own = points[lanes.any(axis=1) & used]
        inside = [
            (own > np.array(low) - 1.05 * spacing_mm).all()
            and (own < np.array(high) + 1.05 * spacing_mm).all()
            for low, high in (ARM, LEG)
        ]
        parts.append(inside)
    assert sorted(parts) == [[False, True], [True, False]]


@pytest.mark.slow
def test_no_sample_is_left_without_a_piece() -> None:
    records = clusters_of(bake(SOLIDS["pads"][0], 1.0))
    first, second = records["piece_lanes"].astype(int).T
    assert (first | second == (1 << records["count"].astype(int)) - 1).all()
    assert (first & second == 0).all()


@pytest.mark.slow
def test_what_a_piece_does_not_see_is_not_of_it() -> None:
    """Walls round a hollow: samples behind all planes of one that are hidden from it were of its piece."""
    hollow = trimesh.boolean.difference(
        [
            box((-15, -15, -15), (15, 15, 15)),
            box((-11, -11, -11), (11, 11, 11)),
            box((-4, -4, -16), (4, 4, 0)),
        ],
        engine="manifold",
    )
    records = clusters_of(bake(hollow))
    surface = make_surface(mesh_of(hollow, "hollow"), 30.0)
    used = np.arange(LANES) < records["count"][:, None]
    points = np.stack([records[a] for a in "xyz"], axis=-1).astype(np.float64)
    rng = np.random.default_rng(1)
    for piece in (0, 1):
        lanes = (records["piece"] == piece)[:, :, None] & (
            records["piece_lanes"][:, :, None] >> np.arange(LANES) & 1 > 0
        )
        own = points[lanes.any(axis=1) & used]
        ends = own[rng.integers(0, len(own), (2, 3000))]
        outside = surface.signed_distance(ends.mean(axis=0))[0] > 1e-3  # half a sample
        assert outside.mean() < 0.03


@pytest.mark.slow
def test_too_many_pieces_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("crease.bake.pieces.PIECE_NONE", 1)
    with pytest.raises(MeshError, match="2 convex pieces of the tool, at most 1"):
        bake(SOLIDS["ell"][0])


def test_a_cluster_of_three_pieces_becomes_two() -> None:
    order = [np.array([3, 0, 1, 5]), np.array([2, 4])]
    parts = part_pieces(order, np.array([4, 9, 9, 7, 4, 4]))
    assert [part.tolist() for part in parts] == [[3, 0, 5], [1], [2, 4]]


def test_a_cluster_across_a_notch_becomes_two() -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [5, 0, 0], [6, 0, 0], [2, 0, 0]])
    order = [np.array([0, 2, 1, 3]), np.array([4])]
    assert [part.tolist() for part in hanging_together(points, order, 1.5)] == [[0, 1], [2, 3], [4]]


def test_pieces_that_others_cover_are_not_needed() -> None:
    pieces = [np.arange(4), np.arange(2, 6), np.arange(3, 9), np.array([0, 8])]
    assert [p.tolist() for p in _needed(pieces, 10)] == [list(range(3, 9)), list(range(4))]


@pytest.mark.slow
def test_pieces_are_numbered_below_their_count() -> None:
    scene = bake(SOLIDS["pads"][0])
    records = clusters_of(scene)
    known = records["piece"][records["piece"] != lib.CR_PIECE_NONE]
    assert known.max() < scene.meta.piece_count
    assert PIECE_NONE == lib.CR_PIECE_NONE


def pieces_by_the_book(
    surface: Surface,
    centre: np.ndarray,
    normal: np.ndarray,
    beside: list[np.ndarray],
    inset_m: float,
) -> list[list[int]]:
    """What find_pieces finds, by exact distances of every way."""
    inner, rows = centre - inset_m * normal, range(len(centre))

    def agrees(i: int, j: int) -> bool:
        way = centre[j] - centre[i]
        above = max(float(way @ normal[i]), -float(way @ normal[j]))
        return above <= RISE_MAX * float(np.linalg.norm(way)) + 1e-12

    def sees(i: int, piece: set[int]) -> bool:
        others = sorted(piece)
        asked = others[:: max(1, len(others) // WITNESSES)]
        ways = [inner[i] + t * (inner[j] - inner[i]) for j in asked for t in (0.25, 0.5, 0.75)]
        return bool((surface.signed_distance(np.array(ways))[0] < inset_m).all())

    pieces: list[list[int]] = []
    for seed in rows:
        if any(seed in piece for piece in pieces):
            continue
        piece, refused, front = {seed}, {j for j in rows if not agrees(seed, j)}, [seed]
        while front:
            found = {int(j) for i in front for j in beside[i]} - piece - refused
            front = []
            for i in sorted(found, key=lambda j: (np.linalg.norm(centre[j] - centre[seed]), j)):
                if i in refused or not sees(i, piece):
                    refused.add(i)
                    continue
                piece.add(i)
                front.append(i)
                refused |= {j for j in rows if not agrees(i, j)}
        pieces.append(sorted(piece))
    return pieces


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ring", "ell"])
def test_pieces_are_those_found_by_the_book(name: str) -> None:
    """Kept distances tell of most ways; the pieces are those that exact ones make."""
    solid = trimesh.creation.torus(20.0, 6.0) if name == "ring" else SOLIDS["ell"][0]
    surface = make_surface(mesh_of(solid, name), 30.0)
    centre_mm, face = trimesh.sample.sample_surface_even(solid, 700, seed=3)
    centre, normal = 1e-3 * np.asarray(centre_mm), np.asarray(solid.face_normals[face])
    beside = _beside(centre, np.arange(len(centre)), BESIDE * 2.5e-3)
    listed = [beside[1][beside[0][i] : beside[0][i + 1]] for i in range(len(centre))]
    found = find_pieces(surface, centre, normal, beside, 2e-4)
    assert [piece.tolist() for piece in found] == pieces_by_the_book(
        surface, centre, normal, listed, 2e-4
    )
    assert 2 <= len(found) < len(centre)
