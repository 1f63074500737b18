"""The handle of six axes as a measuring instrument: the largest springs of the coupling that a loop holds still.

The tool stands on feet (places.feet_scene), is pressed, knocked, and watched: along, or about the wrist's axes. Without
dry friction, and without the controller unless told, so that the figures are comparable with theory.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.signal import butter, sosfilt

from crease.base.scene import Scene
from crease.bus.drives import WristParams
from crease.loop.handle import HandleSetup
from crease.loop.hil import LoopResult, hand_targets
from crease.loop.loop import (
    APPROACH_TICKS,
    CALMER,
    KNOCK_NS,
    NORMAL_GRIP,
    PART_TICKS,
    PERIOD_S,
    REST_TICKS,
    STILL_M_S,
    SWING_HZ,
    WATCH_TICKS,
    Hand,
    Setup,
    bound_N_m,
    bring_up,
    largest_stiffness,
    open_loop,
    straight,
)
from crease.replay.replay import CoupleOptions

F64 = npt.NDArray[np.float64]

UP = (0.0, 0.0, 1.0)
PRESS_N = 5.0
"""A knock about the wrist's axes must lift no foot."""
TURN_KNOCK_NMS = 2e-4
STILL_RAD_S = 5e-3
STIFFNESS_N_M, STIFFNESS_NM_RAD = 1000.0, 5.0
"""Of the spring that is not asked about."""


def held_setup(
    hand: Hand = NORMAL_GRIP, delay_s: float | None = None, controller: bool = False
) -> Setup:
    """Device, hand and handle without dry friction.   delay_s: as of Setup; None: the bus, one period."""
    wrist = WristParams(coulomb_Nm=[0.0] * 3)
    passivity = {} if controller else {"damping_max_Ns_m": 0.0}
    handle = HandleSetup(STIFFNESS_N_M, 0.0, CoupleOptions(STIFFNESS_NM_RAD), wrist, passivity)
    return Setup(hand=hand, delay_s=delay_s, dry_friction=False, handle=handle)


def hold_held(scene: Scene, setup: Setup, knock_Ns: float, knock_Nms: float) -> LoopResult:
    """Press the feet on the block, wait, knock down and about roll and pitch, and watch; path_start: the knock's tick.

    Cost: 10 s of the device, 4 s; 8 s with 24 feet.   Errors: LoopError as bring_up.
    """
    loop = open_loop(scene, setup)
    assert setup.handle is not None
    assert loop.handle is not None
    normal = np.array(UP)
    sink_m = PRESS_N / setup.handle.stiffness_N_m + PRESS_N / setup.hand.stiffness_N_m
    share = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, APPROACH_TICKS))
    way = (5e-3 - share * (5e-3 + sink_m))[:, None] * normal
    targets = hand_targets(straight(way, (1.0, 0.0, 0.0, 0.0)), loop.config)
    bring_up(loop, targets)
    loop.run(targets)
    loop.run(np.repeat(targets[-1:], REST_TICKS, axis=0))
    start = loop.ticks
    loop.bump(-knock_Ns * normal)
    loop.handle.bump(knock_Nms * np.array([0.0, 1.0, 1.0]))
    loop.run(np.repeat(targets[-1:], WATCH_TICKS, axis=0))
    return loop.result(start)


def restless(rows: F64, start: int) -> tuple[float, float]:
    """RMS of speeds (n, 3) above the hand's own swing, in the first and the last 0.5 s from `start` on."""
    sos = butter(4, SWING_HZ, "highpass", fs=1.0 / PERIOD_S, output="sos")
    fast = sosfilt(sos, rows, axis=0)[start:]
    first, last = (
        float(np.sqrt((part**2).sum(axis=1).mean()))
        for part in (fast[:PART_TICKS], fast[-PART_TICKS:])
    )
    return first, last


def settles_held(result: LoopResult) -> bool:
    """In contact at the end, without a fault, and at rest or on the way to it: along and about."""
    late = result.handle[-PART_TICKS:]
    if not (late["pressing"] > 0).all() or late["faults"].any() or late["left_out"].any():
        return False
    along = restless(result.mechanism["tip_vel_m_s"], result.path_start)
    about = restless(result.handle["wrist_rad_s"].astype(np.float64), result.path_start)
    return all(
        last < max(still, CALMER * first)
        for (first, last), still in ((along, STILL_M_S), (about, STILL_RAD_S))
    )


def points_pressing(result: LoopResult) -> float:
    """Points that press, on average over the last 0.5 s."""
    return float(result.handle["pressing"][-PART_TICKS:].mean())


def stable_along_N_m(scene: Scene, setup: Setup, low: float, high: float, ratio: float) -> float:
    """Largest k_t at which the pressed tool, knocked along, comes to rest; as of largest_stiffness."""

    def is_stable(stiffness_N_m: float) -> bool:
        assert setup.handle is not None
        handle = setup.handle.stiffer(stiffness_N_m, STIFFNESS_NM_RAD)
        return settles_held(hold_held(scene, replace(setup, handle=handle), KNOCK_NS, 0.0))

    return largest_stiffness(is_stable, low, high, ratio)


def stable_about_Nm_rad(scene: Scene, setup: Setup, low: float, high: float, ratio: float) -> float:
    """Largest k_r at which the pressed tool, knocked about roll and pitch, comes to rest; as of largest_stiffness."""

    def is_stable(stiffness_Nm_rad: float) -> bool:
        assert setup.handle is not None
        handle = setup.handle.stiffer(STIFFNESS_N_M, stiffness_Nm_rad)
        return settles_held(hold_held(scene, replace(setup, handle=handle), 0.0, TURN_KNOCK_NMS))

    return largest_stiffness(is_stable, low, high, ratio)


def bound_along_N_m(setup: Setup) -> float:
    """K = (b + B) / (T/2 + td) down on the block."""
    return bound_N_m(setup, UP)


def bound_about_Nm_rad(setup: Setup) -> float:
    """The same about an axis of the wrist, whose motors have no lag."""
    assert setup.handle is not None
    wrist = setup.handle.wrist.c
    delay_s = PERIOD_S if setup.delay_s is None else setup.delay_s
    damping = min(wrist.viscous_Nms_rad) + wrist.hand_damping_Nms_rad
    return float(damping / (0.5 * PERIOD_S + delay_s))
