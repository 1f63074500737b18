"""Triangles that have no face of their own: slivers, folds, pieces without volume."""

from __future__ import annotations

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
    normal = np.cross(*(vertices[triangles[:, k]] - vertices[triangles[:, 0]] for k in (1, 2)))
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
    with pytest.raises(Exception, match="flat|sheet|thickness"):
        make_mesh(square.vertices, square.faces, 1e-2)
