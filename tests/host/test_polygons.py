"""Mesh files whose faces have more than three corners: what every modeller exports, convex or not."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from crease.base.errors import MeshError
from crease.mesh.mesh import load_mesh
from crease.mesh.polygons import unfold

Outline = list[tuple[float, float]]
L_SHAPE: Outline = [(0, 0), (40, 0), (40, 10), (10, 10), (10, 40), (0, 40)]
U_SHAPE: Outline = [
    (0, 0),
    (60, 0),
    (60, 40),
    (50, 40),
    (50, 10),
    (10, 10),
    (10, 40),
    (0, 40),
]
HIGH = 20.0
Faces = list[list[int]]
Points = list[tuple[float, float, float]]


def prism(outline: Outline) -> tuple[Points, Faces]:
    """Two polygons and the quadrangles between them."""
    n = len(outline)
    points = [(x, y, z) for z in (0.0, HIGH) for x, y in outline]
    sides = [[i, (i + 1) % n, n + (i + 1) % n, n + i] for i in range(n)]
    return points, [list(range(n))[::-1], list(range(n, 2 * n)), *sides]


def rows(values: Sequence[Sequence[float]]) -> str:
    return "".join(" ".join(f"{v:g}" for v in row) + "\n" for row in values)


def as_obj(points: Points, faces: Faces) -> str:
    places = "".join(f"v {x:g} {y:g} {z:g}\n" for x, y, z in points)
    return places + "".join("f " + " ".join(str(i + 1) for i in face) + "\n" for face in faces)


def as_off(points: Points, faces: Faces) -> str:
    counted = [[len(face), *face] for face in faces]
    return f"OFF\n{len(points)} {len(faces)} 0\n" + rows(points) + rows(counted)


def as_coloured_off(points: Points, faces: Faces) -> str:
    """With comments, empty lines, and colours of vertices and faces."""
    coloured = [[*point, 255, 0, 0] for point in points]
    counted = "".join(rows([[len(f), *f]]).rstrip() + "   0.9 0 0  # red\n\n" for f in faces)
    head = f"# made by hand\nCOFF  # coloured\n\n{len(points)} {len(faces)}\n"
    return head + rows(coloured) + counted


def as_ply(points: Points, faces: Faces) -> str:
    numbers = "".join(f"property float {axis}\n" for axis in "xyz")
    head = (
        f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n{numbers}element face {len(faces)}\n"
    )
    counted = [[len(face), *face] for face in faces]
    return (
        head + "property list uchar int vertex_indices\nend_header\n" + rows(points) + rows(counted)
    )


@pytest.mark.parametrize("outline", [L_SHAPE, U_SHAPE], ids=["L", "U"])
@pytest.mark.parametrize(
    ("name", "written"),
    [
        ("a.obj", as_obj),
        ("a.off", as_off),
        ("b.off", as_coloured_off),
        ("a.ply", as_ply),
    ],
)
def test_a_face_that_is_not_convex_is_read_as_it_is(
    tmp_path: Path, outline: Outline, name: str, written: Callable[[Points, Faces], str]
) -> None:
    """From whatever corner it begins: nothing is mended, and area and volume are those of the outline."""
    x, y = np.array(outline).T
    area = 0.5 * abs((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())
    around = np.hypot(np.roll(x, -1) - x, np.roll(y, -1) - y).sum()
    for first in range(len(outline)):
        path = tmp_path / name
        path.write_text(written(*prism(outline[first:] + outline[:first])))
        mesh = load_mesh(path, "mm", strict=True)
        a, b, c = (1e3 * mesh.vertices_m[mesh.triangles[:, k]] for k in range(3))
        surface = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
        volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0
        assert mesh.warnings == ()
        assert surface == pytest.approx(2 * area + HIGH * around, rel=1e-6)
        assert volume == pytest.approx(HIGH * area, rel=1e-6)


def test_faces_with_nothing_folded_stay_to_the_bit() -> None:
    points, faces = prism(U_SHAPE[:3])
    fans = np.array([(f[0], f[i], f[i + 1]) for f in faces for i in range(1, len(f) - 1)])
    assert unfold(np.array(points), fans) is fans


def test_a_fold_that_encloses_nothing_stays() -> None:
    """A sheet on its own back has no rim that could be cut anew."""
    points = np.array([(0.0, 0, 0), (1, 0, 0), (0, 1, 0)])
    both = np.array([(0, 1, 2), (2, 1, 0)])
    np.testing.assert_array_equal(unfold(points, both), both)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("solid\n", "the first line does not say OFF"),
        ("OFF\n", "the line of counts is missing"),
        ("OFF\n4 1 0\n0 0 0\n", "1 of 4 vertices are there"),
        ("OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "1 of 2 faces are there"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n", "a triangle names a vertex"),
        ("OFF\n3 1 0\n0 0 0\n1 x 0\n0 1 0\n3 0 1 2\n", "cannot be read as .off"),
    ],
)
def test_a_damaged_off_file_is_refused_in_one_line(tmp_path: Path, text: str, reason: str) -> None:
    path = tmp_path / "damaged.off"
    path.write_text(text)
    with pytest.raises(MeshError, match=reason) as refused:
        load_mesh(path, "mm")
    assert "\n" not in str(refused.value)
    assert str(path) in str(refused.value)
