"""The force on curved parts: ball on torus, saddle, in a bowl, along an involute, each at three tessellations.

    python tests/bench/curved.py [--paths 20] [--quick]      # quick: two paths, the two coarser tessellations

Bakes with default settings, then draws a ball along smooth random paths, 0.2 to 1.2 mm deep. The judge is arithmetic
on the smooth surfaces: how far the ball's centre is from each. Amplification: change of force over stiffness and way
of the tool in a tick; `exact` is that of the smooth bodies, `facets` that of the shortest way of a smooth ball out of
the polyhedron: it turns at once where two facets that meet concavely are as near. Error: force over stiffness against
the smooth bodies', mm, that of the facets included; bias: along the normal. The ball is cut finer with the part.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import igl
import manifold3d as mf
import numpy as np
from crease.bake.bake import BakeOptions, bake_scene
from crease.base.scene import open_image
from crease.mesh.mesh import Mesh, make_mesh
from crease.replay.replay import ReplayOptions
from numpy.typing import NDArray
from study.properties.answers import asker

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "meshes"))
import property_shapes
import shapes

Floats = NDArray[np.float64]
Found = tuple[Floats, Floats]
STEP_MM = 0.05
TICKS = 2000
DEEP_MM = (0.2, 1.2)
SIDES = (24, 48, 96)
"""Sides of a circle of the coarse, middle and fine mesh."""
FLANK_MM = (23.4, 27.2)
"""Radii of the feet that the ball is led along: the nearest place is on the flank."""


def on_torus(centre: Floats) -> Found:
    """Height over the torus R 30, r 10 mm, and its normals."""
    around = np.linalg.norm(centre[:, :2], axis=1, keepdims=True)
    ring = np.hstack([centre[:, :2] * (30.0 / around), np.zeros((len(centre), 1))])
    away = centre - ring
    far = np.linalg.norm(away, axis=1)
    return far - 10.0, away / far[:, None]


def on_saddle(centre: Floats) -> Found:
    """Height over z = (x^2 - y^2) / 80, by Newton's method on the foot."""
    foot = centre[:, :2].copy()
    bend = np.array([1.0, -1.0]) / 40.0
    for _ in range(30):
        slope = foot * bend
        lift = 0.5 * (foot * slope).sum(axis=1) - centre[:, 2]
        gradient = foot - centre[:, :2] + lift[:, None] * slope
        hessian = np.einsum("ni,nj->nij", slope, slope)
        hessian += np.eye(2) + lift[:, None, None] * np.diag(bend)
        foot -= np.linalg.solve(hessian, gradient[..., None])[..., 0]
    slope = foot * bend
    normal = np.column_stack([-slope, np.ones(len(foot))])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    low = np.column_stack([foot, 0.5 * (foot * slope).sum(axis=1)])
    return ((centre - low) * normal).sum(axis=1), normal


def on_bowl(centre: Floats) -> Found:
    """Height over the hollow R 40 mm about (0, 0, 40)."""
    away = np.array([0.0, 0.0, 40.0]) - centre
    far = np.linalg.norm(away, axis=1)
    return 40.0 - far, away / far[:, None]


def involute(sides: int) -> Floats:
    """One flank of the gear of property_shapes, (n, 2): radii from the base circle to the tip."""
    base = 24.0 * np.cos(np.radians(20.0))
    radius = np.linspace(base, 28.0, sides)
    spread = np.sqrt((radius / base) ** 2 - 1.0)
    angle = -(spread - np.arctan(spread))
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def on_flank(centre: Floats) -> Found:
    """Height over the involute, by 20,000 chords: 1e-7 mm."""
    line = involute(20_001)
    along = np.diff(line, axis=0)
    square = (along**2).sum(axis=1)
    height, normal = np.empty(len(centre)), np.zeros((len(centre), 3))
    for i, at in enumerate(centre[:, :2]):
        share = np.clip(((at - line[:-1]) * along).sum(axis=1) / square, 0.0, 1.0)
        away = at - (line[:-1] + share[:, None] * along)
        nearest = int(np.argmin((away**2).sum(axis=1)))
        height[i] = np.linalg.norm(away[nearest])
        normal[i, :2] = away[nearest] / height[i]
    return height, normal


def torus_mesh(sides: int) -> mf.Manifold:
    angle = 2.0 * np.pi * np.arange(sides) / sides
    ring = np.column_stack([30.0 + 10.0 * np.cos(angle), 10.0 * np.sin(angle)])
    return mf.CrossSection([ring]).revolve(2 * sides)


def bowl_mesh(sides: int) -> mf.Manifold:
    ball = mf.Manifold.sphere(40.0, 2 * sides).translate([0.0, 0.0, 40.0])
    return mf.Manifold.cube([70.0, 70.0, 18.0]).translate([-35.0, -35.0, -10.0]) - ball


def flank_mesh(sides: int) -> mf.Manifold:
    """A block whose one side is the involute, 20 mm wide: the flank is where y is largest."""
    line = involute(sides // 4)
    outline = np.concatenate([line, [[28.0, -20.0], [line[0, 0], -20.0]]])
    made = mf.CrossSection([outline[::-1]], mf.FillRule.NonZero)
    return made.extrude(20.0).translate([0.0, 0.0, -10.0])


@dataclass(frozen=True)
class Scene:
    """A smooth surface, its meshes, the ball's radius, and where the ball may be: two coordinates to a foot on it."""

    height: Callable[[Floats], Found]
    mesh: Callable[[int], shapes.Mesh]
    ball_mm: float
    foot: Callable[[Floats, Floats], Floats]
    low: tuple[float, float]
    high: tuple[float, float]


def torus_foot(u: Floats, v: Floats) -> Floats:
    out = 30.0 + 10.0 * np.cos(v)
    return np.column_stack([out * np.cos(u), out * np.sin(u), 10.0 * np.sin(v)])


def bowl_foot(u: Floats, v: Floats) -> Floats:
    return np.column_stack([u, v, 40.0 - np.sqrt(1600.0 - u * u - v * v)])


def flank_foot(u: Floats, v: Floats) -> Floats:
    line = involute(20_001)
    radius = np.linalg.norm(line, axis=1)
    return np.column_stack([np.interp(u, radius, line[:, 0]), np.interp(u, radius, line[:, 1]), v])


def of(made: Callable[[int], mf.Manifold]) -> Callable[[int], shapes.Mesh]:
    return lambda sides: shapes.from_manifold(made(sides))


def saddle_mesh(sides: int) -> shapes.Mesh:
    return property_shapes.saddle(sides + 1)


SCENES = {
    "torus": Scene(on_torus, of(torus_mesh), 15.0, torus_foot, (0.0, -0.4), (6.0, 3.5)),
    "saddle": Scene(
        on_saddle,
        saddle_mesh,
        15.0,
        lambda u, v: np.column_stack([u, v, (u * u - v * v) / 80.0]),
        (-16.0, -16.0),
        (16.0, 16.0),
    ),
    "bowl": Scene(on_bowl, of(bowl_mesh), 15.0, bowl_foot, (-9.0, -9.0), (9.0, 9.0)),
    "involute": Scene(
        on_flank, of(flank_mesh), 2.5, flank_foot, (FLANK_MM[0], -5.0), (FLANK_MM[1], 5.0)
    ),
}


def wander(random: np.random.Generator, low: float, high: float) -> Floats:
    """A smooth random way of TICKS values between `low` and `high`."""
    at = np.linspace(0.0, 1.0, TICKS)
    waves = np.zeros(TICKS)
    for k in range(1, 5):
        waves += random.normal() / k * np.sin(2 * np.pi * (k * at + random.uniform()))
    share = (waves - waves.min()) / (waves.max() - waves.min())
    return np.asarray(low + (high - low) * share)


def path_of(scene: Scene, random: np.random.Generator) -> Floats:
    """Centres (n, 3) STEP_MM apart, the ball DEEP_MM in the surface."""
    feet = scene.foot(
        *(wander(random, low, high) for low, high in zip(scene.low, scene.high, strict=True))
    )
    depth = wander(random, *DEEP_MM)
    # The normal at a foot: that of a point a little outside it.
    middle = feet + 1e-3 * scene.height(feet + 1e-2 * outward(scene, feet))[1]
    normal = scene.height(middle)[1]
    way = feet + (scene.ball_mm - depth)[:, None] * normal
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
    even = np.arange(0.0, length[-1], STEP_MM)
    return np.column_stack([np.interp(even, length, way[:, k]) for k in range(3)])


def outward(scene: Scene, feet: Floats) -> Floats:
    """Roughly away from the body."""
    if scene.height is on_torus:
        around = feet[:, :2] / np.linalg.norm(feet[:, :2], axis=1, keepdims=True)
        return np.asarray(feet - np.hstack([30.0 * around, np.zeros((len(feet), 1))]))
    return np.tile([0.0, 1.0, 0.0] if scene.height is on_flank else [0.0, 0.0, 1.0], (len(feet), 1))


def rates(way: Floats, centre: Floats) -> Floats:
    """Amplification of every tick."""
    step = np.linalg.norm(np.diff(centre, axis=0), axis=1)
    return np.asarray(np.linalg.norm(np.diff(way, axis=0), axis=1) / step)


def out_of_facets(mesh: Mesh, centre: Floats, ball_mm: float) -> Floats:
    """Shortest ways of a ball out of a polyhedron, by its nearest point to the centre, which is outside."""
    faces = np.ascontiguousarray(mesh.triangles, np.int64)
    near = igl.point_mesh_squared_distance(centre, 1e3 * mesh.vertices_m, faces)[2]
    away = centre - near
    far = np.linalg.norm(away, axis=1, keepdims=True)
    return np.asarray((ball_mm / far - 1.0) * away)


def mesh_of(made: shapes.Mesh) -> Mesh:
    return make_mesh(made[0], made[1], 1e-3)


def main() -> int:
    """Print one line per surface and tessellation."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--paths", type=int, default=20, help="random paths of each")
    parser.add_argument("--quick", action="store_true", help="two paths, two tessellations")
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES))
    args = parser.parse_args()
    print(
        "surface   sides triangles  amplification max   p99  exact facets   error mm rms   max   bias"
    )
    for name in args.scenes:
        scene = SCENES[name]
        random = np.random.default_rng(13)
        paths = [path_of(scene, random) for _ in range(2 if args.quick else args.paths)]
        for level, sides in enumerate(SIDES[: 2 if args.quick else 3]):
            static, tool = (
                mesh_of(scene.mesh(sides)),
                mesh_of(shapes.ball(scene.ball_mm, 3 + level)),
            )
            baked = open_image(bake_scene(static, tool, BakeOptions()).image, name)
            ask = asker(baked, ReplayOptions())
            found, exact, facets, away, bias = [], [], [], [], []
            for centre in paths:
                height, normal = scene.height(centre)
                right = (scene.ball_mm - height)[:, None] * normal
                poses = np.column_stack([centre, np.tile([1.0, 0, 0, 0], (len(centre), 1))])
                way = ask(poses).way_mm
                found.append(rates(way, centre)[1:])
                exact.append(rates(right, centre)[1:])
                facets.append(rates(out_of_facets(static, centre, scene.ball_mm), centre)[1:])
                away.append(np.linalg.norm(way - right, axis=1))
                bias.append(((way - right) * normal).sum(axis=1))
            rate, off = np.concatenate(found), np.concatenate(away)
            print(
                f"{name:9} {sides:5} {len(static.triangles):9,} {rate.max():18.3f} "
                f"{np.percentile(rate, 99):5.3f} {np.concatenate(exact).max():6.3f} "
                f"{np.concatenate(facets).max():6.3f} "
                f"{np.sqrt((off**2).mean()):14.4f} {off.max():5.3f} {np.concatenate(bias).mean():+.3f}",
                flush=True,
            )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
