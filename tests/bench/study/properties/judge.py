"""All scenes and responses through the checks: what was found, row by row."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt
from crease.base.errors import CreaseError
from crease.replay.replay import ReplayOptions
from crease.replay.trajectory import load_trajectory

from study.properties.answers import Answer, Ask, asker, poses_mm, steps_mm
from study.properties.checks import CHECKS, Case, Finding
from study.properties.geometry import F64, NOTHING, Overlap, Pair
from study.properties.scenes import PropertyScene, bake_digest, image_of, load_meshes

LOOKS = 150
"""Ticks of a path that are asked whether there is overlap at all."""


@dataclass(frozen=True)
class Effort:
    """How much is done: poses with all facts, seconds of booleans for the clearing of a scene, runs for the time."""

    poses: int = 60
    clear_s: float = 0.5
    repeat: int = 3


SILENT_MAX = 0.5
"""A response that is silent in more than this share of the deep poses of a scene keeps nothing there: no force does not
jump, does not amplify and makes no energy."""

QUICK = Effort(poses=16, clear_s=0.06, repeat=1)


@dataclass(frozen=True)
class Stage:
    """A scene ready to be asked: solids, path, and what booleans say along it; the same for every response."""

    scene: PropertyScene
    pair: Pair
    poses: F64 = field(repr=False)
    steps_mm: F64 = field(repr=False)
    at: npt.NDArray[np.int64] = field(repr=False)
    overlaps: list[Overlap] = field(repr=False)
    clear_poses: int
    jams: dict[int, bool] = field(default_factory=dict, repr=False)


@dataclass(frozen=True)
class Row:
    """What one response does on one scene.

    findings: by property. silent: share of the deep poses without force. Times over the ticks in contact, us.
    way_mm (n, 3): force over stiffness of every tick.
    """

    scene: PropertyScene
    response: str
    findings: Mapping[str, list[Finding]]
    silent: float
    tick_p50_us: float
    tick_p99_us: float
    way_mm: F64 = field(repr=False)

    def values(self) -> dict[str, float]:
        """Every number by key."""
        return {f.key: f.value for group in self.findings.values() for f in group}

    def verdicts(self) -> dict[str, bool]:
        """Whether each property that the scene rates is kept; none where the response is silent."""
        rated = {name: [f for f in group if f.rated] for name, group in self.findings.items()}
        heard = self.silent <= SILENT_MAX
        return {
            name: heard and all(f.kept for f in group) for name, group in rated.items() if group
        }

    def excess(self) -> dict[str, float]:
        """The largest value over its bound of each property that is rated."""
        out = {}
        for name, group in self.findings.items():
            if rated := [f.value / f.bound for f in group if f.rated]:
                out[name] = max(rated)
        return out


def make_stage(
    scene: PropertyScene, meshes: Path, pair: Pair, effort: Effort, every: int = 1
) -> Stage:
    """Look along the path, each `every`-th tick of it, then closely at some poses in contact.   Errors: CreaseError."""
    file = meshes / scene.path
    if not file.exists():
        raise CreaseError(
            f"{file}: is missing; run `make meshes`, or name its folder with --meshes"
        )
    poses = poses_mm(load_trajectory(file))[::every]
    looks = np.unique(np.linspace(0, len(poses) - 1, min(LOOKS, len(poses))).astype(np.int64))
    start = time.perf_counter()
    touches = np.array([pair.volume(poses[i]) > 0.0 for i in looks])
    boolean_s = (time.perf_counter() - start) / len(looks)
    inside, outside = looks[touches], looks[~touches]
    if len(inside) == 0:
        raise CreaseError(f"{file}: the tool of {scene.name} touches nothing")
    inside = inside[np.linspace(0, len(inside) - 1, min(effort.poses, len(inside))).astype(int)]
    low, high = pair.tool_vertices.min(axis=0), pair.tool_vertices.max(axis=0)
    pick = np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)])
    return Stage(
        scene,
        pair,
        poses,
        steps_mm(poses, np.where(pick, high, low).astype(np.float64)),
        np.concatenate([inside, outside]),
        [*(pair.overlap(poses[i]) for i in inside), *([NOTHING] * len(outside))],
        int(np.clip(effort.clear_s / (9.0 * boolean_s), 8, effort.poses)),
    )


def judge(
    stage: Stage, response: str, answer: Answer, ask: Ask | None, twins: Mapping[str, Answer]
) -> Row:
    """One answer through all checks."""
    case = Case(
        stage.scene, stage.pair, stage.poses, stage.steps_mm, stage.at, stage.overlaps, answer, ask, twins,
        stage.clear_poses, stage.jams,
    )  # fmt: skip
    findings = {
        name: [f for check in checks for f in check(case)] for name, checks in CHECKS.items()
    }
    times = answer.time_us[answer.touches] if answer.touches.any() else np.array([np.nan])
    deep = case.deep()
    silent = float(np.mean([not case.force_mm(i).any() for i in deep])) if deep else 0.0
    return Row(
        stage.scene,
        response,
        findings,
        silent,
        float(np.percentile(times, 50)),
        float(np.percentile(times, 99)),
        answer.way_mm,
    )


def judge_all(
    scenes: Sequence[PropertyScene],
    responses: Sequence[tuple[str, ReplayOptions]],
    meshes: Path,
    images: Path,
    effort: Effort,
    progress: Callable[[str], None] = lambda _: None,
) -> Iterator[Row]:
    """Every scene with every response. A scene that others are compared with must come before them."""
    code = bake_digest()
    pairs: dict[tuple[str, str], Pair] = {}
    answers: dict[str, dict[str, Answer]] = {name: {} for name, _ in responses}
    for scene in scenes:
        start = time.monotonic()
        bodies = load_meshes(scene, meshes)
        key = scene.static, scene.tool
        if key not in pairs:
            pairs[key] = Pair(*bodies)
        stage = make_stage(scene, meshes, pairs[key], effort)
        image = image_of(scene, bodies, images, code)
        for name, options in responses:
            ask = asker(image, options)
            answer = asker(image, options, effort.repeat)(stage.poses)
            answers[name][scene.name] = answer
            yield judge(stage, name, answer, ask, answers[name])
        progress(f"{scene.name}: {time.monotonic() - start:.1f} s")
