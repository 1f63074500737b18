"""Quaternion drift: a tool that turns in contact for ten million ticks, its attitude integrated in float32."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from crease.base.native import ffi, lib
from crease.base.records import record
from crease.replay.replay import ReplayOptions, World

from stress.cases import touching
from stress.pool import random_pair

ROW = record("cr_drift_row")
"""Of host/native/drift.h."""

TURN_RAD = 1.7e-3
"""A tick's turn: 1.7 rad/s."""

NORM_MAX = 1.01
"""The tick takes quaternions within 1 % of unit length."""

SAME = 1e-3
"""A quaternion that is not quite a unit gives the force of the unit one to this share."""


@dataclass(frozen=True)
class Drift:
    """What a long turn found; `failed` lists what does not hold."""

    unit: bool
    ticks: int
    norm_last: float
    ticks_to_fault: int | None
    compared: int
    in_contact: int
    failed: tuple[str, ...]
    seconds: float


def run_drift(seed: int, ticks: int, unit: bool, samples: int = 1000) -> Drift:
    """Turn the tool `ticks` times and compare `samples` ticks with fresh worlds.

    Truths: the answer of a world that has turned so long is that of a fresh world at the same pose, bit for bit; with
    `unit` there is no fault; without, the fault comes when the norm leaves 1 %, not before, and the force is zero then.
    """
    start_s = time.perf_counter()
    pair, _ = random_pair((seed, 0, 2_000_000))
    rng = np.random.default_rng((seed, 2_000_001))
    pose = touching(rng, pair, 1, -2e-3, -1e-3)[0] * np.array([pair.here.frame.scale] * 3 + [1] * 4)
    axis = rng.normal(size=3)
    axis *= np.sin(TURN_RAD / 2) / np.linalg.norm(axis)
    step = ffi.new("cr_quat *", (np.cos(TURN_RAD / 2), *axis.tolist()))
    at = ffi.new("cr_pose *", {"pos_m": pose[:3].tolist(), "rot": pose[3:].tolist()})
    scene = pair.here.scene
    rows = np.zeros(samples, ROW)
    every = max(1, ticks // samples)
    world = World(scene, ReplayOptions())
    out = ffi.from_buffer("cr_drift_row[]", rows, require_writable=True)
    lib.cr_drift_run(world.handle, at, step[0], int(unit), every, samples, out)
    norm = np.linalg.norm(rows["rot"].astype(np.float64), axis=1)
    faulted = np.flatnonzero(rows["faults"])
    good = rows[: faulted[0]] if len(faulted) else rows
    failed = _compare(scene, pose[:3], good)
    if unit and len(faulted):
        failed.append("a fault though the quaternion was made a unit")
    off = np.flatnonzero(np.abs(norm**2 - 1) > 2 * (NORM_MAX - 1) + 1e-3)
    if len(faulted) and rows["force_N"][faulted[0] :].any():
        failed.append("a force after the fault")
    if len(off) and (not len(faulted) or faulted[0] > off[0]):
        failed.append("no fault though the quaternion is off by more than 1 %")
    return Drift(
        unit,
        every * samples,
        float(norm[-1]),
        int(faulted[0] + 1) * every if len(faulted) else None,
        len(good),
        int(np.count_nonzero(good["depth_m"])),
        tuple(failed),
        round(time.perf_counter() - start_s, 1),
    )


def _compare(scene: object, at: npt.NDArray[np.float64], rows: npt.NDArray[np.void]) -> list[str]:
    """Fresh worlds at the same poses, and at poses made unit in double."""
    failed = []
    world = World(scene, ReplayOptions())  # type: ignore[arg-type]
    for row in rows:
        rot = row["rot"].astype(np.float64)
        world.reset()
        out = world.tick(np.concatenate([at, rot]))
        force = np.array([out.force_world_N.x, out.force_world_N.y, out.force_world_N.z])
        if (force.astype(np.float32) != row["force_N"]).any():
            failed.append("another answer than a fresh world's")
            break
        world.reset()
        out = world.tick(np.concatenate([at, rot / np.linalg.norm(rot)]))
        unit = np.array([out.force_world_N.x, out.force_world_N.y, out.force_world_N.z])
        if np.linalg.norm(force - unit) > SAME * max(float(np.linalg.norm(unit)), 1e-2):
            failed.append("another answer than at the unit quaternion")
            break
    return failed
