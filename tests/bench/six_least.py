"""The held tool over the meshes themselves, in double: what of a benchmark's figures is the scene's own.

    python tests/bench/six_least.py NAME ...    # the largest change of the wrench, and at half the step

Quasi-static: for each pose of the hand the tool goes down its springs' energy in small steps, from where it was, held
by the distances of vertices from triangles and of edges from edges, until no motion is left. No image, no samples, no
planes that outlive a step; both meshes are rounded by ROUND_MM together.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from crease.mesh.mesh import Mesh
from crease.replay.trajectory import Trajectory
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation
from six_judge import MM, Case, Felt, halved, largest_change_N, rotation

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

ROOT = Path(__file__).resolve().parents[2]
ROUND_MM = 2e-4
"""What is nearer is held."""
REACH_MM, NEAR_MM, STEP_MM = 0.5, 0.12, 0.05
"""Pairs are looked for as far; bind as far; no point moves farther in one step."""
ENOUGH_MM = 1e-7
ROUNDS = 400
FLAT = 1.0 - 1e-7
"""Triangles that turn by less are one face."""


def _unit(v: F64) -> F64:
    return np.asarray(v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-300))


@dataclass(frozen=True)
class Body:
    """A solid as what can touch: its triangles, its convex edges, and the vertices of these. mm."""

    triangles: F64
    """(n, 3, 3)."""
    edges: F64
    """(m, 2, 3)."""
    vertices: F64
    """(k, 3)."""

    @classmethod
    def of(cls, mesh: Mesh) -> Body:
        """From a closed mesh."""
        corners = np.asarray(mesh.vertices_m[mesh.triangles].reshape(-1, 3) / MM, np.float32)
        places, index = np.unique(corners, axis=0, return_inverse=True)
        faces, v = index.reshape(-1, 3), places.astype(np.float64)
        normal = _unit(np.cross(v[faces[:, 1]] - v[faces[:, 0]], v[faces[:, 2]] - v[faces[:, 0]]))
        ways = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        owner = np.tile(np.arange(len(faces)), 3)
        order = np.lexsort((ways[:, 0], ways.max(axis=1), ways.min(axis=1)))
        one, two = order[::2], order[1::2]
        a, b = owner[one], owner[two]
        opposite = faces[b].sum(axis=1) - ways[two].sum(axis=1)
        rises = np.einsum("ij,ij->i", normal[a], v[opposite] - v[ways[one, 0]])
        sharp = (np.einsum("ij,ij->i", normal[a], normal[b]) < FLAT) & (rises < 0.0)
        ends = ways[one[sharp]]
        return cls(v[faces], v[ends], v[np.unique(ends)])


def _boxes(parts: F64) -> tuple[F64, F64]:
    return parts.min(axis=1), parts.max(axis=1)


def _meet(a: F64, b: F64, reach: float) -> tuple[I64, I64]:
    """Pairs of parts (n, p, 3), (m, q, 3) whose boxes are no farther apart."""
    (la, ha), (lb, hb) = _boxes(a), _boxes(b)
    whole = lb.min(axis=0), hb.max(axis=0)
    some = np.flatnonzero(((la < whole[1] + reach) & (ha > whole[0] - reach)).all(axis=1))
    whole = la.min(axis=0), ha.max(axis=0)
    other = np.flatnonzero(((lb < whole[1] + reach) & (hb > whole[0] - reach)).all(axis=1))
    hit = np.ones((len(some), len(other)), bool)
    for k in range(3):
        hit &= la[some, None, k] < hb[None, other, k] + reach
        hit &= ha[some, None, k] > lb[None, other, k] - reach
    i, j = np.nonzero(hit)
    return some[i], other[j]


def _to_segments(p: F64, a: F64, b: F64) -> F64:
    """Nearest places to p on segments."""
    way = b - a
    t = np.einsum("ij,ij->i", p - a, way) / np.maximum(np.einsum("ij,ij->i", way, way), 1e-300)
    return np.asarray(a + np.clip(t, 0.0, 1.0)[:, None] * way)


def _to_triangles(p: F64, t: F64) -> F64:
    """Nearest places to p (n, 3) on triangles (n, 3, 3)."""
    n = _unit(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]))
    foot = p - np.einsum("ij,ij->i", p - t[:, 0], n)[:, None] * n
    within = np.ones(len(p), bool)
    best, far = foot.copy(), np.full(len(p), np.inf)
    for k in range(3):
        a, b = t[:, k], t[:, (k + 1) % 3]
        within &= np.einsum("ij,ij->i", np.cross(b - a, foot - a), n) >= 0.0
        q = _to_segments(p, a, b)
        d = np.linalg.norm(q - p, axis=1)
        best = np.where((d < far)[:, None], q, best)
        far = np.minimum(far, d)
    return np.asarray(np.where(within[:, None], foot, best))


def _between_segments(a: F64, b: F64) -> tuple[F64, F64]:
    """Nearest places of segments (n, 2, 3) that cross; those of ends are vertices'."""
    u, v, w = a[:, 1] - a[:, 0], b[:, 1] - b[:, 0], a[:, 0] - b[:, 0]
    uu, uv, vv = (np.einsum("ij,ij->i", x, y) for x, y in ((u, u), (u, v), (v, v)))
    uw, vw = (np.einsum("ij,ij->i", x, w) for x in (u, v))
    det = uu * vv - uv * uv
    flat = det < 1e-12 * uu * vv
    s = np.clip(np.where(flat, 0.0, (uv * vw - vv * uw) / np.where(flat, 1.0, det)), 0.0, 1.0)
    t = np.clip((s * uv + vw) / vv, 0.0, 1.0)
    s = np.clip((t * uv - uw) / uu, 0.0, 1.0)
    return np.asarray(a[:, 0] + s[:, None] * u), np.asarray(b[:, 0] + t[:, None] * v)


class Least:
    """One tool in one scene; a method as of six_run.Method."""

    def __init__(self, case: Case) -> None:
        self._static, self._tool = Body.of(case.mesh("static")), Body.of(case.mesh("tool"))
        k_t, k_r = case.springs
        self._springs, self._reach = (k_t, k_r), np.sqrt(k_r / k_t) / MM
        self._radius = float(np.linalg.norm(self._tool.vertices, axis=1).max())
        self._held: tuple[F64, Rotation] | None = None
        self._seen: tuple[F64, Rotation] | None = None
        self._pairs: list[tuple[I64, I64]] = []
        self.unsettled = 0

    def _moved(self, a: tuple[F64, Rotation], b: tuple[F64, Rotation]) -> float:
        turn = (a[1] * b[1].inv()).magnitude()
        return float(np.linalg.norm(a[0] - b[0]) + self._radius * turn)

    def _placed(self, parts: F64, pose: tuple[F64, Rotation]) -> F64:
        return np.asarray((pose[1].apply(parts.reshape(-1, 3)) + pose[0]).reshape(parts.shape))

    def _look(self, pose: tuple[F64, Rotation]) -> tuple[F64, F64]:
        """Distances (n,) of what is near, and how they grow with a motion, turns as lengths (n, 6)."""
        tool, static = self._tool, self._static
        corners, edges, faces = (
            self._placed(p, pose) for p in (tool.vertices, tool.edges, tool.triangles)
        )
        if self._seen is None or self._moved(pose, self._seen) > 0.5 * (REACH_MM - NEAR_MM):
            self._seen = pose
            self._pairs = [
                _meet(corners[:, None], static.triangles, REACH_MM),
                _meet(faces, static.vertices[:, None], REACH_MM),
                _meet(edges, static.edges, REACH_MM),
            ]
        (vi, ti), (fi, si), (ei, ej) = self._pairs
        ours = [corners[vi], _to_triangles(static.vertices[si], faces[fi])]
        theirs = [_to_triangles(corners[vi], static.triangles[ti]), static.vertices[si]]
        p, q = _between_segments(edges[ei], static.edges[ej])
        ours.append(p)
        theirs.append(q)
        at, to = np.concatenate(ours), np.concatenate(theirs)
        d = np.linalg.norm(at - to, axis=1)
        near = d < NEAR_MM
        at, to, d = at[near], to[near], d[near]
        u = (at - to) / np.maximum(d, 1e-12)[:, None]
        return d, np.hstack([u, np.cross(at - pose[0], u) / self._reach])

    def tick(self, hand: F64) -> tuple[F64, F64]:
        """See six_run.Method."""
        at, turn = hand[:3] / MM, rotation(hand)
        pose = self._held if self._held is not None else (at, turn)
        for _ in range(ROUNDS):
            apart = np.concatenate([pose[0] - at, self._reach * (pose[1] * turn.inv()).as_rotvec()])
            gaps, rows = self._look(pose)
            step = _least(rows, rows @ apart + ROUND_MM - gaps) - apart
            size = float(
                np.linalg.norm(step[:3]) + self._radius * np.linalg.norm(step[3:]) / self._reach
            )
            if size < ENOUGH_MM:
                break
            step *= min(1.0, STEP_MM / size)
            pose = pose[0] + step[:3], Rotation.from_rotvec(step[3:] / self._reach) * pose[1]
        else:
            self.unsettled += 1
        self._held = pose
        k_t, k_r = self._springs
        force = 1e-3 * k_t * (pose[0] - at)
        torque = k_r * (pose[1] * turn.inv()).as_rotvec()
        held = np.concatenate([MM * pose[0], pose[1].as_quat()[[3, 0, 1, 2]]])
        return np.concatenate([force, torque]), held


def _least(rows: F64, least: F64) -> F64:
    """The shortest y with rows @ y >= least (Lawson, Hanson 1974)."""
    if not (least > 0.0).any():
        return np.zeros(6)
    e = np.vstack([rows.T, least])
    f = np.zeros(7)
    f[6] = 1.0
    rest = e @ nnls(e, f, maxiter=100 * len(least) + 100)[0] - f
    return np.asarray(-rest[:6] / rest[6])


def follow(case: Case, path: Trajectory) -> tuple[Felt, int]:
    """Along a path.   Output  what is felt; ticks that did not settle."""
    least = Least(case)
    found = [least.tick(pose) for pose in path.rows[:, 1:]]
    none = np.zeros(len(found), np.int64)
    return Felt(
        np.array([w for w, _ in found]), np.array([h for _, h in found]), none
    ), least.unsettled


def main(arguments: Sequence[str] | None = None) -> None:
    """Command line; see the module text."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="+", metavar="NAME")
    for name in parser.parse_args(arguments).names:
        case = Case.load(ROOT / "build" / "meshes" / "six", name)
        whole, half = (follow(case, p) for p in (case.path, halved(case.path)))
        a, b = (largest_change_N(case, f.wrench) for f, _ in (whole, half))
        print(
            f"{name}: {a:.4f} N, at half the step {b:.4f} N, {b / a:.3f}; unsettled {whole[1]}, {half[1]}"
        )


if __name__ == "__main__":
    main()
