"""Voxels with samples of their own: only where they are needed, exact there, and without steps to their neighbours."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import trimesh
from crease.bake.grid import Grid, lattice
from crease.bake.refine import (
    FREE,
    HALVES,
    QUARTERS,
    Coarse,
    Fine,
    _levels,
    pack_fine,
    refine,
)

SIDE = 8
TOLERANCE_M = 1e-4
F64 = npt.NDArray[np.float64]


def thin_wall(points: F64) -> F64:
    """As the distance from a wall of 0.6 mm about x = 12.3 mm, turned a little: a kink, weaker towards large y."""
    flat = points.reshape(-1, 3)
    kink = 1.0 - 0.8 * np.clip((flat[:, 1] - 8e-3) / 16e-3, 0.0, 1.0)
    return np.asarray(kink * np.abs(flat @ [0.995, 0.08, 0.06] - 12.3e-3) - 0.3e-3)


def coarse_of(judged: bool = True) -> Coarse:
    """Eight bricks of 8 mm round the wall."""
    grid = Grid(np.zeros(3), (4, 4, 4), 8e-3, 1e-3, 0.8e-3, 4e-3, 4e-3)
    where = np.array([[x, y, z] for z in (1, 2) for y in (1, 2) for x in (1, 2)])
    points = grid.origin_m + (where[:, None] + lattice(SIDE + 1)[None]) * grid.brick_m
    phi = thin_wall(points).reshape(-1, SIDE + 1, SIDE + 1, SIDE + 1)
    return Coarse(grid, where, phi, np.full((len(where), SIDE, SIDE, SIDE), judged), np.arange(8))


def places_of(fine: Fine, coarse: Coarse) -> F64:
    """Where the samples of the fine voxels are, (n, 125, 3) in m."""
    low = np.column_stack([fine.voxel % SIDE, fine.voxel // SIDE % SIDE, fine.voxel // SIDE**2])
    brick = coarse.where[fine.brick]
    return np.asarray((brick[:, None] + (low[:, None] + lattice(5)) / SIDE) * coarse.grid.brick_m)


def test_voxels_with_a_kink_get_finer_samples_and_others_do_not() -> None:
    coarse = coarse_of()
    fine = refine(coarse, thin_wall, TOLERANCE_M, lambda _: None)
    assert 0 < len(fine.brick) < 0.3 * 8 * SIDE**3
    middle = np.abs(thin_wall(places_of(fine, coarse)).reshape(len(fine.brick), -1)).min(axis=1)
    assert middle.max() < 1e-3
    assert set(np.unique(fine.level)) == {HALVES, QUARTERS}


def test_fine_samples_meet_those_of_their_neighbours() -> None:
    coarse = coarse_of()
    fine = refine(coarse, thin_wall, TOLERANCE_M, lambda _: None)
    places = places_of(fine, coarse).reshape(-1, 3)
    values = fine.samples.astype(np.float64).reshape(-1)
    counted = np.zeros((len(fine.brick), 5, 5, 5), bool)
    counted[:, ::2, ::2, ::2] = True
    counted[fine.level == QUARTERS] = True
    seen: dict[tuple[int, ...], float] = {}
    shared = 0
    for place, value in zip(places[counted.ravel()], values[counted.ravel()], strict=True):
        key = tuple(np.rint(place * 1e7).astype(int).tolist())
        shared += key in seen
        assert abs(seen.setdefault(key, value) - value) < 1e-9
    assert shared > 100


def test_a_face_beside_a_coarse_voxel_holds_what_lies_between_its_corners() -> None:
    coarse = coarse_of()
    fine = refine(coarse, thin_wall, TOLERANCE_M, lambda _: None)
    is_fine = set(zip(fine.brick.tolist(), fine.voxel.tolist(), strict=True))
    looked = 0
    for row, (brick, voxel) in enumerate(
        zip(fine.brick.tolist(), fine.voxel.tolist(), strict=True)
    ):
        if voxel % SIDE == 0 or (brick, voxel - 1) in is_fine:
            continue
        face = fine.samples[row, :, :, 0].astype(np.float64)
        part = np.linspace(0.0, 1.0, 5)
        between = face[0, 0] + np.outer(part, np.ones(5)) * (face[4, 0] - face[0, 0])
        between += np.outer(np.ones(5), part) * (face[0, 4] - face[0, 0])
        between += np.outer(part, part) * (face[4, 4] - face[4, 0] - face[0, 4] + face[0, 0])
        assert np.abs(face - between).max() < 1e-9
        looked += 1
    assert looked > 20


def test_voxels_that_planes_answer_are_left_alone_and_hold_nothing_back() -> None:
    assert len(refine(coarse_of(judged=False), thin_wall, TOLERANCE_M, lambda _: None).brick) == 0
    coarse = coarse_of()
    judged = coarse.judged.copy()
    judged[:, :, :, ::2] = False
    half = Coarse(coarse.grid, coarse.where, coarse.phi, judged, coarse.open)
    fine = refine(half, thin_wall, TOLERANCE_M, lambda _: None)
    # Both neighbours along x are free: the samples between are exact also on the common faces.
    inner = fine.samples[:, 2, 2, :].astype(np.float64)
    exact = thin_wall(places_of(fine, half)).reshape(-1, 5, 5, 5)[:, 2, 2, :]
    quarters = fine.level == QUARTERS
    assert quarters.any()
    assert np.abs(inner - exact)[quarters].max() < 1e-8
    assert FREE > QUARTERS


def test_fine_bricks_are_packed_as_the_image_has_them() -> None:
    coarse = coarse_of()
    fine = refine(coarse, thin_wall, TOLERANCE_M, lambda _: None)
    brick = int(fine.brick[0])
    rows = fine.of_brick(brick)
    corners = np.rint(coarse.phi[brick].reshape(-1) / 1e-7).astype(np.int16)
    packed = pack_fine(corners, fine, rows, 1e-7)
    table = packed[736 : 736 + 512].astype(int)
    assert np.count_nonzero(table) == rows.stop - rows.start
    at, quarters = 32 * (table & 0x3FFF), table & 0x4000
    for voxel in np.flatnonzero(table):
        side = 5 if quarters[voxel] else 3
        block = packed[at[voxel] : at[voxel] + side**3].reshape(side, side, side)
        own = fine.samples[rows][fine.voxel[rows] == voxel][0][:: 4 // (side - 1), 0, 0]
        np.testing.assert_array_equal(block[:, 0, 0], np.rint(own / 1e-7).astype(np.int16))
    assert at[table > 0].min() == 1248
    assert len(packed) % 32 == 0


@pytest.mark.slow
@pytest.mark.parametrize("thick_mm", [0.3, 0.8])
def test_a_thin_wall_takes_a_small_image(thick_mm: float) -> None:
    from crease.bake.bake import BakeOptions, bake_scene
    from crease.mesh.mesh import make_mesh

    tube = trimesh.creation.annulus(r_min=15.0 - thick_mm, r_max=15.0, height=30.0, sections=64)
    ball = trimesh.creation.icosphere(subdivisions=3, radius=5.0)
    static, tool = (
        make_mesh(m.vertices, m.faces, 1e-3, source="made", digest_sha256="0" * 64)
        for m in (tube, ball)
    )
    result = bake_scene(static, tool, BakeOptions(voxel_m=1e-3, spacing_m=1e-3))
    # With finer samples for whole bricks it was 5.9 and 6.1 MB.
    assert len(result.image) < 1.4e6
    assert float(str(result.report["error_max_m"])) < 0.25e-3


def test_blocks_that_take_much_room_have_quarters_only_where_halves_miss_the_tolerance() -> None:
    off_m = np.array([0.4, 0.6, 1.1]) * TOLERANCE_M
    assert _levels(off_m, TOLERANCE_M).tolist() == [HALVES, QUARTERS, QUARTERS]
    many = np.repeat(off_m, 10_000)
    assert _levels(many, TOLERANCE_M)[[0, 10_000, 20_000]].tolist() == [HALVES, HALVES, QUARTERS]


@pytest.mark.slow
def test_kinds_and_samples_are_in_the_image_once_and_used() -> None:
    from crease.bake.bake import BakeOptions, bake_scene
    from crease.bake.layout import CELLS_NONE, read_sections
    from crease.base.native import lib
    from crease.mesh.mesh import make_mesh

    stairs = trimesh.util.concatenate(
        [trimesh.creation.box(bounds=[[0, 0, 0], [30, 30 - 5 * k, 5 * k + 5]]) for k in range(4)]
    )
    ball = trimesh.creation.icosphere(subdivisions=3, radius=5.0)
    static, tool = (
        make_mesh(m.vertices, m.faces, 1e-3, source="made", digest_sha256="0" * 64)
        for m in (stairs, ball)
    )
    made = bake_scene(static, tool, BakeOptions(voxel_m=1e-3, spacing_m=1e-3)).image
    sections = read_sections(np.frombuffer(made, np.uint8))
    bricks, cells = sections[int(lib.CR_SEC_BRICKS)], sections[int(lib.CR_SEC_CELLS)]
    used = np.unique(np.concatenate([cells.view(np.uint16), bricks["kind"], bricks["planes"]]))
    # Those of planes that did not agree, which most of 2,000 were, and none that was only tried.
    kinds = sections[int(lib.CR_SEC_KINDS)]
    assert len(kinds) - len(used) <= 0.05 * len(kinds) + 1
    plain = bricks[(bricks["fine"] == 0)]
    samples = sections[int(lib.CR_SEC_SAMPLES)].view(np.int16)
    layers = np.stack([plain["samples"], plain["side"]], axis=1).astype(np.int64)
    apart = np.unique(layers[layers[:, 1] == 8, 0])
    assert (np.diff(apart) == 729 - 81).any()
    blocks = {
        samples[at : at + (side + 1) ** 3].tobytes(): at
        for at, side in zip(plain["samples"].tolist(), plain["side"].tolist(), strict=True)
    }
    assert len(blocks) == len(np.unique(plain["samples"])) < len(plain)
    assert (bricks["cells"] != CELLS_NONE).any()
    tables = cells.view(np.uint16).reshape(-1, 512)
    assert len(np.unique(tables, axis=0)) == len(tables)
    assert len(tables) < (bricks["cells"] != CELLS_NONE).sum()
    fine = bricks["fine"] == 1
    assert bricks["samples"][fine].max(initial=0) < bricks["samples"][~fine].min()


def test_voxels_with_the_same_samples_share_a_block() -> None:
    rng = np.random.default_rng(2)
    samples = rng.uniform(-1e-3, 1e-3, (4, 5, 5, 5)).astype(np.float32)
    samples[2] = samples[0]
    level = np.array([QUARTERS, HALVES, QUARTERS, HALVES], np.int8)
    fine = Fine(np.zeros(4, np.int64), np.array([3, 70, 200, 511]), level, samples)
    packed = pack_fine(np.zeros(729, np.int16), fine, fine.of_brick(0), 1e-6)
    table = packed[736 : 736 + 512].astype(int)
    assert np.flatnonzero(table).tolist() == [3, 70, 200, 511]
    assert table[200] == table[3] != table[511]
    assert len(packed) == 1248 + 128 + 32 + 32


@pytest.mark.slow
def test_a_machined_part_at_defaults_takes_no_more_than_4_mebibytes() -> None:
    from crease.bake.bake import bake_scene
    from crease.mesh.mesh import load_mesh

    meshes = Path(__file__).resolve().parents[2] / "build" / "meshes"
    made = bake_scene(
        load_mesh(meshes / "featuretype.stl", "mm"), load_mesh(meshes / "ball15.stl", "mm")
    )
    assert len(made.image) <= 4 * 2**20
    # Nothing was left out for it.
    assert float(str(made.report["error_max_m"])) < 0.15e-3
