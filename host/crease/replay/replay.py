"""A path through the firmware's tick: the very C code that runs on the device."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.base.errors import SceneError
from crease.base.native import COVERAGES, RESPONSES, error_text, ffi, lib
from crease.base.records import record
from crease.base.scene import Scene
from crease.replay.trajectory import COLUMNS as PATH_COLUMNS
from crease.replay.trajectory import Trajectory

_ALIGN = 64
_CHUNK = 8192
REPEAT = 5
"""Runs of a path: a scheduler that breaks into the same tick five times is rare."""

ROW = record("cr_replay_row")
"""Of host/native/replay.h."""

ANSWER_COLUMNS = (
    *("t_s", "fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm", "depth_m", "nx", "ny", "nz"),
    *("areas", "zones", "contacts", "nodes", "points", "tick_ns"),
    *("dx_m", "dy_m", "dz_m", "dqw", "dqx", "dqy", "dqz"),
)
"""What a tick answered, and when."""

COLUMNS = (*ANSWER_COLUMNS, *PATH_COLUMNS[1:])
"""Columns of a table of ticks, in the order of the file. The last are the pose: a table is a path too."""

RUNS = "runs"
"""A column after them, that older tables have not: how often the path was run; tick_ns is the least of it."""


@dataclass(frozen=True)
class ReplayOptions:
    """Settings of the world. Names of response and coverage as in `native.RESPONSES`, `native.COVERAGES`."""

    stiffness_N_m: float = 1000.0
    damping_Ns_m: float = 0.0
    response: str = "zones"
    coverage: str = "soft"
    force_max_N: float | None = None
    skip: int | None = None
    vertices_only: bool = False
    lookups_max: int | None = None


def make_config(options: ReplayOptions) -> Any:
    """A cffi `cr_config *`: the firmware's defaults with the options laid over them."""
    config = ffi.new("cr_config *", lib.cr_config_default())
    config.stiffness_N_m = options.stiffness_N_m
    config.damping_Ns_m = options.damping_Ns_m
    config.response = RESPONSES[options.response]
    config.coverage = COVERAGES[options.coverage]
    config.vertices_only = int(options.vertices_only)
    if options.force_max_N is not None:
        config.force_max_N = options.force_max_N
    if options.skip is not None:
        config.skip = options.skip
    if options.lookups_max is not None:
        config.lookups_max = options.lookups_max
    return config


class World:
    """A world of the firmware over a scene, in memory of its own. Not for two threads at once."""

    def __init__(self, scene: Scene, options: ReplayOptions | None = None) -> None:
        """Errors: SceneError when the firmware refuses the settings."""
        self.scene = scene
        self.config = make_config(options or ReplayOptions())
        self.size_bytes = int(lib.cr_world_size(scene.handle, self.config))
        if self.size_bytes == 0:
            raise SceneError(f"{scene.source}: {error_text(lib.CR_ERR_CONFIG)}; check the options")
        self._memory = np.zeros(self.size_bytes + _ALIGN, dtype=np.uint8)
        self._handle: Any = None
        self.reset()

    @property
    def handle(self) -> Any:
        """The cffi `cr_world *`, for functions of the library."""
        return self._handle

    def reset(self) -> None:
        """Back to the state before the first tick.   Errors: SceneError."""
        start = -self._memory.ctypes.data % _ALIGN
        memory = ffi.from_buffer("uint8_t[]", self._memory) + start
        world = ffi.new("cr_world **")
        code = int(
            lib.cr_world_init(world, memory, self.size_bytes, self.scene.handle, self.config)
        )
        if code != lib.CR_OK:
            raise SceneError(f"{self.scene.source}: {error_text(code)}; check the options")
        self._handle = world[0]

    def tick(self, pose: npt.ArrayLike, period_s: float = 1e-3) -> Any:
        """One tick.

        Shapes: pose (7,): x y z in m, unit quaternion w x y z.
        Output: a cffi `cr_output *`, owned by the caller.
        """
        x, y, z, w, i, j, k = np.asarray(pose, dtype=np.float64).tolist()
        out = ffi.new("cr_output *")
        world_from_tool = ffi.new("cr_pose *", {"pos_m": (x, y, z), "rot": (w, i, j, k)})
        lib.cr_tick(self._handle, world_from_tool, period_s, out)
        return out

    def run(
        self, path: Trajectory, progress: Callable[[float], None] = lambda _: None
    ) -> npt.NDArray[Any]:
        """Tick along a path from where the world is.   Output: structured array ROW (n,)."""
        out = np.zeros(len(path), dtype=ROW)
        rows = ffi.from_buffer("cr_replay_row[]", out, require_writable=True)
        poses = ffi.from_buffer("cr_path_row[]", path.rows)
        for start in range(0, len(path), _CHUNK):
            count = min(_CHUNK, len(path) - start)
            before_s = path.t_s[start] - path.t_s[start - 1] if start else path.first_period_s
            lib.cr_replay_run(self._handle, poses + start, count, float(before_s), rows + start)
            progress((start + count) / len(path))
        return out


def run_path(
    scene: Scene,
    path: Trajectory,
    options: ReplayOptions | None = None,
    repeat: int = 1,
    progress: Callable[[float], None] = lambda _: None,
) -> npt.NDArray[Any]:
    """Replay a path from a fresh world.

    `repeat` > 1 runs it that many times and keeps the least tick_ns of each pose: the cost without the machine's
    noise. Everything else is the same in every run.
    Output: structured array ROW (n,).   Errors: SceneError.   Cost: about 5 us a tick in contact.
    """
    world = World(scene, options)
    best = world.run(path, lambda part: progress(part / repeat))
    for done in range(1, repeat):
        world.reset()
        again = world.run(path, lambda part, done=done: progress((done + part) / repeat))  # type: ignore[misc]
        np.minimum(best["tick_ns"], again["tick_ns"], out=best["tick_ns"])
    return best


def to_columns(
    path: Trajectory, rows: npt.NDArray[Any], runs: int = 1
) -> dict[str, npt.NDArray[Any]]:
    """The columns of a table of ticks, by name, from a path and what `run_path` gave.   runs: its `repeat`."""
    values = [
        path.t_s,
        *rows["force_N"].T,
        *rows["torque_Nm"].T,
        rows["depth_m"],
        *rows["normal"].T,
        *(rows[name] for name in ("areas", "zones", "contacts", "nodes", "points", "tick_ns")),
        *rows["display_pos_m"].T,
        *rows["display_rot"].T,
        *path.rows[:, 1:].T,
    ]
    columns = dict(zip(COLUMNS, values, strict=True))
    return {**columns, RUNS: np.full(len(path), runs, np.uint32)}
