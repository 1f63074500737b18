"""How stiff a face may be that a tool is knocked flat against: felt at 10 kHz over a search at 1 kHz, and of one pad
or four.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from crease.base.native import RESPONSES, lib_of
from crease.base.scene import Scene, open_scene
from crease.replay.replay import ReplayOptions, World
from crease.replay.trajectory import load_trajectory
from test_late_pads import path, scene_of

ROOT = Path(__file__).resolve().parents[2]
MASS_kg, DAMPING_Ns_m, HAND_N_m, PULL_m = 0.8, 9.0, 300.0, 0.02
"""A normal hand and what it holds; where it wants to be, beyond the face."""
STEP_s, SECONDS, SPEED_m_s = 20e-6, 0.6, 0.05
ROW, LIFT_m = 300, 0.0033
"""Of the path of `edge90_cube`: the cube flat on the block, half of it beyond the edge; lifted until it touches."""
WHOLE = 1 << 20


@dataclass(frozen=True)
class Knock:
    """A tool that a hand knocks against a face: where it touches, what answers, and how often."""

    scene: Scene
    pose: npt.NDArray[np.float64]
    """(7,): m, and a unit quaternion, scalar first; up is along z."""
    feel_s: float = 1e-3
    search_every: int = 1
    """Feels."""
    response: str = "way_out"

    def motion(self, stiffness_N_m: float) -> Iterator[float]:
        """Heights over where it touches, m."""
        options = ReplayOptions(
            stiffness_N_m=stiffness_N_m, force_max_N=1e4, response=self.response
        )
        world = World(self.scene, options)
        made = lib_of(RESPONSES[self.response])
        out, at = made.ffi.new("cr_output *"), made.ffi.new("cr_pose *")
        x, y, z, *at.rot = self.pose.tolist()
        up_m, speed_m_s, force_N, feels = 0.0, SPEED_m_s, 0.0, 0
        every = round(self.feel_s / STEP_s)
        for step in range(round(SECONDS / STEP_s)):
            if step % every == 0:
                at.pos_m = (x, y, z + up_m)
                made.lib.cr_feel(world.handle, at, self.feel_s, out)
                while (
                    feels % self.search_every == 0 and made.lib.cr_search(world.handle, WHOLE) > 0
                ):
                    pass
                force_N = float(out.force_world_N.z)
                feels += 1
            pushed_N = force_N - HAND_N_m * (up_m + PULL_m) - DAMPING_Ns_m * speed_m_s
            speed_m_s += pushed_N / MASS_kg * STEP_s
            up_m += speed_m_s * STEP_s
            yield up_m

    def settles(self, stiffness_N_m: float) -> bool:
        """Whether the last quarter of the motion is smaller than the second."""
        up_m = np.fromiter(self.motion(stiffness_N_m), dtype=np.float64)
        _, second, _, last = np.array_split(up_m, 4)
        return bool(np.ptp(last) < 0.9 * np.ptp(second))

    def stiffest_N_m(self) -> float:
        """By bisection, within 2 %."""
        low, high = 500.0, 1e6
        while high > 1.02 * low:
            middle = float(np.sqrt(low * high))
            low, high = (middle, high) if self.settles(middle) else (low, middle)
        return low


def test_feel_at_10_kHz_over_a_search_at_1_kHz_settles_eight_times_the_stiffness() -> None:
    """A sampled spring gives as much as a damper b takes at 2 b / T: T is that of the feel, not of the search."""
    scene = open_scene(ROOT / "build" / "scenes" / "edge90_cube.crs")
    pose = load_trajectory(ROOT / "build" / "meshes" / "edge90_cube.csv").rows[ROW, 1:].copy()
    pose[2] += LIFT_m
    slow, fast = Knock(scene, pose).stiffest_N_m(), Knock(scene, pose, 1e-4, 10).stiffest_N_m()
    print(f"settles: {slow:,.0f} N/m at 1 kHz, {fast:,.0f} at 10 kHz over a search at 1 kHz")
    assert abs(slow / (2.0 * DAMPING_Ns_m / 1e-3) - 1.0) < 0.1
    assert fast > 8.0 * slow
    assert fast < 2.0 * DAMPING_Ns_m / 1e-4


def stiffest_on_pads_N_m(pads: str, response: str) -> float:
    """Of a plate that is knocked flat against the tops of so many pads."""
    touches = path(np.array([0.5]), np.array([0.0])).rows[0, 1:]
    return Knock(scene_of(pads), touches, response=response).stiffest_N_m()


@pytest.mark.parametrize("pads", ["two rims", "four pads"])
def test_what_settles_does_not_depend_on_the_number_of_pads(pads: str) -> None:
    """The extent, which pushes with each of them, settles at a half and a quarter: the check can fail."""
    one, more = stiffest_on_pads_N_m("one pad", "way_out"), stiffest_on_pads_N_m(pads, "way_out")
    print(f"settles on one pad: {one:,.0f} N/m; {pads}: {more:,.0f}")
    assert abs(one / (2.0 * DAMPING_Ns_m / 1e-3) - 1.0) < 0.1
    assert abs(more / one - 1.0) < 0.05
    assert stiffest_on_pads_N_m(pads, "extent") < 0.6 * one
