"""`crease.Loop`: the closed loop in this process, pose by pose: what `crease hil` and `crease view --live` run."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from crease.base.alone import Alone, alone, stays
from crease.base.arguments import check_number, check_whole
from crease.base.errors import LoopError, TrajectoryError
from crease.base.scene import Scene
from crease.base.table import check_suffix, check_target, write_bytes
from crease.loop import hil
from crease.loop.loop import NORMAL_GRIP, Hand, Setup, bring_up, servo_config, sim_params
from crease.replay.recording import SUFFIX, fault_names, mode_names, recording_bytes
from crease.replay.replay import DEFAULT_RESPONSE
from crease.replay.trajectory import POSE_NUMBERS, Trajectory, check_rows, refuse_file
from crease.replay.world import in_words

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
U32 = npt.NDArray[np.uint32]


@dataclass(frozen=True)
class Felt:
    """What the loop did, one row a tick of 1 ms: views into two arrays."""

    rows: npt.NDArray[Any] = field(repr=False)
    """Structured array (n,), `cr_record` of firmware/servo.h: everything below and more."""
    mechanism: npt.NDArray[Any] = field(repr=False)
    """Structured array (n,), `cr_lockstep_row` of host/native/lockstep.h: the simulated device, frame of its base."""

    def __repr__(self) -> str:
        return f"Felt({in_words(self.rows)})"

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def t_s(self) -> F64:
        """(n,) time since the loop's first tick."""
        return np.asarray(self.rows["sync_ns"].astype(np.float64) * 1e-9)

    @property
    def position_m(self) -> F32:
        """(n, 3) of the tool, world frame: where the hand brought it, against the force."""
        return self._column("position_m")

    @property
    def quaternion(self) -> F32:
        """(n, 4) of the tool, scalar first."""
        return self._column("quaternion")

    @property
    def force_N(self) -> F32:
        """(n, 3) that the device gives to the hand at the tip, world frame, after all limits."""
        return self._column("force_N")

    @property
    def contact_force_N(self) -> F32:
        """(n, 3) of the contact on the tool, world frame."""
        return self._column("contact_force_N")

    @property
    def contact_torque_Nm(self) -> F32:
        """(n, 3) of the contact about the tool origin, N m, world frame."""
        return self._column("contact_torque_Nm")

    @property
    def hand_force_N(self) -> F64:
        """(n, 3) that the simulated hand feels, with the friction of the mechanism, frame of the base."""
        view: F64 = self.mechanism["hand_force_N"]
        return view

    @property
    def depth_m(self) -> F32:
        """(n,) of the deepest contact area; 0 in free space."""
        return self._column("depth_m")

    @property
    def areas(self) -> U32:
        """(n,) contact areas."""
        return self._column("areas")

    @property
    def zones(self) -> U32:
        """(n,) contact zones over all areas."""
        return self._column("zones")

    @property
    def faults(self) -> U32:
        """(n,) bits `CR_SERVO_FAULT_*`; 0: none. The force is zero from the first one on."""
        return self._column("faults")

    @property
    def tick_ns(self) -> U32:
        """(n,) time of the haptic tick as the simulated bus counts it."""
        return self._column("tick_ns")

    def _column(self, name: str) -> npt.NDArray[Any]:
        view: npt.NDArray[Any] = self.rows[name]
        return view


class Loop:
    """Servo of the firmware, bus, drives, mechanism and hand in lock-step: the same poses give the same bits.

    Time is virtual: a tick is 1 ms of the device and takes about 0.07 ms. One thread at a time,
    another gets a CreaseError.
    """

    def __init__(
        self,
        scene: Scene | str | Path,
        *,
        stiffness: float = 1000.0,
        damping: float | None = None,
        response: str = DEFAULT_RESPONSE,
        hand: Hand = NORMAL_GRIP,
        at: npt.ArrayLike | None = None,
        keep: bool = True,
    ) -> None:
        """A device that is switched off; the first pose brings it up.

        scene: baked, opened, or the path of its file. stiffness: N/m, 0 to 1e6. damping: of the contact at the tip,
        N s/m; None: none. response: a key of `crease.RESPONSES`. hand: mass, damping and stiffness of the operator.
        at: (3,) m, world, where the tool's origin is while the device rests; None: as `crease hil` has it, the origin.
        keep: all ticks, for `save`: 0.5 kB each.
        Errors   CreaseError for a setting that is refused.
        Source   firmware/servo/DESIGN.md, sim/DESIGN.md; every number of the device is assumed, none measured.
        """
        self._alone = Alone("loop")
        self.scene: Scene = scene if isinstance(scene, Scene) else Scene.open(scene)
        check_number("stiffness", stiffness, 0.0, 1e6, "N/m", LoopError)
        if damping is not None:
            check_number("damping", damping, 0.0, 1e3, "N s/m", LoopError)
        _check_hand(hand)
        self._setup = Setup(
            stiffness_N_m=stiffness, response=response, hand=hand, damping_Ns_m=damping
        )
        self._at = None if at is None else _vector(at)
        self._keep = keep
        self._power_on()

    def _power_on(self) -> None:
        config = servo_config(self._setup)
        if self._at is not None:
            base = config.arm.world_from_base.pos_m
            (base.x, base.y, base.z) = (np.array([base.x, base.y, base.z]) + self._at).tolist()
        self._loop = hil.Loop(self.scene, config, sim_params(self._setup))
        self._last: F64 | None = None

    def __reduce__(self) -> NoReturn:
        stays("Loop", "send the path of its scene file, and make one there")

    @property
    def ticks(self) -> int:
        """Ticks since power-on."""
        return self._loop.ticks

    @property
    def mode(self) -> str:
        """Mode of the servo after the last tick: `rendering`, `limited`, `fault`, ..."""
        return mode_names()[self._loop.mode]

    @property
    def faults(self) -> list[str]:
        """Names of the faults that hold the servo; empty: none."""
        return fault_names(self._loop.faults)

    @alone
    def start(self, pose: npt.ArrayLike) -> None:
        """Bring the device up with the hand at `pose` (7,) and begin to render. `tick` and `run` do it when it is due.

        Errors   LoopError when the device does not reach the pose or does not come up.   Cost  3,500 ticks, 0.3 s.
        """
        self._begin(self._targets(_path(_numbers(pose)[None])))

    def _begin(self, targets: F64) -> None:
        """As `start`, at the first of the targets, (n, 6)."""
        bring_up(self._loop, targets[:1])
        self._last = targets[0]
        if not self._keep:
            self._loop.drain()

    @alone
    def tick(self, pose: npt.ArrayLike) -> Felt:
        """One tick, 1 ms: the hand wants the tool at `pose` (7,): x y z in m, unit quaternion w x y z, world_from_tool.

        Output   one row.   Errors  as `run`.   Cost  0.2 ms; `run` costs less a tick.
        """
        return self.run(_numbers(pose)[None])

    @alone
    def run(self, poses: npt.ArrayLike | Trajectory) -> Felt:
        """The hand follows poses, one a millisecond, and gives way to the force: `position_m` says where the tool went.

        poses: (n, 7) as for `tick`; (n, 8) with the time in s before each, or what `load_path` read: resampled to 1 ms.
        Output   one row a tick. A fault of the servo is in `faults`, not an error: the force is zero from there on.
        Errors   TrajectoryError naming the first bad row; LoopError for a pose that the device does not reach.
        Cost     about 0.1 ms a tick.
        """
        path = hil.resample(poses) if isinstance(poses, Trajectory) else _path(_numbers(poses))
        targets = self._targets(path, poses if isinstance(poses, Trajectory) else None)
        if self._last is None:
            self._begin(targets)
        self._loop.run(targets)
        self._last = targets[-1]
        return self._take(len(targets))

    @alone
    def hold(self, ticks: int) -> Felt:
        """The hand wants what it wanted before.   Output: one row a tick.   Errors: LoopError before the first pose,
        and for ticks that are no whole number.
        """
        ticks = check_whole("ticks", ticks, 1, LoopError)
        if self._last is None:
            raise LoopError("the hand has no pose yet; call start, tick or run first")
        self._loop.run(np.repeat(self._last[None, :], ticks, axis=0))
        return self._take(ticks)

    @alone
    def reset(self) -> None:
        """Off and on again: no tick is kept, no fault holds, the first pose brings the device up."""
        self._power_on()

    @alone
    def save(self, file: str | Path, *, force: bool = False) -> Path:
        """Write the recording of all ticks since power-on (.crr), which `crease replay` runs again to the bit.

        force: replace a file that exists. Output: the path.   Errors: LoopError with keep=False, and before
        the first pose; as Scene.save.
        """
        if not self._keep:
            raise LoopError(f"{file}: the loop was made with keep=False and has no ticks to write")
        if not self.ticks:
            raise LoopError(
                f"{file}: the loop has no ticks to write yet; call start, tick or run first"
            )
        file = Path(file)
        check_suffix(file, (SUFFIX,))
        check_target(file, force)
        recording = self._loop.result().recording
        write_bytes(file, recording_bytes(recording.rows, recording.config, self.scene))
        return file

    def _targets(self, path: Trajectory, given: Trajectory | None = None) -> F64:
        """What the hand wants, (n, 6); the wrist goes on from where it is. given: what the path is resampled from."""
        targets = hil.hand_targets(path, self._loop.config, given)
        if self._last is not None:
            turns = np.round((targets[0, 3:] - self._last[3:]) / (2.0 * np.pi))
            targets[:, 3:] -= 2.0 * np.pi * turns
        return targets

    def _take(self, ticks: int) -> Felt:
        if self._keep:
            return Felt(*self._loop.latest(ticks))
        return Felt(*self._loop.drain())


def _check_hand(hand: object) -> None:
    """Errors: LoopError when it is none."""
    if not isinstance(hand, Hand):
        raise LoopError(
            f"hand is {hand!r:.80}; give crease.Hand(mass_kg, damping_Ns_m, stiffness_N_m)"
        )


def _vector(value: npt.ArrayLike) -> F64:
    try:
        vector = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        vector = np.empty(0)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise LoopError("at: give three finite numbers, x y z in m")
    return vector


def _numbers(poses: npt.ArrayLike) -> F64:
    refuse_file(poses)
    try:
        return np.asarray(poses, np.float64)
    except (TypeError, ValueError) as error:
        raise TrajectoryError(
            "a pose is 7 numbers: x y z in m and a unit quaternion w x y z"
        ) from error


def _path(poses: F64) -> Trajectory:
    """A path of one pose a millisecond.   Errors: TrajectoryError."""
    if poses.ndim != 2 or len(poses) == 0 or poses.shape[1] not in (POSE_NUMBERS, POSE_NUMBERS + 1):
        raise TrajectoryError(
            f"poses of shape {poses.shape}: give n rows of x y z w x y z, or of t x y z w x y z"
        )
    if poses.shape[1] == POSE_NUMBERS:
        return check_rows(np.column_stack([np.arange(len(poses)) * 1e-3, poses]), "poses")
    return hil.resample(check_rows(poses, "poses"))
