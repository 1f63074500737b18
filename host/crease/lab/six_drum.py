"""What facets do to the direction of a force: a needle's tip drawn round a drum of facets (tests/bench/SIX.md).

The experiment of Morgenbesser, Srinivasan 1996 with polyhedra instead of a round bump, without their subjects.
"""

from __future__ import annotations

import numpy as np

from crease.base.scene import Scene
from crease.lab.setup import F64, MM
from crease.lab.six_rivals import ForceShading, Line, Rival, Springs, make_rival
from crease.mesh.mesh import Mesh, make_mesh

R_MM, SIDES, LONG_MM, DEEP_MM = 20.0, 24, 40.0, 2.0
"""Of the drum, about the y axis: its corners lie on R_MM. How deep in it the tip is drawn."""
HALF_DEG, STEP_DEG, TICKS_IN = 50.0, 0.1, 60
"""From so far on one side to the other, a tick's turn, ticks of the way in."""
HALF_FACET_M = R_MM * MM * float(np.sin(np.pi / SIDES))


def drum() -> Mesh:
    """A prism; its first corner is on top, so that a facet is to both sides."""
    angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
    ring = R_MM * np.column_stack([np.sin(angle), np.zeros(SIDES), np.cos(angle)])
    end = np.array([0.0, 0.5 * LONG_MM, 0.0])
    a, b = np.arange(SIDES), (np.arange(SIDES) + 1) % SIDES
    sides = [np.column_stack(c) for c in ((a, b, a + SIDES), (b, b + SIDES, a + SIDES))]
    fan = np.column_stack([np.zeros(SIDES - 2, int), a[1:-1], a[2:]])
    triangles = np.concatenate([*sides, fan[:, ::-1], fan + SIDES])
    return make_mesh(np.concatenate([ring - end, ring + end]), triangles, MM)


def make_scene(needle: Mesh) -> Scene:
    """The drum, and the needle of meshes/six."""
    from crease.bake.call import bake

    return bake(drum(), needle, voxel_m=1e-3, spacing_m=1e-3)


def poses() -> F64:
    """Of the upright needle, its tip about the drum's axis: (n, 7). The first TICKS_IN lead in."""
    angle = np.radians(np.arange(-HALF_DEG, HALF_DEG, STEP_DEG))
    angle = np.concatenate([np.full(TICKS_IN, angle[0]), angle])
    radius = np.full(len(angle), R_MM - DEEP_MM)
    radius[:TICKS_IN] = np.linspace(R_MM + 1.0, R_MM - DEEP_MM, TICKS_IN)
    out = np.column_stack([np.sin(angle), np.zeros(len(angle)), np.cos(angle)])
    level = np.tile([1.0, 0.0, 0.0, 0.0], (len(angle), 1))
    return np.hstack([MM * radius[:, None] * out, level])


def rival(name: str, scene: Scene, springs: Springs, line: Line | None) -> Rival | None:
    """A fresh method; the shaded one is told how wide the facets are."""
    if name == "force shading":
        return ForceShading(scene, springs, HALF_FACET_M)
    return make_rival(name, scene, springs, line)


def turned_deg(force_N: F64, pose: F64) -> F64:
    """Directions about the drum's axis, less that of the round drum's way out, (n,)."""
    at, way = (np.arctan2(v[:, 0], v[:, 2]) for v in (pose[:, :3], force_N))
    return np.degrees((way - at + np.pi) % (2.0 * np.pi) - np.pi)


def turns_deg(force_N: F64, pose: F64) -> tuple[float, float]:
    """Largest turn from one tick to the next, and RMS off the round drum's way out, once the tip is in."""
    way, out = (
        v[TICKS_IN:, :3] / np.linalg.norm(v[TICKS_IN:, :3], axis=1, keepdims=True)
        for v in (force_N, pose)
    )
    turn, off = (
        np.degrees(np.arccos(np.clip(np.sum(a * b, axis=1), -1.0, 1.0)))
        for a, b in ((way[1:], way[:-1]), (way, out))
    )
    return float(turn.max()), float(np.sqrt(np.mean(off**2)))
