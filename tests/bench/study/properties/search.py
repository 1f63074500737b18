"""The worst pose near a scene's path, for amplification and for clearing: random restarts, then smaller steps.

A path shows what happens on it. Here poses are drawn round it, the worst are kept, and each is led on by steps that
shrink. Poses that are jammed, thinner than DEEP_MM, or thicker than anything on the path do not count.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from study.properties.answers import Ask
from study.properties.checks import CLEAR_BAND, DEEP_MM
from study.properties.geometry import F64
from study.properties.judge import Stage

SEARCHED = ("over_edge_1_1", "corner_turned")
"""Scenes that are searched when none is named."""

STARTS, KEPT, ROUNDS, CHILDREN = 150, 4, 8, 20
SPREAD_MM, SHRINK = 1.5, 0.6
"""Of the first draw and, in turns, at the tool's radius; how much less in each round."""
STEP_MM = 0.02
"""Way of the small motion that the change of force is measured over: the least step of the scenes' paths."""
SEED = 20260


@dataclass(frozen=True)
class Worst:
    """The worst pose found (7,), mm; its value: amplification, or the clearing factor."""

    scene: str
    response: str
    measure: str
    value: float
    pose: F64
    force_mm: F64
    asked: int


def search(stage: Stage, response: str, ask: Ask) -> list[Worst]:
    """Both searches on one scene.   Cost: some thousand ticks, and as many booleans."""
    thickest = max(o.thickness_mm for o in stage.overlaps)
    out = []
    for measure, rate in (("amplification", _amplification), ("clearing", _clearing)):
        badness = _allowed(stage, thickest, rate)
        pose, asked = _climb(stage, ask, badness)
        value = rate(stage, ask, pose[None])[0]
        out.append(
            Worst(
                stage.scene.name, response, measure, value, pose, ask(pose[None]).way_mm[0], asked
            )
        )
    return out


Rate = Callable[[Stage, Ask, F64], F64]
"""What is searched for, of poses (n, 7): (n,)."""


def _amplification(stage: Stage, ask: Ask, poses: F64) -> F64:
    """The largest change of force over stiffness and way, over a small step along and about each axis."""
    ways = np.vstack([np.eye(6), -np.eye(6)]) * STEP_MM
    ways[:, 3:] /= stage.pair.radius_mm
    around = np.concatenate(
        [[pose, *_moved(np.repeat(pose[None], 12, axis=0), ways)] for pose in poses]
    )
    force = ask(around).way_mm.reshape(len(poses), 13, 3)
    change = np.linalg.norm(force[:, 1:] - force[:, :1], axis=2) / STEP_MM
    return np.asarray(change.max(axis=1))


def _clearing(stage: Stage, ask: Ask, poses: F64) -> F64:
    """The clearing factor."""
    force = ask(poses).way_mm
    volumes = [stage.pair.volume(pose) for pose in poses]
    return np.array(
        [stage.pair.clearing(p, v, f) for p, v, f in zip(poses, volumes, force, strict=True)]
    )


def _allowed(stage: Stage, thickest_mm: float, rate: Rate) -> Rate:
    """How bad poses are; -1 where they do not count. Clearing: the factor by which it leaves its band."""

    def badness(_: Stage, ask: Ask, poses: F64) -> F64:
        out = np.full(len(poses), -1.0)
        overlaps = [stage.pair.overlap(pose) for pose in poses]
        counts = np.array([DEEP_MM < o.thickness_mm <= thickest_mm for o in overlaps])
        if counts.any():
            found = rate(stage, ask, poses[counts])
            if rate is _clearing:
                found = np.maximum(found / CLEAR_BAND[1], CLEAR_BAND[0] / found)
            out[counts] = found
        for i in np.argsort(-out)[:KEPT]:
            if out[i] > 1.0 and stage.pair.is_jammed(poses[i], overlaps[i]):
                out[i] = -1.0
        return out

    return badness


def _climb(stage: Stage, ask: Ask, badness: Rate) -> tuple[F64, int]:
    """The worst pose and how many were asked."""
    rng = np.random.default_rng(SEED)
    inside = stage.at[: sum(o.volume_mm3 > 0.0 for o in stage.overlaps)]
    poses = _drawn(rng, stage, stage.poses[rng.choice(inside, STARTS)], SPREAD_MM)
    bad = badness(stage, ask, poses)
    asked, spread = len(poses), SPREAD_MM
    for _ in range(ROUNDS):
        spread *= SHRINK
        best = np.argsort(-bad)[:KEPT]
        poses, bad = poses[best], bad[best]
        children = _drawn(rng, stage, np.repeat(poses, CHILDREN, axis=0), spread)
        poses = np.concatenate([poses, children])
        bad = np.concatenate([bad, badness(stage, ask, children)])
        asked += len(children)
    return np.asarray(poses[int(np.argmax(bad))]), asked


def _drawn(rng: np.random.Generator, stage: Stage, poses: F64, spread_mm: float) -> F64:
    """Poses at random round these."""
    ways = rng.normal(0.0, spread_mm, (len(poses), 6))
    ways[:, 3:] /= stage.pair.radius_mm
    return _moved(poses, ways)


def _moved(poses: F64, ways: F64) -> F64:
    """Poses (n, 7) shifted and turned about their origins by ways (n, 6), mm and rad, world frame."""
    turned = Rotation.from_rotvec(ways[:, 3:]) * Rotation.from_quat(poses[:, [4, 5, 6, 3]])
    return np.hstack([poses[:, :3] + ways[:, :3], turned.as_quat()[:, [3, 0, 1, 2]]])
