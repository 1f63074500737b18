"""Triangles that have no face of their own: slivers, folds, pieces without volume."""

from __future__ import annotations

import time
from dataclasses import replace

import igl
import numpy as np
import parts
import pytest
import trimesh
from crease.bake.surface import make_surface
from crease.mesh import topology
from crease.mesh.mesh import Mesh, make_mesh
from crease.mesh.slivers import mend_slivers
from numpy.typing import NDArray

Floats = NDArray[np.float64]
LIMIT_M = 1e-8


def split_box(gap_m: float) -> tuple[Floats, NDArray[np.int32]]:
    """A cube of 20 mm, the top of which has a corner gap_m beside the middle of its edge to the front."""
    cube = trimesh.creation.box([0.02] * 3)
    vertices, faces = np.array(cube.vertices), np.array(cube.faces)
    edge = [
        int(np.argmin(np.linalg.norm(vertices - at, axis=1)))
        for at in ([-0.01, -0.01, 0.01], [0.01, -0.01, 0.01])
    ]
    tip = len(vertices)
    vertices = np.vstack([vertices, [0.0, -0.01 + gap_m, 0.01]])
    made = []
    for face in faces.tolist():
        top = (vertices[face][:, 2] > 0.0).all()
        if top and set(edge) <= set(face):
            k = next(k for k in range(3) if {face[k], face[(k + 1) % 3]} == set(edge))
            a, b, c = face[k], face[(k + 1) % 3], face[(k + 2) % 3]
            made += [[a, tip, c], [tip, b, c], [a, b, tip]]
        else:
            made.append(face)
    return vertices, np.array(made, np.int32)


def test_a_corner_on_an_edge_is_turned_away() -> None:
    vertices, triangles = split_box(1e-10)
    assert topology.altitudes_m(vertices, triangles).min() < LIMIT_M
    mended = mend_slivers(vertices, triangles, LIMIT_M)
    assert len(mended) == len(triangles)
    assert topology.altitudes_m(vertices, mended).min() > 1e-3
    assert len(topology.unbalanced_edges(mended, len(vertices))) == 0
    assert topology.volumes_m3(vertices, mended).sum() == pytest.approx(8e-6, rel=1e-7)


def test_corners_on_each_other_are_one() -> None:
    """A needle from the middle of an edge to a corner."""
    vertices, triangles = split_box(0.005)
    here = int(np.argmin(np.linalg.norm(vertices - [0.01, 0.01, 0.01], axis=1)))
    twin = len(vertices)
    vertices = np.vstack([vertices, vertices[here] - [1e-10, 0.0, 0.0]])
    fan = np.flatnonzero((triangles == here).any(axis=1))
    top = [t for t in fan.tolist() if (vertices[triangles[t]][:, 2] > 0.0).all()]
    changed = triangles.copy()
    first = changed[top[0]].copy()
    changed[top[0]] = np.where(first == here, twin, first)
    # The gaps beside it: a needle to each of its other corners.
    k = first.tolist().index(here)
    after, before = int(first[(k + 1) % 3]), int(first[(k + 2) % 3])
    changed = np.vstack([changed, [[here, after, twin], [here, twin, before]]]).astype(np.int32)
    assert len(topology.unbalanced_edges(changed, len(vertices))) == 0
    mended = mend_slivers(vertices, changed, LIMIT_M)
    assert len(mended) == len(triangles)
    assert topology.altitudes_m(vertices, mended).min() > 1e-3


def test_a_sliver_belongs_to_the_face_beside_it() -> None:
    """Its own plane is rounding: askew by any angle. As a patch of its own it was felt along the whole edge."""
    vertices, triangles = split_box(0.0)
    vertices[-1] += [0.0, 3e-10, -4e-10]
    plain = make_mesh(
        np.array(trimesh.creation.box([0.02] * 3).vertices),
        trimesh.creation.box([0.02] * 3).faces,
        1.0,
    )
    mesh: Mesh = replace(plain, vertices_m=vertices, triangles=triangles)
    one, two = (vertices[triangles[:, k]] - vertices[triangles[:, 0]] for k in (1, 2))
    normal = np.cross(one, two)
    askew = np.abs(normal).max(axis=1) < 0.9 * np.linalg.norm(normal, axis=1)
    assert askew.any()
    surface = make_surface(mesh, 30.0)
    assert surface.counts["patches"] == 6
    assert surface.counts["convex_edges"] == 13  # one of the twelve is in two parts
    assert surface.counts["concave_edges"] == 0


@pytest.mark.parametrize("name", ["gear_pair", "lattice"])
def test_folds_of_a_decimated_part_are_left_out(name: str) -> None:
    """Decimating folds struts and teeth to sheets without thickness, which have no side to push to."""
    spoiled = parts.SPOILERS["decimated"](parts.PARTS[name]())
    mesh = make_mesh(spoiled.vertices, spoiled.faces, 1e-3, source=name)
    count, shell = topology.shells(mesh.vertices_m, mesh.triangles)
    volume_m3 = np.bincount(shell, topology.volumes_m3(mesh.vertices_m, mesh.triangles), count)
    area_m2 = np.bincount(shell, topology.areas_m2(mesh.vertices_m, mesh.triangles), count)
    assert (volume_m3 > 1e-5 * area_m2).all()
    assert any("without volume" in warning for warning in mesh.warnings)
    low, high = spoiled.bounds
    points = low + (high - low) * np.random.default_rng(4).random((20_000, 3))
    told, now = (
        igl.fast_winding_number(np.ascontiguousarray(v), np.ascontiguousarray(f, np.int64), points)
        > 0.5
        for v, f in ((spoiled.vertices, spoiled.faces), (1e3 * mesh.vertices_m, mesh.triangles))
    )
    assert np.array_equal(told, now)


def test_a_block_of_sheets_alone_is_refused_not_emptied() -> None:
    square = trimesh.Trimesh(
        [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3), (1, 0, 3), (1, 3, 2)]
    )
    with pytest.raises(Exception, match=r"flat|sheet|thickness"):
        make_mesh(square.vertices, square.faces, 1e-2)


def prism(outline: list[tuple[float, float]], height: float) -> trimesh.Trimesh:
    """What an outline sweeps, its ends cut as fans."""
    n = len(outline)
    vertices = [(x, y, z) for z in (0.0, height) for x, y in outline]
    faces = [[i + 1, i, 0] for i in range(1, n - 1)]
    faces += [[n, n + i, n + i + 1] for i in range(1, n - 1)]
    for i in range(n):
        j = (i + 1) % n
        faces += [[i, j, n + j], [i, n + j, n + i]]
    return trimesh.Trimesh(vertices, faces, process=False)


def volume_mm3(mesh: Mesh) -> float:
    return float(1e9 * topology.volumes_m3(mesh.vertices_m, mesh.triangles).sum())


def test_a_blade_thinner_than_rounding_is_kept_or_told() -> None:
    """All its triangles would be one line: nothing would be left."""
    blade = trimesh.Trimesh(
        [(0, 0, 0), (100, 0, 0), (100, 0, 1e-4), (0, 50, 0), (100, 50, 0), (100, 50, 1e-4)],
        [(0, 1, 2), (3, 5, 4), (0, 4, 1), (0, 3, 4), (1, 5, 2), (1, 4, 5), (0, 2, 5), (0, 5, 3)],
        process=False,
    )
    mesh = make_mesh(blade.vertices, blade.faces, 1e-3)
    assert volume_mm3(mesh) == pytest.approx(0.25, rel=1e-6)


@pytest.mark.parametrize("height", [10.0, 1.0, 0.5, 0.1])
def test_a_piece_that_encloses_both_ways_is_no_fold(height: float) -> None:
    """The two lobes of an outline that crosses itself have no volume in sum."""
    lobes = prism([(0, 0), (20, 10), (20, 0), (0, 10)], height)
    lobes.apply_translation([0, 0, 100])
    both = trimesh.util.concatenate([trimesh.creation.box([60] * 3), lobes])
    mesh = make_mesh(both.vertices, both.faces, 1e-3)
    assert volume_mm3(mesh) == pytest.approx(216_000 + 50 * height, rel=1e-7)


def test_a_foil_beside_a_part_is_kept() -> None:
    """0.3 um, two and a half times what counts as touching there."""
    foil = trimesh.creation.box([20, 20, 3e-4])
    foil.apply_translation([0, 0, 40])
    both = trimesh.util.concatenate([trimesh.creation.box([60] * 3), foil])
    mesh = make_mesh(both.vertices, both.faces, 1e-3)
    assert volume_mm3(mesh) - 216_000 == pytest.approx(0.12, rel=1e-3)


@pytest.mark.parametrize("made", ["ball", "cylinder"])
def test_short_edges_that_hang_together_are_thinned_out_not_one_point(made: str) -> None:
    """A screw on a hall: its edges are shorter than what is rounding for the hall, and all hang together."""
    small = (
        trimesh.creation.icosphere(5, 4.0)
        if made == "ball"
        else trimesh.creation.cylinder(4.0, 20.0, sections=512)
    )
    mended = mend_slivers(small.vertices, small.faces.astype(np.int32), 0.2)
    assert len(topology.unbalanced_edges(mended, len(small.vertices))) == 0
    volume = topology.volumes_m3(np.asarray(small.vertices), mended).sum()
    assert volume == pytest.approx(small.volume, rel=0.02)
    assert len(mended) < 0.5 * len(small.faces)


def test_many_slivers_are_mended_in_a_moment() -> None:
    cube = trimesh.creation.box([100] * 3).subdivide_to_size(4.0)
    tip = len(cube.vertices) + np.arange(len(cube.faces))
    a, b, c = (np.asarray(cube.faces)[:, k] for k in range(3))
    edge = 0.5 * (cube.vertices[a] + cube.vertices[b])
    vertices = np.vstack([cube.vertices, edge + 1e-7 * (cube.vertices[c] - edge)])
    faces = np.vstack([np.c_[a, tip, c], np.c_[tip, b, c], np.c_[a, b, tip]]).astype(np.int32)
    began = time.process_time()
    mended = mend_slivers(vertices, faces, 3e-4)
    took_s = time.process_time() - began
    assert topology.altitudes_m(vertices, mended).min() > 3e-4
    assert len(topology.unbalanced_edges(mended, len(vertices))) == 0
    assert took_s < 1.5


def test_the_rim_of_a_foil_thinner_than_rounding_is_convex() -> None:
    """Far from its origin rounding is 40 um: the rim belongs to one side of the foil, and folds back to the other."""
    disc = trimesh.creation.cylinder(20.0, 0.03, sections=64)
    mesh = make_mesh(disc.vertices + np.array([100_000.0, 0.0, 0.0]), disc.faces, 1e-3)
    surface = make_surface(mesh, 30.0)
    assert surface.counts["concave_edges"] == 0
    assert surface.counts["convex_edges"] >= 64


def test_a_part_far_away_has_the_creases_it_has_here() -> None:
    """At 100 m single precision keeps 8 um, and the sides of this are 15 um wide: a file in double has them."""
    pin = trimesh.creation.cylinder(5.0, 10.0, sections=2048)
    for away in (0.0, 100_000.0):
        mesh = make_mesh(pin.vertices + np.array([away, 0.0, 0.0]), pin.faces, 1e-3)
        counts = make_surface(mesh, 30.0).counts
        assert (counts["convex_edges"], counts["concave_edges"]) == (4096, 0)


@pytest.mark.parametrize("unused", [0, 1, 2, 3])
def test_solids_that_share_an_edge_are_parted_whatever_else_is_in_the_file(unused: int) -> None:
    corner = trimesh.creation.box(bounds=[[0, 0, 0], [1, 1, 1]])
    other = trimesh.creation.box(bounds=[[1, 1, 0], [2, 2, 1]])
    both = trimesh.util.concatenate([corner, other])
    both.merge_vertices()
    vertices = np.vstack([both.vertices, np.zeros((unused, 3))])
    points, corners = topology.parted(vertices, both.faces.astype(np.int32))
    uses = np.unique(topology.undirected_codes(corners, len(points)), return_counts=True)[1]
    assert set(uses.tolist()) == {2}


def test_shells_of_a_clean_part_are_looked_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    shells = topology.shells

    def counted(vertices: Floats, triangles: NDArray[np.int32]) -> tuple[int, NDArray[np.int32]]:
        asked.append(1)
        return shells(vertices, triangles)

    monkeypatch.setattr(topology, "shells", counted)
    cube = trimesh.creation.box([0.02] * 3)
    make_mesh(cube.vertices, cube.faces)
    assert len(asked) == 1
