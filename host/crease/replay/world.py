"""`crease.World`: a tool in the hand, tick by tick or along a path, through the very C code that runs on the device."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from crease.base.alone import Alone, alone, stays
from crease.base.arguments import check_number
from crease.base.errors import SceneError, TrajectoryError
from crease.base.native import COVERAGES, RESPONSES, Extension
from crease.base.records import record
from crease.base.scene import Scene
from crease.base.table import check_suffix, check_target, write_table
from crease.replay.replay import DEFAULT_RESPONSE, ReplayOptions, to_columns
from crease.replay.replay import World as Engine
from crease.replay.trajectory import POSE_NUMBERS, Trajectory, check_rows, put_pose, refuse_file

F32 = npt.NDArray[np.float32]
U32 = npt.NDArray[np.uint32]

PERIOD_S = 1e-3
"""Time between ticks where none is given: the device's."""

OUTPUT = record("cr_output")
"""Of firmware/crease.h."""

_OBJECTS_BYTES = 4_000
"""Of Python for a world: measured."""


class Output:
    """What a world answered to its last tick: views into the world's memory, which its next tick writes over.

    Keep a number or `.copy()` of an array, not the view. One object for the life of the world.
    Frames: world is the frame of the static mesh. Units: SI. All numbers are finite.
    """

    __slots__ = {
        "_cell": None,
        "display_position_m": "(3,) of the tool for the eye, m, world frame: moved out of the static object.",
        "display_quaternion": "(4,) of the tool for the eye, unit, scalar first, world_from_tool.",
        "force_N": "(3,) on the tool, N, world frame.",
        "normal": "(3,) unit, of the deepest area, out of the static object, world frame; zeros in free space.",
        "record": "The C struct `cr_output` whole, a structured array (1,); names as in firmware/crease.h.",
        "torque_Nm": "(3,) about the tool origin, N m, world frame.",
    }

    record: npt.NDArray[Any]
    force_N: F32
    torque_Nm: F32
    normal: F32
    display_position_m: F32
    display_quaternion: F32

    def __init__(self, memory: npt.NDArray[Any]) -> None:
        """memory: structured array OUTPUT (1,), written by the world."""
        self.record = memory
        self._cell = memory[0]
        self.force_N = memory["force_world_N"][0]
        self.torque_Nm = memory["torque_world_Nm"][0]
        self.normal = memory["normal_world"][0]
        self.display_position_m = memory["display_pose"]["pos_m"][0]
        self.display_quaternion = memory["display_pose"]["rot"][0]

    @property
    def depth_m(self) -> float:
        """Depth of the deepest area, m; 0 in free space."""
        return float(self._cell["depth_m"])

    @property
    def faults(self) -> int:
        """Bits of what was refused, latched until `World.clear_fault`; 0: none. The force is zero meanwhile.

        1: pose not finite, quaternion not of unit length within 1 %, or beyond 1e4 m. 2: period not in (0, 1] s.
        4: the image gave no number.
        """
        return int(self._cell["faults"])

    @property
    def areas(self) -> npt.NDArray[Any]:
        """Contact areas, a structured array (n,): normal_world, point_world_m, force_world_N, all (3,), depth_m, ...

        The names are those of `cr_area` in firmware/crease.h; `zones` holds its contact zones, the first `zone_count`.
        """
        view: npt.NDArray[Any] = self._cell["areas"][: int(self._cell["area_count"])]
        return view

    @property
    def zone_count(self) -> int:
        """Contact zones over all areas."""
        return int(self._cell["zone_count"])

    @property
    def stats(self) -> dict[str, int]:
        """Work done and trouble met in the tick, by the names of `cr_stats`."""
        stats = self._cell["stats"]
        return {name: int(stats[name]) for name in stats.dtype.names}

    def __repr__(self) -> str:
        x, y, z = self.force_N.tolist()
        told = f"depth_m={self.depth_m:.6g}, areas={len(self.areas)}, faults={self.faults}"
        return f"Output(force_N=[{x:.6g}, {y:.6g}, {z:.6g}], {told})"


def in_words(rows: npt.NDArray[Any]) -> str:
    """A run in a few words, of rows with areas and force_N, one a tick."""
    most_N = float(np.linalg.norm(rows["force_N"], axis=1).max(initial=0.0))
    return f"{len(rows):,} ticks, {np.count_nonzero(rows['areas']):,} in contact, {most_N:.4g} N at most"


@dataclass(frozen=True)
class Replay:
    """What a path felt, one row a tick: views into one array."""

    path: Trajectory = field(repr=False)
    """The poses, with their times."""
    rows: npt.NDArray[Any] = field(repr=False)
    """Structured array (n,), `cr_replay_row` of host/native/replay.h: everything below and more."""
    options: ReplayOptions = field(default=ReplayOptions(), repr=False)
    """Of a held tool, what it was held with: `save` keeps it, so that `crease view` can draw what holds the tool."""

    def __repr__(self) -> str:
        return f"Replay({in_words(self.rows)})"

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def t_s(self) -> npt.NDArray[np.float64]:
        """(n,) times."""
        return self.path.t_s

    @property
    def force_N(self) -> F32:
        """(n, 3) on the tool, N, world frame."""
        return self._column("force_N")

    @property
    def torque_Nm(self) -> F32:
        """(n, 3) about the tool origin, N m, world frame."""
        return self._column("torque_Nm")

    @property
    def depth_m(self) -> F32:
        """(n,) of the deepest area; 0 in free space."""
        return self._column("depth_m")

    @property
    def normal(self) -> F32:
        """(n, 3) unit, of the deepest area, out of the static object; zeros in free space."""
        return self._column("normal")

    @property
    def areas(self) -> U32:
        """(n,) contact areas."""
        return self._column("areas")

    @property
    def zones(self) -> U32:
        """(n,) contact zones over all areas."""
        return self._column("zones")

    @property
    def contacts(self) -> U32:
        """(n,) samples of the tool inside."""
        return self._column("contacts")

    @property
    def faults(self) -> U32:
        """(n,) bits as Output.faults."""
        return self._column("faults")

    @property
    def overflow(self) -> U32:
        """(n,) contact left out and forces cut to the limit, counted; 0: none."""
        return self._column("overflow")

    @property
    def tick_ns(self) -> U32:
        """(n,) time of the tick: the only numbers that differ from run to run."""
        return self._column("tick_ns")

    def _column(self, name: str) -> npt.NDArray[Any]:
        view: npt.NDArray[Any] = self.rows[name]
        return view

    def save(self, file: str | Path, *, force: bool = False) -> Path:
        """Write the table of `crease replay`, CSV or NPZ by suffix: whole or not at all. `crease plot` draws it.

        force: replace a file that exists. Output: the path.   Errors: CreaseError, as Scene.save.
        """
        file = Path(file)
        check_suffix(file, (".csv", ".npz"))
        check_target(file, force)
        write_table(file, to_columns(self.path, self.rows, options=self.options))
        return file


class World:
    """A scene with a tool in the hand. One thread at a time, another gets a CreaseError; worlds may share a scene."""

    def __init__(
        self,
        scene: Scene | str | Path,
        *,
        stiffness: float = 1000.0,
        damping: float = 0.0,
        response: str = DEFAULT_RESPONSE,
        coverage: str = "soft",
        force_max: float | None = None,
    ) -> None:
        """A world in free space.

        scene: baked, opened, or the path of its file. stiffness: N/m, 0 to 1e6. damping: N s/m, 0 to 1e4, along the
        normal, never pulling. response: how contact becomes force, a key of `crease.RESPONSES`. coverage: `soft`, a
        sample counts by its part that is inside; `hard`, in or out, not with `way_out`. force_max: N, 1e-6 to 1e6,
        limit of |force|; None: 100.
        Errors   SceneError for a setting out of range or an unknown name; CreaseError for a response of other authors
                 where they are not installed.
        Cost     about 60 kB and a millisecond.
        Source   firmware/crease.h `cr_config`; firmware/rivals/README.md for responses of other authors.
        """
        for what, name, known in (
            ("response", response, RESPONSES),
            ("coverage", coverage, COVERAGES),
        ):
            if not isinstance(name, str) or name not in known:
                raise SceneError(f"{what} '{name}' is not known; use one of {', '.join(known)}")
        check_number("stiffness", stiffness, 0.0, 1e6, "N/m", SceneError)
        check_number("damping", damping, 0.0, 1e4, "N s/m", SceneError)
        if force_max is not None:
            check_number("force_max", force_max, 1e-6, 1e6, "N", SceneError)
        self.scene: Scene = scene if isinstance(scene, Scene) else Scene.open(scene)
        options = ReplayOptions(stiffness, damping, response, coverage, force_max)
        self._alone = Alone("world")
        self._enter, self._leave = self._alone.enter, self._alone.leave
        self._engine = Engine(self.scene, options)
        self._handle = self._engine.handle
        self._pose = np.zeros(POSE_NUMBERS, np.float32)
        ffi = self.native.ffi
        self._pose_c = ffi.cast("cr_pose *", ffi.from_buffer(self._pose))
        memory = np.zeros(1, OUTPUT)
        self._out_c = ffi.cast("cr_output *", ffi.from_buffer(memory))
        self._out = Output(memory)
        self._tick = self.native.lib.cr_tick

    def __reduce__(self) -> NoReturn:
        stays("World", "send the path of its scene file, and make one there")

    @property
    def size_bytes(self) -> int:
        """Memory that it takes, without the scene's."""
        return self._engine.size_bytes + OUTPUT.itemsize + _OBJECTS_BYTES

    @property
    def native(self) -> Extension:
        """The extension that answers: another one for responses of other authors."""
        return self._engine.native

    @property
    def handle(self) -> Any:
        """The cffi `cr_world *`, for functions of `native`. Another one after `reset`."""
        return self._handle

    def tick(self, pose: npt.ArrayLike, period_s: float = PERIOD_S) -> Output:
        """One tick: where the tool is now, and how long since the last tick.

        pose: (7,) x y z in m, unit quaternion w x y z of world_from_tool.
        Output   the world's Output, written over by the next tick. A pose that is not sane latches a fault there, and
                 the force is zero until `clear_fault`: the loop goes on.
        Errors   TrajectoryError when pose is not 7 numbers; CreaseError while another thread is in this world.
        Cost     1 to 3 us above the tick itself (README.md "From Python"), 0.15 us of it to keep other threads out; an
                 array costs less than a list.
        """
        if not self._enter():
            self._alone.refuse()
        try:
            put_pose(pose, self._pose)
            self._tick(self._handle, self._pose_c, period_s, self._out_c)
        finally:
            self._leave()
        return self._out

    @alone
    def replay(self, poses: npt.ArrayLike | Trajectory, period_s: float = PERIOD_S) -> Replay:
        """Many ticks in one call, from where the world is; `reset` first for a fresh one.

        poses: (n, 7) as for `tick`, period_s apart; or (n, 8) with the time in s before each; or what `load_path` read.
        Output   one row a tick: the forces of `tick` to the bit.
        Errors   TrajectoryError naming the first bad row: not finite, not of unit length within 1 %, beyond 1e4 m,
                 time that stands.
        Cost     under 1 us a tick above the ticks themselves.
        """
        path = poses if isinstance(poses, Trajectory) else path_of(poses, period_s)
        return Replay(path, self._engine.run(path))

    @alone
    def reset(self) -> None:
        """Back to free space before the first tick."""
        self._engine.reset()
        self._handle = self._engine.handle

    @alone
    def clear_fault(self) -> None:
        """Forget motion and faults: the next tick has no velocity."""
        self.native.lib.cr_world_clear_fault(self._handle)


def path_of(poses: npt.ArrayLike, period_s: float) -> Trajectory:
    """A checked path from an array (n, 7) or (n, 8).   Errors: TrajectoryError."""
    refuse_file(poses)
    try:
        rows = np.asarray(poses, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise TrajectoryError(
            "poses are not numbers; give an array of n rows and 7 columns"
        ) from error
    if rows.ndim != 2 or rows.shape[1] not in (POSE_NUMBERS, POSE_NUMBERS + 1):
        raise TrajectoryError(
            f"poses of shape {rows.shape}: give n rows of x y z w x y z, or of t x y z w x y z"
        )
    if rows.shape[1] == POSE_NUMBERS:
        rows = np.column_stack([np.arange(len(rows)) * period_s, rows])
    return check_rows(rows, "poses")
