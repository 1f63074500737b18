"""Other ways to hold a tool outside on a spring of six degrees of freedom, on the same image, to compare quality.

Each is from its paper, written anew in Python; its time is Python's and says nothing. No friction in any.

GodObject       Ortega, Redon, Coquillart 2007: the held tool makes the motion nearest to the one wanted that leads into
                no contact (Gauss' principle over half-spaces), as far as the first new contact; the force is what the
                contacts held back. Left out: contacts between edges (the image has samples), their exact continuous
                detection (here steps of a quarter voxel and bisection).
StaticCoupling  Barbic, James 2008: penalties of samples inside, linearised, and the spring: one step of Newton's method
                to where they balance, each tick. Left out: saturation of the spring, deformable tools, the tree.
VoxmapShell     McNeely, Puterbaugh, Troy 1999; Renz et al. 2001; Wan, McNeely 2003: a rigid body on spring and damper,
                pushed by planes through the centres of voxels; stiffness shared above ten points; inside, the way to
                the surface. Left out: braking before contact, force-field layers of tuned width, cutting by time.
LineTool        Ho, Basdogan, Srinivasan 2000: the tool is a line; an ideal line stays outside, stopped at its ends and
                where it comes closest; the force of each of two handles leads from the hand's to the ideal's. Left out:
                triangles, boxes round them and neighbours to go on to (here distances along the line); friction. Ours:
                the handles lie where two springs are the spring of six degrees of freedom.
ForceShading    Morgenbesser, Srinivasan 1996, for a body as Ruspini, Kolarov, Khatib 1997 do for a ball: a god-object
                led by normals that are smooth over facets, then kept outside by the true ones; the force has the
                direction of the smooth ones. Left out: normals at vertices (the image has none): the mean over a disc,
                as wide as a facet, of the same smooth patch.
ContactLevels   Otaduy, Lin 2003: a contact is a piece of the coarsest shell that cannot be told from the finest:
                whose deviation, spread over the area that touches, is below a threshold; then as StaticCoupling. Left
                out: the collapse of edges and convex pieces (here clusters of samples), detail of the other body (its
                distances are exact), what is saved (here all samples are looked up), their body and its integration.
Of the last three the formulas were not at hand, but abstracts and what others say of them: they are our reading.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import nnls
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from crease.base.native import ffi, lib
from crease.base.scene import Scene
from crease.lab.setup import F64
from crease.replay.contacts import tool_normals, tool_samples_m

TOUCH_M = 2e-5
"""A sample that is nearer is a contact of the god-object."""
PASSED_M = 5e-6
"""What a god-object may be inside before its motion is cut."""
FINE_M = 1e-8
"""Nor deeper than it is, but for rounding."""
PASSES, HALVINGS = 4, 14
HARDER = 10.0
"""Stiffness of a sample's penalty, over the spring's."""
BODY_KG, POINT_N_M, POINTS_FULL = 0.1, 4000.0, 10
"""Of the voxmap's body: the stiffest contact that 1 kHz carries is below 0.5 kg / s^2 / (1 ms)^2 of it."""
PERIOD_S = 1e-3
ZOOMS = 4
"""Of the place where a line is closest, each to a quarter: from half a voxel to 1/500."""
BESIDE = 0.02
"""Of a voxel: so far to both sides of where a line is closest are the normals that its own lies between."""
DISC = 61
"""Normals that a shaded one is the mean of."""
FELT = 0.005
"""Of the tool's radius: what a coarser shell may be off, spread over what touches. Ours."""
COARSER, PIECES_MIN = 4, 8
"""Samples of a shell over those of the next, and of the coarsest at least."""

Springs = tuple[float, float]


@dataclass(frozen=True)
class Line:
    """A tool that is a line: its ends, tool frame, (2, 3). The tool's origin lies on it."""

    ends_m: F64

    @classmethod
    def of(cls, spec: dict[str, Any]) -> Line | None:
        """Of a scene of meshes/six; None: its tool is none."""
        return cls(1e-3 * np.array(spec["line_mm"], np.float64)) if "line_mm" in spec else None


class Field:
    """Samples of the tool, and distances that the tick would see."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.samples_m, self.normals = tool_samples_m(scene), tool_normals(scene)
        self.voxel_m = float(scene.meta.voxel_m)
        self.radius_m = float(np.linalg.norm(self.samples_m, axis=1).max())

    def look(self, points_m: F64) -> tuple[F64, F64]:
        """Distances (n,), gradients (n, 3)."""
        n = len(points_m)
        if n == 0:
            return np.empty(0), np.empty((0, 3))
        points = np.ascontiguousarray(points_m, np.float32)
        phi, gradient = np.empty(n, np.float32), np.empty((n, 3), np.float32)
        kind, facet = np.empty(n, np.uint32), np.empty(n, np.uint32)
        buffer = ffi.from_buffer
        lib.crp_look_up(
            self.scene.handle, buffer("float[]", points.reshape(-1)), n, buffer("float[]", phi),
            buffer("float[]", gradient.reshape(-1)), buffer("uint32_t[]", kind), buffer("uint32_t[]", facet),
        )  # fmt: skip
        return phi.astype(np.float64), gradient.astype(np.float64)


def _split(pose: F64) -> tuple[F64, Rotation]:
    return np.array(pose[:3], np.float64), Rotation.from_quat(pose[[4, 5, 6, 3]])


def _joined(at: F64, turn: Rotation) -> F64:
    return np.concatenate([at, turn.as_quat()[[3, 0, 1, 2]]])


class _Held:
    """A held tool; motions are (6,), m, turns as lengths of `reach_m`."""

    def __init__(self, scene: Scene, springs: Springs) -> None:
        self.field, self.springs = Field(scene), springs
        self.reach_m = float(np.sqrt(springs[1] / springs[0]))
        self.at: F64 | None = None
        self.turn = Rotation.identity()

    def _begin(self, pose: F64) -> tuple[F64, Rotation, F64]:
        """The hand, and where the held tool is: at first the hand's."""
        hand, turn = _split(pose)
        if self.at is None:
            self.at, self.turn = hand.copy(), turn
        return hand, turn, self.at

    def _apart(self, hand: F64, turn: Rotation) -> F64:
        """The motion from the held tool to the hand."""
        assert self.at is not None
        return np.concatenate([hand - self.at, self.reach_m * (turn * self.turn.inv()).as_rotvec()])

    def _moved(self, motion: F64) -> tuple[F64, Rotation]:
        assert self.at is not None
        return self.at + motion[:3], Rotation.from_rotvec(motion[3:] / self.reach_m) * self.turn

    def _rows(self, arms: F64, normals: F64) -> F64:
        return np.hstack([normals, np.cross(arms, normals) / self.reach_m])

    def _wrench(self, motion: F64) -> F64:
        """What the springs pull the hand with, were the hand off by -motion."""
        return self.springs[0] * np.concatenate([motion[:3], self.reach_m * motion[3:]])


def _nearest(wanted: F64, rows: F64) -> F64:
    """The motion nearest to the one wanted that goes against no row."""
    if not len(rows):
        return wanted
    return np.asarray(wanted + rows.T @ nnls(rows.T, -wanted, maxiter=50 * len(rows) + 100)[0])


class GodObject(_Held):
    """See above."""

    def tick(self, pose: F64) -> tuple[F64, F64]:
        """Wrench (6,) on the hand, held pose (7,)."""
        hand, turn, _ = self._begin(pose)
        for _ in range(PASSES):
            wanted = self._apart(hand, turn)
            allowed = self._allowed(wanted)
            if np.linalg.norm(allowed) < 1e-8:
                break
            share = self._free_share(allowed)
            self.at, self.turn = self._moved(share * allowed)
            if share == 1.0 and np.linalg.norm(allowed) < 1e-6:
                break
        wanted = self._apart(hand, turn)
        assert self.at is not None
        return self._wrench(self._held_back(wanted)), _joined(self.at, self.turn)

    def _touching(self) -> tuple[F64, F64]:
        """Arms and normals (n, 3) of the contacts."""
        assert self.at is not None
        arms = self.turn.apply(self.field.samples_m)
        phi, gradient = self.field.look(arms + self.at)
        near = phi < TOUCH_M
        return arms[near], gradient[near]

    def _allowed(self, wanted: F64) -> F64:
        """The motion nearest to the one wanted that leads into no contact."""
        return _nearest(wanted, self._rows(*self._touching()))

    def _held_back(self, wanted: F64) -> F64:
        """What the contacts take off the motion wanted."""
        return self._allowed(wanted) - wanted

    def _free_share(self, motion: F64) -> float:
        """How far the motion can be made before a sample passes the surface farther than it is."""
        start = self._least(np.zeros(6))
        far = float(
            np.linalg.norm(motion[:3])
            + np.linalg.norm(motion[3:]) / self.reach_m * self.field.radius_m
        )
        steps = max(1, int(np.ceil(4.0 * far / self.field.voxel_m)))
        limit = min(start - FINE_M, -PASSED_M)
        for i in range(1, steps + 1):
            if self._least(i / steps * motion) < limit:
                low, high = (i - 1) / steps, i / steps
                for _ in range(HALVINGS):
                    middle = 0.5 * (low + high)
                    low, high = (
                        (low, middle) if self._least(middle * motion) < limit else (middle, high)
                    )
                return low
        return 1.0

    def _least(self, motion: F64) -> float:
        at, turn = self._moved(motion)
        return float(self.field.look(turn.apply(self.field.samples_m) + at)[0].min())


class StaticCoupling(_Held):
    """See above."""

    def tick(self, pose: F64) -> tuple[F64, F64]:
        """Wrench (6,) on the hand, held pose (7,)."""
        hand, turn, _ = self._begin(pose)
        arms, phi, gradient = self._contacts()
        inside = phi < 0.0
        rows = self._rows(arms[inside], gradient[inside])
        # Over the spring's stiffness: (1 + sum of rows) motion = apart + penalties.
        stiff = np.eye(6) + HARDER * rows.T @ rows
        push = HARDER * rows.T @ -phi[inside]
        motion = np.asarray(np.linalg.solve(stiff, self._apart(hand, turn) + push), np.float64)
        self.at, self.turn = self._moved(motion)
        felt = -self._apart(hand, turn)
        return self._wrench(felt), _joined(self.at, self.turn)

    def _contacts(self) -> tuple[F64, F64, F64]:
        """Arms (n, 3), distances (n,) and normals (n, 3) of what may touch."""
        assert self.at is not None
        arms = self.turn.apply(self.field.samples_m)
        return arms, *self.field.look(arms + self.at)


class VoxmapShell(_Held):
    """See above."""

    def __init__(self, scene: Scene, springs: Springs) -> None:
        super().__init__(scene, springs)
        self.inertia_kgm2 = 0.4 * BODY_KG * self.field.radius_m**2
        self.velocity = np.zeros(6)
        self.dampers = 1.4 * np.sqrt([springs[0] * BODY_KG, springs[1] * self.inertia_kgm2])
        self._last: F64 | None = None

    def tick(self, pose: F64) -> tuple[F64, F64]:
        """Wrench (6,) on the hand, held pose (7,)."""
        hand, turn, _ = self._begin(pose)
        last_at, last_turn = _split(pose if self._last is None else self._last)
        going = np.concatenate([hand - last_at, (turn * last_turn.inv()).as_rotvec()]) / PERIOD_S
        self._last = np.array(pose)
        pull = self._pull(hand, turn, going)
        inertia = np.repeat([BODY_KG, self.inertia_kgm2], 3)
        self.velocity = self.velocity + PERIOD_S / inertia * (pull + self._contact())
        assert self.at is not None
        self.at = self.at + PERIOD_S * self.velocity[:3]
        self.turn = Rotation.from_rotvec(PERIOD_S * self.velocity[3:]) * self.turn
        return -self._pull(hand, turn, going), _joined(self.at, self.turn)

    def _pull(self, hand: F64, turn: Rotation, going: F64) -> F64:
        """Spring and damper, on the held tool."""
        apart = self._apart(hand, turn)
        spring = np.concatenate(
            [self.springs[0] * apart[:3], self.springs[1] / self.reach_m * apart[3:]]
        )
        return np.asarray(spring + np.repeat(self.dampers, 3) * (going - self.velocity))

    def _contact(self) -> F64:
        """Planes through the centres of voxels, with the normals of the shell."""
        assert self.at is not None
        h = self.field.voxel_m
        arms = self.turn.apply(self.field.samples_m)
        inward = -self.turn.apply(self.field.normals)
        points = arms + self.at
        centres = (np.floor(points / h) + 0.5) * h
        phi, gradient = self.field.look(centres)
        # A voxel deeper than the surface's leads to the nearest place of the surface.
        centres = np.where((phi < -0.5 * h)[:, None], centres - phi[:, None] * gradient, centres)
        inward = np.where(np.linalg.norm(inward, axis=1, keepdims=True) > 0.5, inward, gradient)
        depth = np.einsum("ij,ij->i", inward, centres - points)
        hit = (phi < 0.5 * h) & (depth > 0.0)
        count = int(np.count_nonzero(hit))
        if count == 0:
            return np.zeros(6)
        stiff = POINT_N_M * min(1.0, POINTS_FULL / count)
        force = stiff * depth[hit, None] * inward[hit]
        return np.concatenate([force.sum(axis=0), np.cross(arms[hit], force).sum(axis=0)])


class _LineField(Field):
    """The samples are places of a line, half a voxel apart."""

    def __init__(self, scene: Scene, line: Line) -> None:
        super().__init__(scene)
        self.line = line
        way = line.ends_m[1] - line.ends_m[0]
        parts = max(2, int(np.ceil(2.0 * np.linalg.norm(way) / self.voxel_m)))
        self.shares = np.linspace(0.0, 1.0, parts + 1)
        self.samples_m = line.ends_m[0] + self.shares[:, None] * way


class LineTool(GodObject):
    """See above."""

    def __init__(self, scene: Scene, springs: Springs, line: Line) -> None:
        super().__init__(scene, springs)
        self.field: _LineField = _LineField(scene, line)
        way = line.ends_m[1] - line.ends_m[0]
        self.axis = way / np.linalg.norm(way)

    def handles_N(self, motion: F64) -> F64:
        """Forces on the hand at the handles, `reach_m` to both sides of the origin: (2, 3)."""
        leant = np.cross(motion[3:], self.turn.apply(self.axis))
        return np.asarray(
            0.5 * self.springs[0] * np.array([motion[:3] + leant, motion[:3] - leant])
        )

    def _wrench(self, motion: F64) -> F64:
        ahead, behind = self.handles_N(motion)
        arm = self.reach_m * self.turn.apply(self.axis)
        return np.concatenate([ahead + behind, np.cross(arm, ahead - behind)])

    def _touching(self) -> tuple[F64, F64]:
        assert self.at is not None
        places, phi, gradient = self._closest(self.at, self.turn)
        near = phi < TOUCH_M
        return places[near] - self.at, gradient[near]

    def _least(self, motion: F64) -> float:
        return float(self._closest(*self._moved(motion))[1].min())

    def _closest(self, at: F64, turn: Rotation) -> tuple[F64, F64, F64]:
        """Places (n, 3), distances, normals: of the ends, and where between them the line is closer than beside."""
        start, stop = turn.apply(self.field.line.ends_m) + at

        def places(shares: F64) -> F64:
            return np.asarray(start + shares.reshape(-1, 1) * (stop - start))

        shares = self.field.shares
        phi = self.field.look(places(shares))[0]
        low = (phi[1:-1] <= phi[:-2]) & (phi[1:-1] <= phi[2:]) & (phi[1:-1] < self.field.voxel_m)
        best, wide = shares[1:-1][low], float(shares[1])
        for _ in range(ZOOMS):
            tried = np.clip(best[:, None] + wide * np.linspace(-1.0, 1.0, 9), 0.0, 1.0)
            found = self.field.look(places(tried))[0].reshape(-1, 9)
            best = tried[np.arange(len(best)), found.argmin(axis=1)]
            wide *= 0.25
        found_m = places(np.concatenate([[0.0, 1.0], best]))
        phi, gradient = self.field.look(found_m)
        gradient[2:] = self._upright(found_m[2:], gradient[2:], turn.apply(self.axis))
        return found_m, phi, gradient

    def _upright(self, places_m: F64, normals: F64, way: F64) -> F64:
        """Where a line is closest over an edge: between the normals on both sides, at a right angle to the line."""
        aside = BESIDE * self.field.voxel_m * way
        before, after = (self.field.look(places_m + s * aside)[1] for s in (-1.0, 1.0))
        down, up = before @ way, after @ way
        share = (-down / np.where(up > down, up - down, 1.0))[:, None]
        between = before + share * (after - before)
        length = np.linalg.norm(between, axis=1, keepdims=True)
        edge = ((down < 0.0) & (up > 0.0))[:, None]
        return np.where(edge, between / np.where(edge, length, 1.0), normals)


class ForceShading(GodObject):
    """See above."""

    def __init__(self, scene: Scene, springs: Springs, reach_m: float | None = None) -> None:
        """reach_m: half of a facet; a voxel where nothing is said."""
        super().__init__(scene, springs)
        k = np.arange(DISC)
        radius = (self.field.voxel_m if reach_m is None else reach_m) * np.sqrt((k + 0.5) / DISC)
        turned = k * np.pi * (3.0 - np.sqrt(5.0))  # evenly spread over a disc
        self._disc_m = radius[:, None] * np.column_stack([np.cos(turned), np.sin(turned)])
        self._same = float(np.cos(scene.meta.crease_angle_rad))

    def _allowed(self, wanted: F64) -> F64:
        return super()._allowed(self._shaded(wanted))

    def _held_back(self, wanted: F64) -> F64:
        return self._shaded(wanted) - wanted

    def _shaded(self, wanted: F64) -> F64:
        """The first pass: the motion nearest to the one wanted that the smooth normals allow."""
        arms, normals = self._touching()
        assert self.at is not None
        return _nearest(wanted, self._rows(arms, self.shade(arms + self.at, normals)))

    def shade(self, places_m: F64, normals: F64) -> F64:
        """Smooth normals (n, 3) at places with these."""
        beside = np.where(np.abs(normals[:, :1]) < 0.8, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
        across = np.cross(normals, beside)
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        axes = np.stack([across, np.cross(normals, across)], axis=1)
        spots = places_m[:, None] + np.einsum("ka,naj->nkj", self._disc_m, axes)
        feet = spots.reshape(-1, 3)
        phi, gradient = self.field.look(feet)
        feet -= phi[:, None] * gradient  # off the surface, beside a crease, normals lie between
        seen = self.field.look(feet)[1].reshape(spots.shape)
        same = np.einsum("nkj,nj->nk", seen, normals) > self._same
        mean = normals + np.einsum("nk,nkj->nj", same, seen)
        return np.asarray(mean / np.linalg.norm(mean, axis=1, keepdims=True))


@dataclass(frozen=True)
class Shell:
    """A coarser shell of the tool, of flat pieces."""

    piece: npt.NDArray[np.int64]
    """That a sample belongs to, (n,)."""
    counts: npt.NDArray[np.int64]
    """Samples of a piece, (m,)."""
    middles_m: F64
    normals: F64
    off_m: F64
    """How far the surface about a piece lies off its plane, (m,)."""


def shells_of(points_m: F64) -> list[Shell]:
    """From the coarsest to the one before the samples themselves; a piece lies in one piece of the next."""
    order = _spread(points_m)
    piece = np.empty(len(order), np.int64)
    piece[order] = np.arange(len(order))
    tree = cKDTree(points_m)
    shells: list[Shell] = []
    count = len(order)
    while count // COARSER >= PIECES_MIN:
        fewer = points_m[order[: count // COARSER]]
        piece = cKDTree(fewer).query(points_m[order[:count]])[1][piece]
        count = len(fewer)
        reach = float(np.linalg.norm(points_m - fewer[piece], axis=1).max())
        planes = [_plane(points_m[tree.query_ball_point(p, reach)]) for p in fewer]
        middles, normals, off = (np.array(v) for v in zip(*planes, strict=True))
        shells.insert(0, Shell(piece, np.bincount(piece, minlength=count), middles, normals, off))
    return shells


def _spread(points_m: F64) -> npt.NDArray[np.int64]:
    """Each next point is the farthest from those before; the first the farthest from the middle."""
    order = [int(np.linalg.norm(points_m - points_m.mean(axis=0), axis=1).argmax())]
    far = np.linalg.norm(points_m - points_m[order[0]], axis=1)
    while len(order) < len(points_m):
        far[order[-1]] = -1.0
        order.append(int(far.argmax()))
        far = np.minimum(far, np.linalg.norm(points_m - points_m[order[-1]], axis=1))
    return np.array(order)


def _plane(points_m: F64) -> tuple[F64, F64, float]:
    """Middle, normal, and the largest distance from the plane nearest to the points."""
    middle = points_m.mean(axis=0)
    normal = np.linalg.eigh((points_m - middle).T @ (points_m - middle))[1][:, 0]
    return middle, normal, float(np.abs((points_m - middle) @ normal).max())


class ContactLevels(StaticCoupling):
    """See above."""

    def __init__(self, scene: Scene, springs: Springs, felt_m: float | None = None) -> None:
        """felt_m: the threshold; FELT of the tool's radius where nothing is said."""
        super().__init__(scene, springs)
        self.felt_m = FELT * self.field.radius_m if felt_m is None else felt_m
        self.shells = shells_of(self.field.samples_m)
        self.pieces = self.contacts = 0
        """Of the last tick: looked at, and of these inside."""

    def _contacts(self) -> tuple[F64, F64, F64]:
        arms, phi, _ = super()._contacts()
        arms = self.turn.apply(self._places(phi))
        assert self.at is not None
        phi, gradient = self.field.look(arms + self.at)
        self.pieces = len(phi)
        self.contacts = int(np.count_nonzero(phi < 0.0))
        return arms, phi, gradient

    def _places(self, phi: F64) -> F64:
        """Of the pieces that touch, each of the coarsest shell that will do: its deepest place, tool frame, (n, 3)."""
        samples = self.field.samples_m
        left, places = np.ones(len(phi), bool), []
        for shell in self.shells:
            near = np.bincount(shell.piece[left & (phi < self.felt_m)], minlength=len(shell.off_m))
            # The volume between piece and surface, over the area that touches.
            error = shell.off_m * shell.counts / np.maximum(near, 1)
            kept = (near > 0) & (error < self.felt_m)
            for i in np.flatnonzero(kept).tolist():
                of = np.flatnonzero(shell.piece == i)
                deepest = samples[of[phi[of].argmin()]]
                normal = shell.normals[i]
                places.append(deepest - normal * float(normal @ (deepest - shell.middles_m[i])))
            left &= (near > 0)[shell.piece] & ~kept[shell.piece]
        return np.concatenate([samples[left], np.reshape(places, (-1, 3))])


Rival = GodObject | StaticCoupling | VoxmapShell

RIVALS: dict[str, type[GodObject] | type[StaticCoupling] | type[VoxmapShell]] = {
    "god-object": GodObject,
    "static coupling": StaticCoupling,
    "voxmap": VoxmapShell,
    "force shading": ForceShading,
    "contact levels": ContactLevels,
}
"""By the name that tables and figures have: those for any tool."""
LINE = "line by rays"
"""The one that is for lines alone."""
NAMES = (*RIVALS, LINE)


def make_rival(name: str, scene: Scene, springs: Springs, line: Line | None = None) -> Rival | None:
    """A fresh method; None: it is for lines, and the tool is none."""
    if name == LINE:
        return None if line is None else LineTool(scene, springs, line)
    return RIVALS[name](scene, springs)
