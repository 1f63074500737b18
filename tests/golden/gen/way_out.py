"""Exact contact of two polyhedra by the way out of their convex pieces; independent of the project.

No quadrature: the tool's triangles are cut where they enter a static piece and where its nearest plane changes; what is
left are integrals of linear and quadratic functions and maxima at corners. Definitions: force/README.md. Units: mm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from cover import Piece, cover
from numpy.typing import NDArray
from overlap import Solid
from scipy.optimize import nnls

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# A plane that the normal leaves less steeply than this is not left through it.
LEAVES_MIN = 1e-9
# Contacts below this depth are rounding (mm).
DEPTH_MIN_MM = 1e-9
SWEEPS = 10_000
# Contacts whose normals differ by less than this share their point of action.
SAME_NORMAL = 0.2


@dataclass(frozen=True)
class HalfSpace:
    """The tool is out of one piece once moved by depth along normal; arm: torque of a unit force about the origin."""

    normal: Floats
    depth_mm: float
    arm_mm: Floats
    weight_mm3: float


@dataclass(frozen=True)
class Body:
    """A static object's pieces, or a tool's: surface triangles (n, 3, 3) of each piece."""

    pieces: list[Piece]
    soups: list[Floats]


def favour(share: Floats) -> Floats:
    """What a surface counts, as a share of the largest, for its share of it: 0 to 0, 1 to 1, slopes 0 and 1/2."""
    return np.asarray(2.5 * share**2 - 1.5 * share**3)


def clip(soup: Floats, value: Floats) -> Floats:
    """The part of triangles (n, 3, k) where the linear function of values (n, 3) at their corners is >= 0."""
    above = value >= 0.0
    count = above.sum(axis=1)
    parts = [soup[count == 3]]
    for inside in (1, 2):
        pick = np.flatnonzero(count == inside)
        if not len(pick):
            continue
        odd = (above[pick] == (inside == 1)).argmax(axis=1)
        turn = (odd[:, None] + np.arange(3)) % 3
        v = np.take_along_axis(soup[pick], turn[:, :, None], axis=1)
        f = np.take_along_axis(value[pick], turn, axis=1)
        p = [
            v[:, 0] + (f[:, 0] / (f[:, 0] - f[:, k]))[:, None] * (v[:, k] - v[:, 0]) for k in (1, 2)
        ]
        if inside == 1:
            parts.append(np.stack([v[:, 0], p[0], p[1]], axis=1))
        else:
            parts.append(np.stack([p[0], v[:, 1], v[:, 2]], axis=1))
            parts.append(np.stack([p[0], v[:, 2], p[1]], axis=1))
    return np.concatenate(parts)


def make_body(solid: Solid) -> Body:
    """Cover and surfaces of a solid; done once."""
    mesh = solid.body.to_mesh64()
    points = np.asarray(mesh.vert_properties[:, :3], float)
    triangles = points[np.asarray(mesh.tri_verts, np.int64)]
    pieces = cover(solid)
    soups = []
    for piece in pieces:
        soup = triangles
        # A convex body's own planes cut nothing off; float32 planes of many facets would shave it.
        for normal, offset in (
            zip(piece.normals, piece.offsets, strict=True) if len(pieces) > 1 else ()
        ):
            soup = clip(soup, offset + 1e-4 - soup @ normal)
        soups.append(soup)
    return Body(pieces, soups)


def _lowest(soup: Floats, index: int, value: Floats) -> Floats:
    """The part of the triangles where value (n, 3, c) at `index` is the least of all."""
    gap = value - value[:, :, index : index + 1]
    keep = (gap.max(axis=1) >= 0.0).all(axis=1)
    soup, gap = soup[keep], gap[keep]
    width = soup.shape[2]
    whole = np.concatenate([soup, gap], axis=2)
    for other in np.flatnonzero((gap.min(axis=(0, 1)) < 0.0) if len(gap) else []):
        whole = clip(whole, whole[:, :, width + other])
    return whole[:, :, :width]


def _rivals(value: Floats) -> Ints:
    """Functions (n, 3, c) that can be the least somewhere."""
    return np.flatnonzero(value.min(axis=(0, 1)) <= value.max(axis=(0, 1)).min())


@dataclass
class _Sums:
    push: Floats
    turn: Floats
    centre: Floats
    weight: float
    facing: dict[int, Floats]


def _integrate(soup: Floats, piece: Piece) -> _Sums:
    """Integrals of depth over the tool surface inside the piece."""
    sums = _Sums(np.zeros(3), np.zeros(3), np.zeros(3), 0.0, {})
    height = piece.offsets - soup @ piece.normals.T
    rivals = _rivals(height)
    whole = np.concatenate([soup, height[:, :, rivals]], axis=2)
    for k, c in enumerate(rivals):
        part = _lowest(whole, k, whole[:, :, 3:])[:, :, [0, 1, 2, 3 + k]]
        if not len(part):
            continue
        area = 0.5 * np.cross(part[:, 1, :3] - part[:, 0, :3], part[:, 2, :3] - part[:, 0, :3])
        size = np.linalg.norm(area, axis=1)
        r, h = part[:, :, :3], part[:, :, 3]
        arm = (np.einsum("ijk,ij->ik", r, h) + r.sum(axis=1) * h.sum(axis=1)[:, None]) / 12.0
        mean = h.mean(axis=1)
        weight = float(size @ mean)
        sums.push -= mean @ area
        sums.turn -= np.cross(arm, area).sum(axis=0)
        sums.centre += size @ arm
        sums.weight += weight
        s = int(piece.surface[c])
        sums.facing[s] = sums.facing.get(s, np.zeros(3)) + weight * piece.normals[c]
    return sums


def _direction(sums: _Sums) -> Floats:
    """The sum in the cone of the surfaces touched, each favoured by its share of the largest; as long as the push."""
    facing = [v / np.linalg.norm(v) for v in sums.facing.values() if np.linalg.norm(v) > 0.0]
    if not facing:
        return np.zeros(3)
    share, _ = nnls(np.array(facing).T, sums.push)
    most = float(share.max())
    if not most > 0.0:
        return np.zeros(3)
    favoured = most * favour(share / most)
    return np.asarray(favoured @ np.array(facing))


def _inside(soup: Floats, piece: Piece) -> Floats:
    """Triangles (n, 3, 3) cut to the inside of the piece."""
    soup = soup[((soup.max(axis=1) >= piece.low) & (soup.min(axis=1) <= piece.high)).all(axis=1)]
    height = piece.offsets - soup @ piece.normals.T
    near = (height.max(axis=1) > 0.0).all(axis=1)
    if not near.any():
        return soup[:0]
    cuts = np.flatnonzero(height[near].min(axis=(0, 1)) < 0.0)
    whole = np.concatenate([soup[near], height[near][:, :, cuts]], axis=2)
    for k in range(len(cuts)):
        whole = clip(whole, whole[:, :, 3 + k])
    return whole[:, :, :3]


def _deepest(soup: Floats, piece: Piece, normal: Floats) -> float:
    """Longest way of a point of the triangles along the normal to its first exit through the piece's planes."""
    leaves = piece.normals @ normal
    out = leaves > LEAVES_MIN
    exits = np.maximum(piece.offsets[out] - soup @ piece.normals[out].T, 0.0) / leaves[out]
    exits = exits[:, :, _rivals(exits)]
    # A piece of surface whose least exit is below what a corner has already cannot be the deepest.
    seen = float(exits.min(axis=2).max())
    exits = exits[(exits.max(axis=1).min(axis=1) >= seen)]
    for k in range(exits.shape[2]):
        part = _lowest(exits, k, exits)
        seen = max(seen, float(part[:, :, k].max())) if len(part) else seen
    return seen


def half_space(soup: Floats, piece: Piece, origin: Floats) -> HalfSpace | None:
    """Contact of one tool piece's triangles, world frame, with one static piece."""
    whole = _inside(soup, piece)
    if not len(whole):
        return None
    sums = _integrate(whole, piece)
    way = _direction(sums)
    length = float(np.linalg.norm(way))
    if not length > 0.0:
        return None
    normal = way / length
    depth = _deepest(whole, piece, normal)
    if depth < DEPTH_MIN_MM:
        return None
    turn = sums.turn + np.cross(sums.centre / sums.weight, way - sums.push)
    return HalfSpace(normal, depth, turn / length - np.cross(origin, normal), length)


def multipliers(found: list[HalfSpace]) -> Floats:
    """Push of each: its depth, less what the others on its side already lead along its normal."""
    normal = np.array([h.normal for h in found])
    along = np.maximum(normal @ normal.T, 0.0) - np.eye(len(found))
    push = np.zeros(len(found))
    for _ in range(SWEEPS):
        before = push.copy()
        for j, half in enumerate(found):
            push[j] = max(0.0, half.depth_mm - float(along[j] @ push))
        if np.abs(push - before).max() < 1e-12:
            break
    return push


def shared_arms(found: list[HalfSpace]) -> Floats:
    """Arms (n, 3): contacts of one normal act where all of them do, so that the deepest of them may change."""
    normal = np.array([h.normal for h in found])
    apart = np.linalg.norm(normal[:, None] - normal[None], axis=2)
    share = np.maximum(0.0, 1.0 - apart / SAME_NORMAL) * np.array([h.weight_mm3 for h in found])
    arms = np.array([h.arm_mm for h in found])
    return np.asarray(share @ arms / share.sum(axis=1, keepdims=True))


@dataclass(frozen=True)
class Contact:
    """Contact of one pose: half-spaces and their pushes (mm)."""

    halves: list[HalfSpace]
    push_mm: Floats

    def force_mm(self) -> Floats:
        """F*/k, (3,) mm."""
        pairs = zip(self.push_mm, self.halves, strict=True)
        return np.asarray(sum((p * h.normal for p, h in pairs), np.zeros(3)))

    def torque_mm2(self) -> Floats:
        """Torque/k about the tool origin, (3,) mm^2."""
        return self.push_mm @ shared_arms(self.halves) if self.halves else np.zeros(3)


def contact(static: Body, tool: Body, rotation: Floats, position_mm: Floats) -> Contact:
    """Contact of the tool at pose world_from_tool, rotation (3, 3) and position (3,) mm."""
    found = []
    for soup in tool.soups:
        world = soup @ rotation.T + position_mm
        for piece in static.pieces:
            half = half_space(world, piece, position_mm)
            if half is not None:
                found.append(half)
    return Contact(found, multipliers(found) if found else np.zeros(0))
