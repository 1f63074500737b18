"""P1 to P9, each a function of what was measured on one scene, with its bound.

The properties assume no formula: a force is compared with booleans of the two solids, planes of faces, or a second
answer.
Where a scene does not pose a question the check returns nothing, and nothing is rated.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from crease.base.attitude import to_matrix
from scipy.spatial.transform import Rotation

from study.properties.answers import Answer, Ask, refined
from study.properties.geometry import (
    F64,
    Overlap,
    Pair,
    face_normals,
    width_mm,
)
from study.properties.scenes import PropertyScene

DEEP_MM = 0.2
"""Factors and shares are measured where the overlap is thicker than this: below, samples and rounding rule."""

CLEAR_BAND = (0.9, 1.05)
FLAT_MAX = 0.01
JUMP_MAX_MM = 0.005
TWIN_MAX = 0.01
WALL_MAX = 0.02
ENERGY_MAX = 0.01
GHOST_MAX_MM = 0.02
"""Force over stiffness without overlap: 20 um, what a voxmap of 1 mm leaves of a curved face."""
TORQUE_RMS_MAX_MM = 0.02
BALANCE_MAX_MM = 0.02
JAM_MAX = 1.5
"""Force over stiffness in a jam, over the thickness of the overlap: the deepest contact, or two at right angles."""
JAW_WHOLE_MM = -4.0
"""From here on all of the jaw is on the bar's full width: interference differs by twice its offset."""
JUMP_PARTS = 256
JUMP_TICKS = 12
JUMP_SLOPE = 5.0
JUMP_SHARE = 8.0
"""A tick's change may be spread over an eighth of the tick, and each part may change by JUMP_SLOPE of its way: steep is
P9's business."""
TURN_RAD = 1e-3


@dataclass(frozen=True)
class Finding:
    """One number of a check and its bound: kept when value <= bound. NaN as the bound: told, not rated."""

    key: str
    value: float
    bound: float = float("nan")

    @property
    def rated(self) -> bool:
        """Whether there is a bound."""
        return not np.isnan(self.bound)

    @property
    def kept(self) -> bool:
        """Whether the bound is kept; NaN is not."""
        return bool(self.value <= self.bound)


@dataclass(frozen=True)
class Case:
    """A scene, its path, what booleans say at some of its ticks, and one answer along it.

    at (m,): ticks that booleans were made at; overlaps (m,): what they found. steps_mm (n - 1,): way of each tick.
    """

    scene: PropertyScene
    pair: Pair
    poses: F64 = field(repr=False)
    steps_mm: F64 = field(repr=False)
    at: npt.NDArray[np.int64] = field(repr=False)
    overlaps: list[Overlap] = field(repr=False)
    answer: Answer = field(repr=False)
    ask: Ask | None = field(repr=False)
    twins: Mapping[str, Answer] = field(default_factory=dict, repr=False)
    clear_poses: int = 60
    jams: dict[int, bool] = field(default_factory=dict, repr=False)

    def deep(self) -> list[int]:
        """Places in `at` where the overlap is thicker than DEEP_MM."""
        return [i for i, o in enumerate(self.overlaps) if o.thickness_mm > DEEP_MM]

    def thinned(self) -> list[int]:
        """Of the deep places so many as `clear_poses` allows."""
        deep = self.deep()
        return deep[:: max(1, -(-len(deep) // self.clear_poses))]

    def is_jammed(self, i: int) -> bool:
        """Whether no way leads out at place i; found once, for all answers."""
        if i not in self.jams:
            self.jams[i] = self.pair.is_jammed(self.poses[self.at[i]], self.overlaps[i])
        return self.jams[i]

    def force_mm(self, i: int) -> F64:
        """Force over stiffness at place i of `at`."""
        return np.asarray(self.answer.way_mm[self.at[i]])


def _size(vectors: F64) -> F64:
    return np.asarray(np.linalg.norm(vectors, axis=-1))


def flat(case: Case) -> list[Finding]:
    """P1: k d on the face z = flat_z_mm while it holds a width > 2 d, and is the only one that holds anything."""
    z = case.scene.flat_z_mm
    if z is None:
        return []
    errors, largest = [], 0.0
    for i in case.deep():
        depth = _held_depth(case.pair, case.overlaps[i], z)
        if depth is None:
            continue
        force = case.force_mm(i)
        errors.append(float(np.linalg.norm(force - [0.0, 0.0, depth])) / depth)
        largest = max(largest, float(np.linalg.norm(force)) / depth)
    if not errors:
        return []
    return [
        Finding("flat_error", max(errors), FLAT_MAX),
        Finding("flat_largest", largest),
        *_half_on(case),
    ]


def _half_on(case: Case) -> list[Finding]:
    """The largest force while the middle of the tool lies on the table, x <= 0."""
    if case.scene.static != "table.stl":
        return []
    lies = case.poses[:, 0] <= 0.0
    return [Finding("half_on_mm", float(_size(case.answer.way_mm[lies]).max(initial=0.0)))]


def _held_depth(pair: Pair, overlap: Overlap, z: float) -> float | None:
    """Depth below the face z where it holds a width of twice that round the deepest place; else None."""
    points = overlap.corners_mm
    low = points[..., 2].min(axis=1)
    depth = z - float(low.min())
    deepest = overlap.piece == overlap.piece[int(np.argmin(low))]
    normals, _ = face_normals(points)
    on_face = overlap.from_static & (normals[:, 2] > 0.9999) & (np.abs(points[:, 0, 2] - z) < 1e-3)
    held = width_mm(points[on_face & deepest].reshape(-1, 3), np.array([0.0, 0.0, 1.0]))
    corners = points[deepest].reshape(-1, 3)
    bottom = corners[corners[:, 2] < z - 0.999 * depth]
    if held <= 2.0 * depth or pair.border_mm(z, bottom) <= 2.0 * depth:
        return None
    return depth


def clearing(case: Case) -> list[Finding]:
    """P2: at 95 % of the poses deeper than DEEP_MM, 0.9 < s <= 1.05. Jammed poses do not count.

    A pose is asked for a way out only where the force does not lead out. Scenes that are jammed as a whole have no P2.
    """
    if case.scene.jammed:
        return []
    factors = []
    for i in case.thinned():
        pose, overlap = case.poses[case.at[i]], case.overlaps[i]
        s = case.pair.clearing(pose, overlap.volume_mm3, case.force_mm(i))
        if s <= CLEAR_BAND[1] or not case.is_jammed(i):
            factors.append(s)
    if not factors:
        return []
    spread = np.array(factors)
    outside = float(((spread <= CLEAR_BAND[0]) | (spread > CLEAR_BAND[1])).mean())
    percentiles = [Finding(f"clear_p{p}", float(np.percentile(spread, p))) for p in (5, 50, 95)]
    return [Finding("clear_outside", outside, 0.05), *percentiles]


def jams(case: Case) -> list[Finding]:
    """P7: where no way leads out, a force bounded by the deepest contact. Poses that `clearing` found, or all."""
    found = [i for i in case.thinned() if case.scene.jammed or case.jams.get(i)]
    sizes = [float(np.linalg.norm(case.force_mm(i))) / case.overlaps[i].thickness_mm for i in found]
    if not sizes:
        return []
    return [Finding("jam_largest", max(sizes), JAM_MAX), Finding("jam_poses", float(len(sizes)))]


def continuity(case: Case) -> list[Finding]:
    """P3: of the steepest ticks, cut JUMP_PARTS times finer, what is left of the change of force or torque / radius."""
    if case.ask is None:
        return []
    wrench = _wrench_mm(case, case.answer)
    rate = _size(np.diff(wrench, axis=0)).max(axis=1) / np.maximum(case.steps_mm, 1e-9)
    at = np.sort(np.argsort(rate)[-JUMP_TICKS:])
    fine, is_part = refined(case.poses, at, JUMP_PARTS)
    change = _size(np.diff(_wrench_mm(case, case.ask(fine)), axis=0))[is_part]
    whole = _size(np.diff(wrench, axis=0))[at]
    slope = np.maximum(JUMP_SLOPE * case.steps_mm[at, None], JUMP_SHARE * whole)
    left = np.maximum(change - np.repeat(slope, JUMP_PARTS, axis=0) / JUMP_PARTS, 0.0).max(axis=0)
    return [
        Finding("jump_mm", float(left[0]), JUMP_MAX_MM),
        Finding("torque_jump_mm", float(left[1]), JUMP_MAX_MM),
    ]


def _wrench_mm(case: Case, answer: Answer) -> F64:
    """Force over stiffness, and torque over stiffness and tool radius, (n, 2, 3), mm."""
    return np.stack([answer.way_mm, answer.turn_mm2 / case.pair.radius_mm], axis=1)


def idempotence(case: Case) -> list[Finding]:
    """P4: the same force as the twin scene's, whose surface is cut otherwise.

    Where tool and obstacle have changed places, how far the force is from minus the other's, turned: told, not rated.
    """
    out = []
    if (twin := case.twins.get(case.scene.twin or "")) is not None:
        difference = float(_size(case.answer.way_mm - twin.way_mm).max())
        share = difference / max(float(_size(twin.way_mm).max()), 1e-9)
        out.append(Finding("twin_error", share, TWIN_MAX))
    if (other := case.twins.get(case.scene.exchanged or "")) is not None:
        turned = to_matrix(case.poses[:, 3:])
        back = -np.einsum("nab,nb->na", turned, other.way_mm)
        out.append(Finding("exchange_mm", float(_size(case.answer.way_mm - back).max())))
    return out


def walls(case: Case) -> list[Finding]:
    """P5: along the normal of each wall touched, that wall's k d, while each holds a width > 2 d."""
    errors: list[float] = []
    for i in case.deep():
        errors += _wall_errors(case, case.overlaps[i], case.force_mm(i))
    return [Finding("wall_error", max(errors), WALL_MAX)] if errors else []


def _wall_errors(case: Case, overlap: Overlap, force: F64) -> list[float]:
    """Error of each wall as a share of the deepest; empty where the question is not posed."""
    points = overlap.corners_mm[overlap.from_static]
    normals, area = face_normals(points)
    points, normals = points[area > 1e-9], normals[area > 1e-9]
    known = np.zeros(len(points), dtype=np.bool_)
    touched: list[tuple[F64, float]] = []
    for wall in case.scene.walls:
        n, offset = np.array(wall[:3]), wall[3]
        mine = (normals @ n > 0.9999) & (np.abs(points[:, 0] @ n - offset) < 1e-3)
        if not mine.any():
            continue
        depth = float(offset - (overlap.corners_mm @ n).min())
        if width_mm(points[mine].reshape(-1, 3), n) <= 2.0 * depth:
            return []
        known |= mine
        touched.append((n, depth))
    facing = any(a @ b < -0.5 for a, _ in touched for b, _ in touched)
    if facing or not touched or not known.all():
        return []
    deepest = max(depth for _, depth in touched)
    return [abs(float(force @ n) - depth) / deepest for n, depth in touched]


def energy(case: Case) -> list[Finding]:
    """P6: work of force and torque over the path, which begins and ends free, over the largest energy stored.

    Where the force jumps within a tick, half the jump times the tick's way is in doubt, and is not counted.
    """
    way, turn = case.answer.way_mm, case.answer.turn_mm2
    stored = 0.5 * float((way**2).sum(axis=1).max())
    ends = _size(way[[0, -1]]).max()
    if stored <= 0.0 or ends > 0.0:
        return []
    moved = np.diff(case.poses[:, :3], axis=0)
    swung = _turns(case.poses)
    if np.isnan(turn).any():
        if swung.any():
            return []
        turn = np.zeros_like(turn)
    work = 0.5 * float(
        ((way[1:] + way[:-1]) * moved).sum() + ((turn[1:] + turn[:-1]) * swung).sum()
    )
    jumps = np.maximum(_size(np.diff(way, axis=0)) - JUMP_SLOPE * case.steps_mm, 0.0)
    doubt = 0.5 * float((jumps * case.steps_mm).sum())
    return [Finding("energy_share", max(abs(work) - doubt, 0.0) / stored, ENERGY_MAX)]


def _turns(poses: F64) -> F64:
    """Small turn of each tick, world frame, (n - 1, 3) rad."""
    matrices = to_matrix(poses[:, 3:])
    between = np.einsum("nab,ncb->nac", matrices[1:], matrices[:-1])
    skew = 0.5 * (between - between.transpose(0, 2, 1))
    return np.column_stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]])


def ghosts_and_misses(case: Case) -> list[Finding]:
    """P7: no force without overlap, and a force in every overlap thicker than half a sample."""
    size = _size(case.answer.way_mm[case.at])
    volume = np.array([o.volume_mm3 for o in case.overlaps])
    thick = np.array([o.thickness_mm for o in case.overlaps])
    silent = thick[(volume > 0.0) & (size <= 0.0)].max(initial=0.0)
    bound = case.scene.silent_max_mm or 0.5 * case.scene.spacing_mm
    ghosts = size[volume <= 0.0]
    return [
        Finding("ghost_mm", float(ghosts.max(initial=0.0)), GHOST_MAX_MM),
        Finding("ghost_poses", float((ghosts > GHOST_MAX_MM).sum())),
        Finding("silent_mm", float(silent), bound),
    ]


def balance(case: Case) -> list[Finding]:
    """P7: a jaw gripped unequally feels a fraction of the difference, towards the middle, and nothing else.

    What is told is how far the force is from what is allowed: from 0 to k times the difference along x.
    """
    if case.scene.balance != "jaw":
        return []
    upright = np.abs(case.poses[:, 3]) > 1.0 - 1e-12
    whole = upright & (case.poses[:, 1] > JAW_WHOLE_MM)
    if not whole.any():
        return []
    x, force = case.poses[whole, 0], case.answer.way_mm[whole]
    along = -np.sign(x) * force[:, 0]
    wrong = np.maximum(np.maximum(-along, along - 2.0 * np.abs(x)), 0.0)
    other = _size(force[:, 1:])
    return [Finding("balance_mm", float(np.maximum(wrong, other).max()), BALANCE_MAX_MM)]


def torque(case: Case) -> list[Finding]:
    """P8: torque = -|F| d(way out along F) / d(turn), between its one-sided values; error / radius, RMS, mm.

    Both bodies convex: the way out is exact, from the difference of the hulls.
    """
    if not case.scene.convex or np.isnan(case.answer.turn_mm2).any():
        return []
    errors = []
    deep = case.deep()
    for i in deep[:: max(1, len(deep) // 20)]:
        force, pose = case.force_mm(i), case.poses[case.at[i]]
        size = float(np.linalg.norm(force))
        if size > 0.5 * DEEP_MM:
            lever = case.answer.turn_mm2[case.at[i]] / size
            errors.append(_torque_error(case.pair, pose, force / size, lever) * size)
    if not errors:
        return []
    error = np.array(errors) / case.pair.radius_mm
    return [Finding("torque_rms_mm", float(np.sqrt((error**2).mean())), TORQUE_RMS_MAX_MM)]


def _torque_error(pair: Pair, pose: F64, direction: F64, lever: F64) -> float:
    """Distance of the lever (3,) in mm from the box of one-sided slopes of the way out."""
    here, error = pair.exit_mm(pose, direction), np.zeros(3)
    for axis in range(3):
        ends = [
            -sign
            * (pair.exit_mm(_turned(pose, axis, sign * TURN_RAD), direction) - here)
            / TURN_RAD
            for sign in (-1.0, 1.0)
        ]
        room = 1e-3 * pair.radius_mm
        error[axis] = max(min(ends) - room - lever[axis], lever[axis] - max(ends) - room, 0.0)
    return float(np.linalg.norm(error))


def _turned(pose: F64, axis: int, angle_rad: float) -> F64:
    """The pose turned about its origin by a small angle round a world axis."""
    by = Rotation.from_rotvec(angle_rad * np.eye(3)[axis])
    turned = by * Rotation.from_quat(pose[3:], scalar_first=True)
    return np.concatenate([pose[:3], turned.as_quat(scalar_first=True)])


def amplification(case: Case) -> list[Finding]:
    """P9: change of force over stiffness and the largest way of the tool; of torque / radius told. Largest and p99."""
    moving = case.steps_mm > 1e-6
    change = _size(np.diff(_wrench_mm(case, case.answer), axis=0))[moving]
    rate = change / case.steps_mm[moving, None]
    touching = rate[change[:, 0] > 0.0]
    p99 = np.percentile(touching, 99, axis=0) if len(touching) else np.zeros(2)
    out = [
        Finding("amplification", float(rate[:, 0].max(initial=0.0)), case.scene.amplification_max),
        Finding("amplification_p99", float(p99[0])),
        Finding("force_largest_mm", float(_size(case.answer.way_mm).max())),
    ]
    if not np.isnan(rate[:, 1]).any():
        out.append(Finding("torque_amplification", float(rate[:, 1].max(initial=0.0))))
        out.append(Finding("torque_amplification_p99", float(p99[1])))
    return out


CHECKS: dict[str, tuple[Callable[[Case], list[Finding]], ...]] = {
    "P1": (flat,),
    "P2": (clearing,),
    "P3": (continuity,),
    "P4": (idempotence,),
    "P5": (walls,),
    "P6": (energy,),
    "P7": (ghosts_and_misses, balance, jams),
    "P8": (torque,),
    "P9": (amplification,),
}
