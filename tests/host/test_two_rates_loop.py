"""What feeling at 10 kHz over a search at 1 kHz is for: a stiffer wall that does not buzz."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from crease.base.native import ffi, lib
from crease.base.scene import Scene, open_scene
from crease.replay.replay import ReplayOptions, World
from crease.replay.trajectory import load_trajectory

ROOT = Path(__file__).resolve().parents[2]
MASS_kg, DAMPING_Ns_m, HAND_N_m, PULL_m = 0.8, 9.0, 300.0, 0.02
"""A normal hand and what it holds; where it wants to be, beyond the face."""
STEP_s, SECONDS, SPEED_m_s = 20e-6, 0.6, 0.05
ROW, LIFT_m = 300, 0.0033
"""Of the path of `edge90_cube`: the cube flat on the block, half of it beyond the edge; lifted until it touches."""
WHOLE = 1 << 20


def motion(scene: Scene, stiffness_N_m: float, feel_s: float, search_every: int) -> Iterator[float]:
    """Heights of a tool that a hand knocks against the face: felt every feel_s, searched for at every so many feels."""
    world = World(scene, ReplayOptions(stiffness_N_m=stiffness_N_m, force_max_N=1e4))
    pose = load_trajectory(ROOT / "build" / "meshes" / "edge90_cube.csv").rows[ROW, 1:]
    out, at = ffi.new("cr_output *"), ffi.new("cr_pose *")
    x, y, z, *at.rot = pose.tolist()
    up_m, speed_m_s, force_N, feels = 0.0, SPEED_m_s, 0.0, 0
    every = round(feel_s / STEP_s)
    for step in range(round(SECONDS / STEP_s)):
        if step % every == 0:
            at.pos_m = (x, y, z + LIFT_m + up_m)
            lib.cr_feel(world.handle, at, feel_s, out)
            while feels % search_every == 0 and lib.cr_search(world.handle, WHOLE) > 0:
                pass
            force_N = float(out.force_world_N.z)
            feels += 1
        pushed_N = force_N - HAND_N_m * (up_m + PULL_m) - DAMPING_Ns_m * speed_m_s
        speed_m_s += pushed_N / MASS_kg * STEP_s
        up_m += speed_m_s * STEP_s
        yield up_m


def settles(scene: Scene, stiffness_N_m: float, feel_s: float, search_every: int) -> bool:
    """Whether the last quarter of the motion is smaller than the second."""
    up_m = np.fromiter(motion(scene, stiffness_N_m, feel_s, search_every), dtype=np.float64)
    _, second, _, last = np.array_split(up_m, 4)
    return bool(np.ptp(last) < 0.9 * np.ptp(second))


def stiffest_N_m(scene: Scene, feel_s: float, search_every: int) -> float:
    """By bisection, within 2 %."""
    low, high = 500.0, 1e6
    while high > 1.02 * low:
        middle = float(np.sqrt(low * high))
        low, high = (
            (middle, high) if settles(scene, middle, feel_s, search_every) else (low, middle)
        )
    return low


def test_feel_at_10_kHz_over_a_search_at_1_kHz_settles_eight_times_the_stiffness() -> None:
    """A sampled spring gives as much as a damper b takes at 2 b / T: T is that of the feel, not of the search."""
    scene = open_scene(ROOT / "build" / "scenes" / "edge90_cube.crs")
    slow, fast = stiffest_N_m(scene, 1e-3, 1), stiffest_N_m(scene, 1e-4, 10)
    print(f"settles: {slow:,.0f} N/m at 1 kHz, {fast:,.0f} at 10 kHz over a search at 1 kHz")
    assert abs(slow / (2.0 * DAMPING_Ns_m / 1e-3) - 1.0) < 0.1
    assert fast > 8.0 * slow
    assert fast < 2.0 * DAMPING_Ns_m / 1e-4
