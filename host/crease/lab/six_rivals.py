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
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls
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

Springs = tuple[float, float]


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
        return self._wrench(self._allowed(wanted) - wanted), _joined(self.at, self.turn)

    def _allowed(self, wanted: F64) -> F64:
        """The motion nearest to the one wanted that leads into no contact."""
        assert self.at is not None
        arms = self.turn.apply(self.field.samples_m)
        phi, gradient = self.field.look(arms + self.at)
        near = phi < TOUCH_M
        if not near.any():
            return wanted
        rows = self._rows(arms[near], gradient[near])
        return np.asarray(wanted + rows.T @ nnls(rows.T, -wanted, maxiter=50 * len(rows) + 100)[0])

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
        assert self.at is not None
        arms = self.turn.apply(self.field.samples_m)
        phi, gradient = self.field.look(arms + self.at)
        inside = phi < 0.0
        rows = self._rows(arms[inside], gradient[inside])
        # Over the spring's stiffness: (1 + sum of rows) motion = apart + penalties.
        stiff = np.eye(6) + HARDER * rows.T @ rows
        push = HARDER * rows.T @ -phi[inside]
        motion = np.asarray(np.linalg.solve(stiff, self._apart(hand, turn) + push), np.float64)
        self.at, self.turn = self._moved(motion)
        felt = -self._apart(hand, turn)
        return self._wrench(felt), _joined(self.at, self.turn)


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


RIVALS: dict[str, type[GodObject] | type[StaticCoupling] | type[VoxmapShell]] = {
    "god-object": GodObject,
    "static coupling": StaticCoupling,
    "voxmap": VoxmapShell,
}
"""By the name that tables and figures have."""
