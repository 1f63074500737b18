"""A path through the firmware's tick: the very C code that runs on the device."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.base.alone import Alone, alone
from crease.base.errors import SceneError
from crease.base.native import COVERAGES, RESPONSES, error_text, ffi, lib, lib_of
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

COUPLE_COLUMNS = (
    *("couple_N_m", "couple_Nm_rad", "couple_Ns_m", "couple_Nms_rad", "couple_friction"),
    *("couple_x_m", "couple_y_m", "couple_z_m"),
)
"""Of a held tool's table only: its springs, dampers, friction and centre, as of ReplayOptions and CoupleOptions."""


DEFAULT_RESPONSE = "way_out"
"""What the library has. Every other response is a rival (firmware/rivals), for comparison on the host."""


@dataclass(frozen=True)
class CoupleOptions:
    """Settings of a held tool, which a spring in six degrees of freedom ties to the hand: firmware/couple.h.

    The spring's stiffness and damping along are those of ReplayOptions.
    """

    stiffness_Nm_rad: float = 5.0
    damping_Nms_rad: float = 0.0
    friction: float = 0.0
    centre_tool_m: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class ReplayOptions:
    """Settings of the world. Names of response and coverage as in `native.RESPONSES`, `native.COVERAGES`.

    coverage and vertices_only other than these: only with a response of rivals/.
    """

    stiffness_N_m: float = 1000.0
    damping_Ns_m: float = 0.0
    response: str = DEFAULT_RESPONSE
    coverage: str = "soft"
    force_max_N: float | None = None
    skip: int | None = None
    vertices_only: bool = False
    lookups_max: int | None = None
    couple: CoupleOptions | None = None
    """Not None: the tool is held outside, and the spring to it is felt. It has no force_max_N, skip and lookups_max."""


def make_config(options: ReplayOptions) -> Any:
    """A cffi `cr_config *`: the firmware's defaults with the options laid over them.

    Errors: SceneError for a coverage that is not for this response.
    """
    if options.response == DEFAULT_RESPONSE and (
        options.coverage != "soft" or options.vertices_only
    ):
        what = "vertices_only" if options.vertices_only else f"coverage {options.coverage}"
        if options.couple is not None:
            raise SceneError(f"{what}: a held tool has none; leave it out")
        raise SceneError(
            f"{what}: {DEFAULT_RESPONSE} weighs every sample by its depth; use response extent, the method as published"
        )
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


def refuse_coupled(options: ReplayOptions, what: str) -> None:
    """Errors: SceneError for options of a held tool, where only the world's own answer can be had."""
    if options.couple is not None:
        raise SceneError(f"couple: {what} shows the world's own answer; leave it out")


def _number(name: str, value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise SceneError(f"{name}: not a number: {value!r}") from None


def _refuse_of_world(options: ReplayOptions) -> None:
    """Errors: SceneError for settings that say nothing of a held tool."""
    if options.response != DEFAULT_RESPONSE:
        raise SceneError(f"response {options.response}: a held tool has no response but its own")
    for name in ("force_max_N", "lookups_max", "skip"):
        if getattr(options, name) is not None:
            raise SceneError(f"{name}: a held tool has none; leave it out")


def make_coupled(options: ReplayOptions) -> Any:
    """A cffi `cr_coupled *` that holds no tool yet.

    Errors: SceneError for a setting out of range or no number, for a rival, and for settings of the world's answer.
    """
    _refuse_of_world(options)
    couple = options.couple or CoupleOptions()
    centre = np.asarray(couple.centre_tool_m, dtype=object)
    if centre.shape != (3,):
        raise SceneError(f"centre_tool_m: x, y and z in m, not {couple.centre_tool_m!r}")
    config = ffi.new("cr_couple_config *", lib.cr_couple_config_default())
    for of, name in (
        (options, "stiffness_N_m"),
        (options, "damping_Ns_m"),
        (couple, "stiffness_Nm_rad"),
        (couple, "damping_Nms_rad"),
        (couple, "friction"),
    ):
        setattr(config, name, _number(name, getattr(of, name)))
    config.centre_tool_m = tuple(_number("centre_tool_m", value) for value in centre)
    wrong = lib.cr_couple_config_error(config)
    if wrong:
        raise SceneError(f"of the held tool: {ffi.string(wrong).decode()}")
    coupled = ffi.new("cr_coupled *")
    lib.cr_coupled_init(coupled, config)
    return coupled


class World:
    """A world of the firmware over a scene, in memory of its own. Not for two threads at once: CreaseError."""

    def __init__(self, scene: Scene, options: ReplayOptions | None = None) -> None:
        """Errors: SceneError when the firmware refuses the settings; CreaseError for a rival that is not installed."""
        self.scene = scene
        self._alone = Alone("world")
        self.config = make_config(options or ReplayOptions())
        self.native = lib_of(self.config.response)
        """The extension that made it: its functions alone take the `handle`."""
        self.own_scene = self.native.own("cr_scene", scene.handle)
        """The scene's `cr_scene *`, for functions of `native`."""
        self._own_config = self.native.own("cr_config", self.config)
        self.size_bytes = int(self.native.lib.cr_world_size(self.own_scene, self._own_config))
        if self.size_bytes == 0:
            wrong = self.native.lib.cr_config_error(self._own_config)
            text = ffi.string(wrong).decode() if wrong else error_text(lib.CR_ERR_CONFIG)
            raise SceneError(f"{scene.source}: a world setting is out of range: {text}")
        self._memory = np.zeros(self.size_bytes + _ALIGN, dtype=np.uint8)
        self._handle: Any = None
        self._couple = make_coupled(options) if options and options.couple else None
        self.reset()

    @property
    def handle(self) -> Any:
        """The cffi `cr_world *`, for functions of `native`."""
        return self._handle

    @property
    def coupled(self) -> Any:
        """The cffi `cr_coupled *`; None for a world without a held tool."""
        return self._couple

    @alone
    def reset(self) -> None:
        """Back to the state before the first tick.   Errors: SceneError."""
        start = -self._memory.ctypes.data % _ALIGN
        memory = ffi.from_buffer("uint8_t[]", self._memory) + start
        world = self.native.ffi.new("cr_world **")
        settings = (self.size_bytes, self.own_scene, self._own_config)
        code = int(self.native.lib.cr_world_init(world, memory, *settings))
        if code != lib.CR_OK:
            raise SceneError(f"{self.scene.source}: {error_text(code)}; check the options")
        self._handle = world[0]
        if self._couple is not None:
            lib.cr_coupled_reset(self._couple)

    @alone
    def tick(self, pose: npt.ArrayLike, period_s: float = 1e-3) -> Any:
        """One tick of the world's own answer.

        Errors: SceneError for a world with a held tool: that runs a path.
        Shapes: pose (7,): x y z in m, unit quaternion w x y z.
        Output: a cffi `cr_output *` of `native`, owned by the caller.
        """
        if self._couple is not None:
            raise SceneError("couple: a world with a held tool runs a path: run")
        x, y, z, w, i, j, k = np.asarray(pose, dtype=np.float64).tolist()
        new = self.native.ffi.new
        out = new("cr_output *")
        world_from_tool = new("cr_pose *", {"pos_m": (x, y, z), "rot": (w, i, j, k)})
        self.native.lib.cr_tick(self._handle, world_from_tool, period_s, out)
        return out

    @alone
    def run(
        self, path: Trajectory, progress: Callable[[float], None] = lambda _: None
    ) -> npt.NDArray[Any]:
        """Tick along a path from where the world is.   Output: structured array ROW (n,)."""
        out = np.zeros(len(path), dtype=ROW)
        rows = self.native.ffi.from_buffer("cr_replay_row[]", out, require_writable=True)
        poses = self.native.ffi.from_buffer("cr_path_row[]", path.rows)
        lead: tuple[Any, ...] = (self._handle,)
        replay = self.native.lib.cr_replay_run
        if self._couple is not None:
            lead, replay = (self._couple, self._handle), lib.cr_replay_coupled
        for start in range(0, len(path), _CHUNK):
            count = min(_CHUNK, len(path) - start)
            before_s = path.t_s[start] - path.t_s[start - 1] if start else path.first_period_s
            replay(*lead, poses + start, count, float(before_s), rows + start)
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


def couple_columns(options: ReplayOptions, count: int) -> dict[str, npt.NDArray[Any]]:
    """Settings of a held tool as columns (count,), so that whoever draws the table can run it again; none without."""
    couple = options.couple
    if couple is None:
        return {}
    values = (
        *(options.stiffness_N_m, couple.stiffness_Nm_rad),
        *(options.damping_Ns_m, couple.damping_Nms_rad, couple.friction, *couple.centre_tool_m),
    )
    return {
        name: np.full(count, value, np.float32)
        for name, value in zip(COUPLE_COLUMNS, values, strict=True)
    }


def couple_options_of(table: Mapping[str, npt.NDArray[Any]]) -> ReplayOptions | None:
    """The options of a held tool's table; None for a table that says of none."""
    if not set(COUPLE_COLUMNS) <= set(table):
        return None
    along, turn, damping, damping_turn, friction, *centre = (
        float(table[name][0]) for name in COUPLE_COLUMNS
    )
    couple = CoupleOptions(turn, damping_turn, friction, (centre[0], centre[1], centre[2]))
    return ReplayOptions(along, damping, couple=couple)


def to_columns(
    path: Trajectory,
    rows: npt.NDArray[Any],
    runs: int = 1,
    options: ReplayOptions | None = None,
) -> dict[str, npt.NDArray[Any]]:
    """The columns of a table of ticks, by name, from a path and what `run_path` gave.

    runs: its `repeat`. options: its options; those of a held tool are columns too.
    """
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
    settings = couple_columns(options or ReplayOptions(), len(path))
    return {**columns, **settings, RUNS: np.full(len(path), runs, np.uint32)}
