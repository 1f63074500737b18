"""Small scenes for the property tests, baked from meshes made on the spot, and truths that owe nothing to the package.

Meshes are in mm, everything else in m. Distances come from libigl, overlaps and gaps from manifold3d, in double.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import igl
import manifold3d
import numpy as np
import numpy.typing as npt
import trimesh
from crease.bake.bake import BakeOptions, bake_scene
from crease.bake.layout import CLUSTER, LANES
from crease.base.native import ffi
from crease.base.scene import Scene, open_image
from crease.mesh.mesh import make_mesh
from crease.replay.replay import ReplayOptions, World
from crease.replay.trajectory import Trajectory
from scipy.spatial.transform import Rotation

F64 = npt.NDArray[np.float64]
Solid = Any
"""A manifold3d.Manifold, in mm."""

ROOT = Path(__file__).resolve().parents[2]
SEED = 20070101


def box(*bounds: tuple[float, float]) -> Solid:
    """The box of three ranges in mm."""
    low, high = np.array(bounds).T
    return manifold3d.Manifold.cube(tuple(high - low)).translate(tuple(low))


def block() -> Solid:
    """Its convex edge along y through the origin."""
    return box((-40, 0), (-30, 30), (-40, 0))


def corner() -> Solid:
    """Its three-face corner in the origin."""
    return box((-40, 0), (-40, 0), (-40, 0))


def wall() -> Solid:
    return box((-50, 50), (-50, 50), (-30, 0))


def stairs() -> Solid:
    """Two treads: convex and concave edges by turns."""
    return box((-40, 40), (-25, 25), (-20, 0)) + box((-40, 0), (-25, 25), (-20, 12))


def bar() -> Solid:
    return box((-9, 9), (-40, 40), (-30, 0))


def fork() -> Solid:
    """A U, 16 mm wide inside: straddles the bar with 1 mm of overlap a side."""
    return box((-14, 14), (-10, 10), (-15, 15)) - box((-8, 8), (-11, 11), (-16, 5))


def cylinder() -> Solid:
    """Radius 20 mm about the x axis."""
    upright = manifold3d.Manifold.cylinder(80, 20, circular_segments=128, center=True)
    return upright.rotate((0, 90, 0))


def cube(side: float = 20.0, refine: int = 1) -> Solid:
    return box(*[(-side / 2, side / 2)] * 3).refine(refine)


def ball(radius: float = 12.0, segments: int = 64) -> Solid:
    return manifold3d.Manifold.sphere(radius, segments)


def part() -> Solid:
    """The machined part of meshes/SOURCES.md, from inches."""
    mesh = trimesh.load_mesh(ROOT / "meshes" / "featuretype.STL")
    mesh.apply_scale(25.4)
    mesh.apply_translation(-mesh.bounds.mean(axis=0))
    made = manifold3d.Manifold(
        manifold3d.Mesh(np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces, np.uint32))
    )
    assert made.status() == manifold3d.Error.NoError
    assert made.volume() > 0
    return made


def surface_of(solid: Solid) -> tuple[F64, npt.NDArray[np.int64]]:
    """Vertices in mm and triangles."""
    mesh = solid.to_mesh64()
    return np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts).astype(np.int64)


def bake(static: Solid, tool: Solid, voxel_mm: float, spacing_mm: float) -> Scene:
    """An opened scene."""
    meshes = [make_mesh(*surface_of(solid), 1e-3) for solid in (static, tool)]
    options = BakeOptions(voxel_m=voxel_mm * 1e-3, spacing_m=spacing_mm * 1e-3)
    image = bake_scene(meshes[0], meshes[1], options, lambda _label, _part: None).image
    return open_image(image, "test scene")


@dataclass(frozen=True)
class Pair:
    """A scene with its two solids."""

    name: str
    static: Solid
    tool: Solid
    scene: Scene


_RECIPES: dict[str, tuple[Callable[[], Solid], Callable[[], Solid], float, float]] = {
    "edge": (block, cube, 2.0, 1.5),
    "corner": (corner, cube, 2.0, 1.5),
    "stairs": (stairs, cube, 1.0, 1.5),
    "fork": (bar, fork, 1.0, 1.5),
    "cylinder": (cylinder, ball, 1.0, 1.2),
    "part": (part, cube, 2.0, 1.5),
}
NAMES = tuple(_RECIPES)


@cache
def pair(name: str) -> Pair:
    """A scene by name, baked once in a session."""
    static, tool, voxel_mm, spacing_mm = _RECIPES[name]
    made = static(), tool()
    return Pair(name, *made, bake(*made, voxel_mm, spacing_mm))


def matrices(rotation: F64) -> F64:
    """Rotation matrices (n, 3, 3) of unit quaternions (n, 4), scalar first."""
    return np.asarray(Rotation.from_quat(rotation, scalar_first=True).as_matrix())


def random_rotations(rng: np.random.Generator, count: int) -> F64:
    """Unit quaternions (n, 4), evenly over all rotations."""
    q = rng.normal(size=(count, 4))
    return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))


def poses_near(rng: np.random.Generator, of: Pair, count: int, deep_m: float, away_m: float) -> F64:
    """Poses (n, 7) that bring a random sample of the tool to a random place near the static surface.

    The place lies between deep_m inside and away_m outside along the surface normal there; the sample's own normal
    points towards the surface within some 50 degrees, so that convex pairs touch there and nowhere deeper.
    """
    vertices, faces = surface_of(of.static)
    sides = vertices[faces]
    cross = np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0])
    size = np.linalg.norm(cross, axis=1)
    which = rng.choice(len(faces), count, p=size / size.sum())
    share = rng.dirichlet((1, 1, 1), count)
    outward = cross[which] / size[which, None]
    place = np.einsum("nk,nkx->nx", share, sides[which]) * 1e-3
    place += outward * rng.uniform(-deep_m, away_m, (count, 1))
    points, normals = shell_points(of.scene), shell_normals(of.scene)
    sample = rng.integers(len(points), size=count)
    rotation = turning(normals[sample], 0.4 * rng.normal(size=(count, 3)) - outward)
    at = place - np.einsum("nab,nb->na", matrices(rotation), points[sample])
    return np.hstack([at, rotation])


def turning(start: F64, end: F64) -> F64:
    """Quaternions (n, 4) that turn directions start (n, 3) to directions end (n, 3)."""
    a = start / np.linalg.norm(start, axis=1, keepdims=True)
    b = end / np.linalg.norm(end, axis=1, keepdims=True)
    q = np.hstack([1 + np.einsum("nx,nx->n", a, b)[:, None], np.cross(a, b)])
    q[q[:, 0] < 1e-6] = (0.0, 0.6, 0.8, 0.0)
    return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))


def shell_records(scene: Scene) -> tuple[npt.NDArray[Any], npt.NDArray[np.bool_]]:
    """Cluster records of the image and which lanes are in use, (clusters, lanes)."""
    count = int(scene.handle.cluster_count)
    records = np.frombuffer(ffi.buffer(scene.handle.clusters, count * CLUSTER.itemsize), CLUSTER)
    return records, np.arange(LANES) < records["count"][:, None]


def shell_points(scene: Scene) -> F64:
    """Every sample of the tool as the image has it, (n, 3)."""
    records, used = shell_records(scene)
    return np.stack([records[axis][used] for axis in "xyz"], axis=1).astype(np.float64)


def shell_normals(scene: Scene) -> F64:
    """Outward unit normals of the samples, (n, 3)."""
    records, used = shell_records(scene)
    vector = np.stack([records["a" + axis][used] for axis in "xyz"], axis=1).astype(np.float64)
    return np.asarray(vector / np.linalg.norm(vector, axis=1, keepdims=True))


def in_world(poses: F64, points: F64) -> F64:
    """Points (m, 3) of the tool at each pose: (n, m, 3)."""
    turned = np.einsum("nab,mb->nma", matrices(poses[:, 3:]), points)
    return np.asarray(turned + poses[:, None, :3])


def exact_distance(solid: Solid, points: F64) -> F64:
    """Signed distance in m of points (n, 3) in m, by libigl."""
    vertices, faces = surface_of(solid)
    kind = igl.SignedDistanceType.SIGNED_DISTANCE_TYPE_PSEUDONORMAL
    return np.asarray(igl.signed_distance(points * 1e3, vertices, faces, kind)[0]) * 1e-3


def placed(solid: Solid, pose: F64) -> Solid:
    """The solid at a pose (7,)."""
    turn = matrices(pose[None, 3:])[0]
    return solid.transform(np.hstack([turn, pose[:3, None] * 1e3]))


def as_path(poses: F64, period_s: float = 1e-3) -> Trajectory:
    """Poses (n, 7) one tick apart."""
    time = np.arange(len(poses))[:, None] * period_s
    return Trajectory(np.ascontiguousarray(np.hstack([time, poses])), "test path")


def run(scene: Scene, poses: F64, options: ReplayOptions | None = None) -> npt.NDArray[Any]:
    """Replay from a fresh world."""
    return World(scene, options).run(as_path(poses))


def walk(rng: np.random.Generator, of: Pair, count: int, step_m: float) -> F64:
    """A path (n, 7) that wanders about places of contact in steps of about step_m, now fast, now slow."""
    legs = max(2, count // 250)
    knots = poses_near(rng, of, legs, 2e-3, 2e-3)
    at = np.linspace(0, legs - 1, count)
    at = at + 0.4 * np.sin(at * 2 * np.pi) / (2 * np.pi)
    line = np.column_stack(
        [np.interp(at, np.arange(legs), knots[:, k]) for k in range(3)]
    ) + rng.normal(size=(count, 3)).cumsum(axis=0) * (step_m / 10)
    turn = np.column_stack([np.interp(at, np.arange(legs), knots[:, k]) for k in range(3, 7)])
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    return np.hstack([line, turn])
