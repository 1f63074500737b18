"""The closed loop as a measuring instrument: scene, device, hand and response in, arrays out.

A run is a `Loop` of hil.py: the same inputs give the same arrays to the bit.

    setup = Setup(stiffness_N_m=2000, response="fixed45", hand=LIGHT_GRIP)
    run = drag(scene, setup, path)              # the hand leads the tool along a path
    k = largest_stiffness(lambda k: holds(scene, replace(setup, stiffness_N_m=k), place))
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.signal import butter, sosfilt
from scipy.spatial.transform import Rotation

from crease.base.arguments import check_number
from crease.base.errors import LoopError
from crease.base.native import RESPONSES, ffi, lib
from crease.base.scene import Scene
from crease.bus.drives import Params
from crease.loop.handle import HandleSetup
from crease.loop.hil import (
    PERIOD_NS,
    Loop,
    LoopResult,
    hand_targets,
    lead_in,
    resample,
)
from crease.replay.replay import DEFAULT_RESPONSE
from crease.replay.trajectory import Trajectory, check_rows

F64 = npt.NDArray[np.float64]
Quaternion = tuple[float, float, float, float]
"""Of unit length, scalar first."""

PERIOD_S = 1e-9 * PERIOD_NS
LEAD_TICKS, SETTLE_TICKS = 2000, 1500
"""The hand swings on the guide's mass at 1 Hz: a quick lead would still be felt when the path begins."""


_HAND = (("mass_kg", 100.0, "kg"), ("damping_Ns_m", 1e4, "N s/m"), ("stiffness_N_m", 1e6, "N/m"))
"""What the simulator takes for an operator (sim/mech.c): from 0 to this."""


@dataclass(frozen=True)
class Hand:
    """The operator: a mass on spring and damper that follows its target through a low-pass of 10 Hz.

    mass_kg: 0 to 100; 0: nobody holds the tool. damping_Ns_m: 0 to 1e4. stiffness_N_m: 0 to 1e6.
    Errors   LoopError naming the field that is out of range.
    """

    mass_kg: float
    damping_Ns_m: float
    stiffness_N_m: float

    def __post_init__(self) -> None:
        for name, high, unit in _HAND:
            check_number(f"hand: {name}", getattr(self, name), 0.0, high, unit, LoopError)


NORMAL_GRIP = Hand(0.8, 5.5, 300.0)
FIRM_GRIP = Hand(1.5, 25.0, 500.0)
LIGHT_GRIP = Hand(0.4, 3.0, 50.0)
"""The hardest: it adds the least damping."""


@dataclass(frozen=True)
class Setup:
    """What a run may change. None, or empty: as the firmware and the simulator have it.

    delay_s: from the sample to the torque's action. None: the bus as it is, one period; 0: no time at all.
    dry_friction: False takes Coulomb friction out of the mechanism, and its compensation out of the firmware.
    search_work: lookups of the search for contact beside each tick; 0: the tick searches itself.
    control, params: fields of cr_control_config and cr_sim_params by name. axes: fields of cr_sim_axis by axis; the
    firmware is told of another step_m. base_from_world: how the device stands turned. handle: of six axes, with a held
    tool, whose stiffness then counts.
    """

    stiffness_N_m: float = 1000.0
    response: str = DEFAULT_RESPONSE
    hand: Hand = NORMAL_GRIP
    delay_s: float | None = None
    damping_Ns_m: float | None = None
    dry_friction: bool = True
    control: Mapping[str, float] = field(default_factory=dict)
    params: Mapping[str, Any] = field(default_factory=dict)
    axes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    base_from_world: Quaternion = (1.0, 0.0, 0.0, 0.0)
    search_work: int = 0
    handle: HandleSetup | None = None


def _turned_base(config: Any, base_from_world: Sequence[float]) -> None:
    """Turn the device about the point where its tip rests; the tool, on its last axis, stays as it stands."""
    place, tool = config.arm.world_from_base, config.arm.tip_from_tool.rot
    (tool.w, tool.x, tool.y, tool.z) = base_from_world
    inverse = Rotation.from_quat(base_from_world, scalar_first=True).inv()
    at = [place.pos_m.x, place.pos_m.y, place.pos_m.z]
    (place.pos_m.x, place.pos_m.y, place.pos_m.z) = inverse.apply(at).tolist()
    (place.rot.w, place.rot.x, place.rot.y, place.rot.z) = inverse.as_quat(
        scalar_first=True
    ).tolist()


def servo_config(setup: Setup) -> Any:
    """A cffi `cr_servo_config *`.   Errors: LoopError for an unknown name; the servo refuses values out of range."""
    config = ffi.new("cr_servo_config *", lib.cr_servo_config_default())
    if setup.response not in RESPONSES:
        raise LoopError(f"response '{setup.response}' is not known; use {' or '.join(RESPONSES)}")
    config.world.stiffness_N_m = setup.stiffness_N_m
    config.world.response = RESPONSES[setup.response]
    if setup.damping_Ns_m is not None:
        config.control.contact_damping_Ns_m = setup.damping_Ns_m
    if not setup.dry_friction:
        config.control.friction_share = 0.0
    for name, value in setup.control.items():
        if name not in dir(config.control):
            raise LoopError(
                f"control field '{name}' is not known; see cr_control_config in servo.h"
            )
        setattr(config.control, name, value)
    for axis, changes in setup.axes.items():
        if "step_m" in changes:
            arm_m = (1.0, config.arm.upper_m, config.arm.fore_m)["XYZ".index(axis)]
            config.axis["XYZ".index(axis)].step = changes["step_m"] / arm_m
            config.bus.rest_ticks = 0  # rest is counted in steps: with fine ones a hand never rests
    config.late_max_ticks = lib.CR_LATE_MAX if setup.search_work else 0
    _turned_base(config, setup.base_from_world)
    return config


def sim_params(setup: Setup) -> Params:
    """Parameters of device and hand.   Errors: BusError for an unknown name."""
    values = {
        "hand_mass_kg": setup.hand.mass_kg,
        "hand_damping_Ns_m": setup.hand.damping_Ns_m,
        "hand_stiffness_N_m": setup.hand.stiffness_N_m,
        "torque_delay_s": setup.delay_s or 0.0,
    }
    axes = {axis: dict(changes) for axis, changes in setup.axes.items()}
    if not setup.dry_friction:
        for axis in "XYZ":
            axes.setdefault(axis, {})["coulomb_N"] = 0.0
    return Params(axes=axes, **(values | dict(setup.params)))


def open_loop(scene: Scene, setup: Setup) -> Loop:
    """Both ends at power-on.   Errors: CreaseError for a set-up that is refused."""
    at_once = setup.delay_s is not None
    return Loop(
        scene,
        servo_config(setup),
        sim_params(setup),
        at_once=at_once,
        search_work=setup.search_work,
        handle=setup.handle,
    )


def bring_up(loop: Loop, targets: F64) -> None:
    """From power-on to rendering in the next tick, the hand at the first target and at rest.   Errors: LoopError."""
    loop.bring_up(lead_in(targets, loop.drives.state.tip_pos_m, LEAD_TICKS, SETTLE_TICKS))
    loop.command(int(lib.CR_COMMAND_START))


def drag(scene: Scene, setup: Setup, path: Trajectory) -> LoopResult:
    """The hand leads the tool along a path of the tool's pose in the world; path_start is the path's first tick."""
    loop = open_loop(scene, setup)
    targets = hand_targets(resample(path), loop.config)
    bring_up(loop, targets)
    start = loop.ticks
    loop.run(targets)
    return loop.result(start)


def at_speed(path: Trajectory, factor: float, ease_s: float = 0.3) -> Trajectory:
    """The same way at `factor` of its speed, with a smooth start and end over ease_s: no hand starts within a tick."""
    length_s = (path.t_s[-1] - path.t_s[0]) / factor + ease_s
    t_s = np.arange(round(length_s / PERIOD_S) + 1) * PERIOD_S
    ends = np.clip(np.minimum(t_s, length_s - t_s) / ease_s, 0.0, 1.0)
    share = np.cumsum(ends * ends * (3.0 - 2.0 * ends))
    at_s = path.t_s[0] + (path.t_s[-1] - path.t_s[0]) * share / share[-1]
    columns = [np.interp(at_s, path.t_s, path.rows[:, i]) for i in range(1, 8)]
    return check_rows(np.column_stack([t_s, *columns]), path.source)


@dataclass(frozen=True)
class Place:
    """Where a hand presses the tool against the mock-up, frame of the world.

    touch_m: tool origin where the tool just touches. normal: outwards, the mean of the faces that meet there; the Z of
    the tool is turned along it. across: the way along which the force turns; along it the hand holds off the symmetric
    point and is knocked.
    """

    name: str
    touch_m: tuple[float, float, float]
    normal: tuple[float, float, float]
    across: tuple[float, float, float]


APPROACH_TICKS, REST_TICKS, WATCH_TICKS, PART_TICKS = 2500, 1500, 2500, 500
ASIDE_M = 1e-3
KNOCK_NS = 0.02
"""1 cm/s of the arm and light hand: well above a count, small enough to stay in contact."""
STILL_M_S = 0.5e-3
CALMER = 0.75
"""A loop settles when in the last 0.5 s it is still, or moves less than this share of what it did in the first after
the knock. At the bound the motion neither grows nor falls."""
SWING_HZ = 3.0
"""Above the hand's own swing, below the contact's (5 Hz at 1500 N/m and 1.6 kg)."""


def hold(scene: Scene, setup: Setup, place: Place, press_N: float) -> LoopResult:
    """Press the tool against a place, a little aside, wait, knock, and watch; path_start is the tick of the knock.

    Cost: 10 s of the device, about 0.6 s.   Errors: LoopError as bring_up.
    """
    loop = open_loop(scene, setup)
    normal, across = (np.asarray(v) / np.linalg.norm(v) for v in (place.normal, place.across))
    sink_m = press_N / setup.stiffness_N_m + press_N / setup.hand.stiffness_N_m
    near = np.asarray(place.touch_m) + 5e-3 * normal
    deep = np.asarray(place.touch_m) - sink_m * normal + ASIDE_M * across
    share = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, APPROACH_TICKS))
    way = near + share[:, None] * (deep - near)
    targets = hand_targets(straight(way, turn_between((0.0, 0.0, 1.0), normal)), loop.config)
    bring_up(loop, targets)
    loop.run(targets)
    loop.run(np.repeat(targets[-1:], REST_TICKS, axis=0))
    start = loop.ticks
    turn = Rotation.from_quat(setup.base_from_world, scalar_first=True)
    loop.bump(KNOCK_NS * turn.apply(across - normal) / np.sqrt(2.0))
    loop.run(np.repeat(targets[-1:], WATCH_TICKS, axis=0))
    return loop.result(start)


def turn_between(before: npt.ArrayLike, after: npt.ArrayLike) -> Quaternion:
    """Shortest rotation of one direction into another that is not opposite; unit quaternion, scalar first."""
    a, b = (np.asarray(v, dtype=np.float64) / np.linalg.norm(v) for v in (before, after))
    quaternion = np.r_[1.0 + a @ b, np.cross(a, b)]
    w, x, y, z = (quaternion / np.linalg.norm(quaternion)).tolist()
    return (w, x, y, z)


def straight(position_m: F64, quaternion: Quaternion) -> Trajectory:
    """Positions at one a period, all in one attitude."""
    turned = np.tile(quaternion, (len(position_m), 1))
    return check_rows(
        np.column_stack([np.arange(len(position_m)) * PERIOD_S, position_m, turned]), "hold"
    )


def restlessness_m_s(result: LoopResult) -> tuple[float, float]:
    """RMS speed of the tip above the hand's own swing, in the first and the last 0.5 s after the knock."""
    sos = butter(4, SWING_HZ, "highpass", fs=1.0 / PERIOD_S, output="sos")
    fast = sosfilt(sos, result.mechanism["tip_vel_m_s"], axis=0)[result.path_start :]
    first, last = fast[:PART_TICKS], fast[-PART_TICKS:]
    return tuple(float(np.sqrt((part**2).sum(axis=1).mean())) for part in (first, last))  # type: ignore[return-value]


def settles(result: LoopResult) -> bool:
    """In contact at the end, without a fault, and at rest or on the way to it."""
    late = result.recording.rows[-PART_TICKS:]
    first, last = restlessness_m_s(result)
    in_contact = bool((late["areas"] > 0).all())
    return in_contact and not late["faults"].any() and last < max(STILL_M_S, CALMER * first)


def largest_stiffness(
    is_stable: Callable[[float], bool], low: float, high: float, ratio: float = 1.05
) -> float:
    """Largest stiffness, N/m, to within `ratio`, by bisection of the logarithm. 0: not even `low`; inf: even `high`."""
    if not is_stable(low):
        return 0.0
    if is_stable(high):
        return float("inf")
    while high / low > ratio:
        middle = float(np.sqrt(low * high))
        if is_stable(middle):
            low = middle
        else:
            high = middle
    return float(np.sqrt(low * high))


def stable_stiffness_N_m(
    scene: Scene, setup: Setup, place: Place, press_N: float, low: float = 200.0, high: float = 2e4
) -> float:
    """Largest stiffness at which the tool, pressed against a place and knocked, comes to rest. N/m; see
    largest_stiffness for what is returned outside low..high.   Cost: up to 10 runs of hold.
    """

    def is_stable(stiffness_N_m: float) -> bool:
        return settles(hold(scene, replace(setup, stiffness_N_m=stiffness_N_m), place, press_N))

    return largest_stiffness(is_stable, low, high)


def bound_N_m(setup: Setup, normal: Sequence[float]) -> float:
    """K = (b + B) / (T/2 + td) [6] along a direction of the device.

    b along a direction is that of a light spring on axes of unequal mass: sum(n^2 b / m^2) / sum(n^2 / m)^2, which is
    the axis' own on an axis. td: declared delay (or one period of the bus) and the amplifier's time constant.
    """
    params = sim_params(setup)
    mass = np.array([axis.mass_kg for axis in params.axes]) + setup.hand.mass_kg
    viscous = np.array([axis.viscous_Ns_m for axis in params.axes]) + setup.hand.damping_Ns_m
    viscous += servo_config(setup).control.free_damping_Ns_m
    square = np.square(np.asarray(normal) / np.linalg.norm(normal))
    along = (square * viscous / mass**2).sum() / (square / mass).sum() ** 2
    along += servo_config(setup).control.contact_damping_Ns_m
    delay_s = PERIOD_S if setup.delay_s is None else setup.delay_s
    lag_s = 1.0 / (2.0 * np.pi * params.amplifier_Hz) if params.amplifier_Hz > 0 else 0.0
    return float(along / (0.5 * PERIOD_S + delay_s + lag_s))
