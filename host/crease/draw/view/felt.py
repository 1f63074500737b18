"""What a hand notices in a table of ticks: the stiffness that it feels, jumps, and the force of each contact area."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.base.native import COVERAGES, RESPONSES
from crease.base.scene import Scene
from crease.draw.plot import forces_N
from crease.replay.contacts import Areas, find_areas, find_held, tool_samples_m
from crease.replay.measures import angle_deg, motion_m
from crease.replay.replay import DEFAULT_RESPONSE, ReplayOptions, couple_options_of, run_path
from crease.replay.trajectory import Trajectory

F64 = npt.NDArray[np.float64]
Table = Mapping[str, npt.NDArray[Any]]

JUMP = 4.0
"""A jump: the force changes by more than this many times what a wall of the same stiffness would change it."""
JUMP_SHARE = 0.02
"""And by more than this share of the largest force: entries and exits of a shallow contact are no jumps."""
JUMP_TICKS = 5
"""Jumps nearer than this to each other are one."""
DEEP_M = 1e-5
_CHUNK = 1 << 16
_SAME_DEG = 1e-2


def stiffness_N_m(table: Table) -> float:
    """Stiffness that a table was replayed with, from its ticks of one area: there |F| = k depth. 0 without contact.

    The median: damping and the limit of the force reach some ticks only.
    """
    depth_m = np.asarray(table["depth_m"], np.float64)
    alone = (np.asarray(table["areas"]) == 1) & (depth_m > DEEP_M)
    alone = alone if alone.any() else depth_m > DEEP_M
    size_N = np.linalg.norm(forces_N(table), axis=1)
    return float(np.median(size_N[alone] / depth_m[alone])) if alone.any() else 0.0


def moved_m(scene: Scene, path: Trajectory) -> F64:
    """Largest displacement of any corner of the box round the tool's samples from tick to tick, (n - 1,)."""
    samples = tool_samples_m(scene)
    low, high = samples.min(axis=0), samples.max(axis=0)
    corners = np.array([[(low, high)[i >> k & 1][k] for k in range(3)] for i in range(8)])
    parts = [
        motion_m(
            path.position_m[at : at + _CHUNK + 1], path.rows[at : at + _CHUNK + 1, 4:], corners
        )
        for at in range(0, max(len(path) - 1, 1), _CHUNK)
    ]
    return np.concatenate(parts)


def amplifications(force_N: F64, stiffness: float, moved: F64) -> F64:
    """|dF| / (k |dx|) of every tick, (n,): the stiffness that the loop sees, as a share of k. 0 where nothing moves."""
    step_N = np.linalg.norm(np.diff(force_N, axis=0), axis=1)
    out = np.zeros(len(force_N))
    moving = (moved > 1e-9) & (stiffness > 0.0)
    out[1:][moving] = step_N[moving] / (stiffness * moved[moving])
    return out


def jumps(force_N: F64, amplification: F64) -> npt.NDArray[np.int64]:
    """Ticks at which the force jumps, in order; of several in a row the largest."""
    step_N = np.linalg.norm(np.diff(force_N, axis=0, prepend=force_N[:1]), axis=1)
    floor_N = JUMP_SHARE * float(np.linalg.norm(force_N, axis=1).max(initial=0.0))
    found = np.flatnonzero((amplification > JUMP) & (step_N > floor_N))
    parts = np.split(found, np.flatnonzero(np.diff(found) > JUMP_TICKS) + 1)
    return np.array([p[np.argmax(step_N[p])] for p in parts if len(p)], np.int64)


@dataclass(frozen=True)
class Answered:
    """Who answered a table: response and coverage, and how many ticks count something else when they run again."""

    options: ReplayOptions
    differ: int


ANSWERS = tuple(
    ReplayOptions(response=response, coverage=coverage)
    for coverage in COVERAGES
    for response in RESPONSES
    if (response, coverage) != (DEFAULT_RESPONSE, "hard")
)
"""Every response in every coverage that it has, the library's own first."""


def who_answered(scene: Scene, path: Trajectory, table: Table) -> Answered:
    """The response that gives a table's counts of areas, zones and samples, and its directions; else the nearest.

    The path runs again with one after the other. Stiffness, damping and limits are not in a table, so lengths of
    forces are not compared. A held tool's table has its settings: nothing is tried.
    Errors: SceneError.   Cost: that of the ticks; all responses when none fits.
    """
    held = couple_options_of(table)
    if held is not None:
        return Answered(held, int(_counted_else(run_path(scene, path, held), table).sum()))
    force_N = forces_N(table)
    best, least = Answered(ReplayOptions(), len(path)), (len(path) + 1, np.inf)
    for options in ANSWERS:
        rows = run_path(scene, path, options)
        differ = _counted_else(rows, table)
        found_N = rows["force_N"].astype(np.float64)
        off = float(angle_deg(found_N, force_N).mean())
        off += 180.0 * float(((found_N != 0).any(axis=1) != (force_N != 0).any(axis=1)).mean())
        if (int(differ.sum()), off) < least:
            least = (int(differ.sum()), off)
            best = Answered(options, int(differ.sum()))
        if not differ.any() and off < _SAME_DEG:
            break
    return best


def _counted_else(rows: npt.NDArray[Any], table: Table) -> npt.NDArray[np.bool_]:
    """Ticks whose areas, zones or samples a table counts otherwise than a run, (n,)."""
    differ = np.zeros(len(rows), np.bool_)
    for name in ("areas", "zones", "contacts"):
        differ |= rows[name] != table[name]
    return differ


def areas_of(scene: Scene, path: Trajectory, options: ReplayOptions, table: Table) -> Areas:
    """The contact areas of a table that `options` answered, each with its share of the table's force.

    Forces are scaled tick by tick to the table's. Of a held tool: the points that press, as they are.
    Errors: SceneError.
    """
    if options.couple is not None:
        return find_held(scene, path, options)[1]
    areas = find_areas(scene, path, options)
    size_N = np.linalg.norm(_sums(areas), axis=1)
    scale = np.linalg.norm(forces_N(table), axis=1) / np.where(size_N > 0.0, size_N, 1.0)
    areas.areas["force_N"] *= np.repeat(scale, areas.counts)[:, None].astype(np.float32)
    return areas


def _sums(areas: Areas) -> F64:
    """Force of every tick, (n, 3)."""
    out = np.zeros((len(areas.counts), 3))
    np.add.at(out, np.repeat(np.arange(len(out)), areas.counts), areas.areas["force_N"])
    return out


def start_s(tables: list[Table], found: list[npt.NDArray[np.int64]]) -> float:
    """Where a page opens, s from the start: at the jump after which the replays differ most, else where they differ
    most, else amid the contact.

    Shapes: found: jumps of each table. Replays of different times are not compared: then the largest jump.
    """
    times = [np.asarray(table["t_s"], np.float64) - float(table["t_s"][0]) for table in tables]
    forces = [forces_N(table) for table in tables]
    apart = np.zeros(len(times[0]))
    if all(np.array_equal(t, times[0]) for t in times):
        apart = np.max([np.linalg.norm(f - forces[0], axis=1) for f in forces], axis=0)
    scored = [
        (float(apart[i]) if apart.any() else float(np.linalg.norm(f[i] - f[i - 1])), float(t[i]))
        for t, f, at in zip(times, forces, found, strict=True)
        for i in at.tolist()
    ]
    if scored:
        return max(scored)[1]
    largest_N = max(float(np.abs(f).max(initial=0.0)) for f in forces)
    if apart.max(initial=0.0) > JUMP_SHARE * largest_N:
        return float(times[0][np.argmax(apart)])
    touching = np.flatnonzero(np.asarray(tables[0]["areas"]) > 0)
    return float(times[0][touching[len(touching) // 2]]) if len(touching) else 0.0
