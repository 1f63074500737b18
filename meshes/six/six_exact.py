"""The wrench that is right: the least energy of the springs with the tool outside, in double, on the true geometry.

Polyhedra of which one is convex and the other is planes where they meet: points of the tool, each behind no plane, and
points where edges of the tool pass a level, such as a hole's rim. Each round lays planes through where the tool is and
solves the small quadratic problem exactly (Lawson, Hanson 1974, least distance programming); at the end the forces of
the points balance the springs to 1e-12 of a metre.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]

NEAR_MM = 3.0
"""Gaps wider than this, and than twice what the tool is off, cannot bind."""
ENOUGH_MM = 1e-9
ROUNDS = 200
STRIDE = 10
"""Ticks from one place where the hand is followed to the next."""


@dataclass(frozen=True)
class Walls:
    """Lengths in mm. normal . x >= offset for every point of the tool; none: empty arrays."""

    normals: Floats
    offsets: Floats
    points: Floats
    edges: Floats = field(default_factory=lambda: np.empty((0, 2, 3)))
    level: float = np.inf
    """Points above it (z) touch nothing; where edges pass it there is a point too."""


def _points(walls: Walls, at: Floats, turn: Rotation) -> tuple[Floats, Floats]:
    """Arms of the points that count (n, 3), and for those on the level their edges' slopes e / e_z, else 0 (n, 3)."""
    arms = turn.apply(walls.points)
    low = arms[:, 2] + at[2] <= walls.level
    if not len(walls.edges):
        return arms[low], np.zeros((int(low.sum()), 3))
    a, b = (turn.apply(walls.edges[:, k]) for k in (0, 1))
    way, rest = b - a, walls.level - at[2] - a[:, 2]
    share = rest / np.where(np.abs(way[:, 2]) > 1e-9, way[:, 2], np.inf)
    cross = (share > 0.0) & (share < 1.0)
    cut = a[cross] + share[cross, None] * way[cross]
    slopes = way[cross] / way[cross, 2:]
    none = np.zeros((int(low.sum()), 3))
    return np.concatenate([arms[low], cut]), np.concatenate([none, slopes])


def _linear(
    walls: Walls, at: Floats, turn: Rotation, reach: float, near: float
) -> tuple[Floats, Floats]:
    """Gaps (m,) and how they grow with a motion, turns as lengths (m, 6)."""
    arms, slopes = _points(walls, at, turn)
    gaps = (arms + at) @ walls.normals.T - walls.offsets
    p, w = np.nonzero(gaps < near)
    along = walls.normals[w].copy()
    along[:, 2] -= np.einsum("ij,ij->i", walls.normals[w], slopes[p])
    return gaps[p, w], np.hstack([along, np.cross(arms[p], along) / reach])


def _least(rows: Floats, least: Floats) -> Floats:
    """The shortest y with rows @ y >= least."""
    if not len(rows):
        return np.zeros(6)
    e = np.vstack([rows.T, least])
    f = np.zeros(7)
    f[6] = 1.0
    rest = e @ nnls(e, f, maxiter=100 * len(least) + 100)[0] - f
    return np.asarray(-rest[:6] / rest[6])


def held(
    walls: Walls,
    at: Floats,
    turn: Rotation,
    springs: tuple[float, float],
    begin: tuple[Floats, Rotation],
) -> tuple[Floats, Rotation]:
    """Pose of the held tool; begin: where it was for a hand not far off. Springs in N/m and N m/rad."""
    reach = 1e3 * np.sqrt(springs[1] / springs[0])
    p, q = begin
    for _ in range(ROUNDS):
        apart = np.concatenate([p - at, reach * (q * turn.inv()).as_rotvec()])
        gaps, rows = _linear(walls, p, q, reach, NEAR_MM + 2.0 * float(np.abs(apart).max()))
        step = _least(rows, rows @ apart - gaps) - apart
        p, q = p + step[:3], Rotation.from_rotvec(step[3:] / reach) * q
        if np.abs(step).max() < ENOUGH_MM:
            return p, q
    raise ArithmeticError("no place where the forces of the points balance")


def wrenches(
    walls: Walls, path: tuple[Floats, Rotation], ticks: Sequence[int], springs: tuple[float, float]
) -> list[list[float]]:
    """Force on the hand in N and torque about the tool's origin in N m, frictionless: [tick, fx .. tz].

    The hand is followed from the first tick on, so that the answer is the one that a tool that comes from there has.
    """
    rows: list[list[float]] = []
    p, q = path[0][0], path[1][0]
    for tick in sorted({*range(0, max(ticks), STRIDE), *ticks}):
        at, turn = path[0][tick], path[1][tick]
        p, q = held(walls, at, turn, springs, (p, q))
        if tick in ticks:
            force = 1e-3 * springs[0] * (p - at)
            torque = springs[1] * (q * turn.inv()).as_rotvec()
            rows.append([tick, *(round(float(v), 9) + 0.0 for v in (*force, *torque))])
    return rows
