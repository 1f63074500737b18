"""Detection against brute force in double, and skipping against no skipping, on baked scenes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from crease.base.native import SKIPS
from crease.replay.replay import ROW, ReplayOptions
from property_scenes import (
    NAMES,
    SEED,
    exact_distance,
    in_world,
    pair,
    placed,
    poses_near,
    run,
    shell_points,
    walk,
)

POSES = 200
WORK = ("nodes", "points", "nodes_coherent", "clusters_inside", "tick_ns")
"""Columns that tell how much work a tick took: the only ones that skipping may change."""
ANSWERS = [name for name in ROW.names or () if name not in WORK]
WHOLE = 1 << 20
"""Work that is enough for any answer here in one tick: how much fits into a smaller share is what skipping is for."""
QUICK = ("edge", "stairs")
SCENES = [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in NAMES]


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_contacts_are_the_samples_inside(name: str) -> None:
    """Counted against exact distances; samples closer to the surface than the stated error may count either way."""
    of = pair(name)
    poses = poses_near(np.random.default_rng(SEED), of, POSES, 3e-3, 1e-3)
    distance = exact_distance(of.static, in_world(poses, shell_points(of.scene)).reshape(-1, 3))
    distance = distance.reshape(POSES, -1)
    contacts = run(of.scene, poses, ReplayOptions(lookups_max=WHOLE))["contacts"]
    inside = (distance < -of.scene.meta.error_in_m - 1e-6).sum(axis=1)
    possible = (distance < of.scene.meta.error_out_m + 1e-6).sum(axis=1)
    assert np.all((inside <= contacts) & (contacts <= possible))
    assert np.median(contacts) > 5


@pytest.mark.parametrize("name", SCENES)
def test_no_force_where_all_samples_are_beyond_their_ramp(name: str) -> None:
    of = pair(name)
    poses = poses_near(np.random.default_rng(SEED + 1), of, POSES, 0.0, 12e-3)
    distance = exact_distance(of.static, in_world(poses, shell_points(of.scene)).reshape(-1, 3))
    reach = of.scene.meta.ramp_max_m + of.scene.meta.error_out_m + 1e-6
    away = distance.reshape(POSES, -1).min(axis=1) > reach
    rows = run(of.scene, poses)
    assert away.sum() > 20
    assert not rows["force_N"][away].any()
    assert not rows["areas"][away].any()


@pytest.mark.parametrize("name", SCENES)
def test_no_force_in_free_space(name: str) -> None:
    """Solids that are apart by more than the largest distance error, by exact booleans: not a whisper of force."""
    of = pair(name)
    poses = poses_near(np.random.default_rng(SEED + 2), of, 2 * POSES, 0.1e-3, 0.6e-3)
    rows = run(of.scene, poses)
    pushed = np.flatnonzero(rows["force_N"].any(axis=1))
    error_mm = of.scene.meta.error_max_m * 1e3
    wrong = []
    for i in pushed:
        tool = placed(of.tool, poses[i])
        if (tool ^ of.static).volume() == 0.0 and tool.min_gap(of.static, 2.0) > error_mm:
            wrong.append((int(i), float(rows["depth_m"][i]) * 1e3))
    assert not wrong, f"pose and depth in mm of forces without contact: {wrong}"


@pytest.mark.parametrize("name", SCENES)
def test_overlap_deeper_than_the_error_gives_a_force(name: str) -> None:
    """Also where none of the zones leads: 9 of 1,200 such poses in `part` had no force."""
    of = pair(name)
    draws = [np.random.default_rng(seed) for seed in (SEED + 3, 0, 1, 2)]
    poses = np.concatenate([poses_near(draw, of, POSES, 3e-3, 0.0) for draw in draws])
    rows = run(of.scene, poses)
    distance = exact_distance(of.static, in_world(poses, shell_points(of.scene)).reshape(-1, 3))
    inside = distance.reshape(len(poses), -1) < -of.scene.meta.error_in_m - 0.2e-3
    # A tool wholly inside has no direction: the gradient of the overlap volume is zero.
    several = (inside.sum(axis=1) > 3) & (distance.reshape(len(poses), -1) > 0).any(axis=1)
    assert several.sum() > len(poses) // 3
    assert (np.linalg.norm(rows["force_N"][several], axis=1) > 0).all()


def check_same(name: str, options: ReplayOptions, poses: np.ndarray, *skips: int) -> None:
    """Each of `skips` (that of the options) answers like a run that skips nothing."""
    of = pair(name)
    options = replace(options, lookups_max=WHOLE)
    expected = run(of.scene, poses, replace(options, skip=0))
    assert not expected["late_ticks"].any()
    for skip in skips or (options.skip,):
        found = run(of.scene, poses, replace(options, skip=skip))
        for column in ANSWERS:
            assert expected[column].tobytes() == found[column].tobytes(), column


@pytest.mark.parametrize("skip", range(1, SKIPS["all"] + 1))
@pytest.mark.parametrize("name", SCENES)
def test_skipping_changes_no_bit_at_random_poses(name: str, skip: int) -> None:
    poses = poses_near(np.random.default_rng(skip), pair(name), 400, 4e-3, 4e-3)
    check_same(name, ReplayOptions(skip=skip), poses)
    check_same(name, ReplayOptions(skip=skip, response="extent", coverage="hard"), poses[:100])
    check_same(name, ReplayOptions(skip=skip, response="extent"), poses[:100])
    check_same(name, ReplayOptions(skip=skip, response="fixed45"), poses[:100])


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_skipping_changes_no_bit_on_walks(name: str) -> None:
    for seed, step_m in ((1, 1e-3), (2, 1e-4), (3, 1e-6)):
        poses = walk(np.random.default_rng(seed), pair(name), 2000, step_m)
        check_same(name, ReplayOptions(), poses, SKIPS["coherence"], SKIPS["all"])


@pytest.mark.parametrize("name", SCENES)
def test_coherence_saves_looks_on_a_slow_walk(name: str) -> None:
    """Not a bit of difference, but a lot less work."""
    of = pair(name)
    poses = walk(np.random.default_rng(4), of, 1000, 1e-6)
    poses = poses[0] + (poses - poses[0]) * 0.01
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    looks = {
        skip: int(run(of.scene, poses, ReplayOptions(skip=SKIPS[skip]))["nodes"].sum())
        for skip in ("tree", "all")
    }
    assert looks["all"] < 0.8 * looks["tree"]
