"""`crease.Worlds`: many worlds over one scene, ticked together on the machine's cores: for learning and for sweeps."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from crease.base.alone import Alone, alone, stays
from crease.base.arguments import check_memory, check_whole
from crease.base.errors import SceneError, TrajectoryError
from crease.base.scene import Scene
from crease.replay.replay import DEFAULT_RESPONSE, ROW
from crease.replay.trajectory import POSE_NUMBERS
from crease.replay.world import PERIOD_S, World

Observation = dict[str, npt.NDArray[Any]]
U32 = npt.NDArray[np.uint32]
OBSERVED = ("force_N", "torque_Nm", "depth_m", "normal", "faults")
"""Parts of an observation."""

_PARALLEL = 64
"""Fewer worlds are ticked by the caller alone: handing over costs 30 us, as much as their ticks."""


class Worlds:
    """A batch of worlds that share a scene, in the manner of gymnasium's vector environments.

        worlds = crease.Worlds(scene, 1024)
        seen = worlds.reset()                   # dict of arrays, (1024, ...)
        seen = worlds.step(poses)               # an action is a pose, (1024, 7)

    Rewards and ends are the caller's: they are no part of the contact. One thread at a time calls it, another gets a
    CreaseError.
    """

    def __init__(
        self,
        scene: Scene | str | Path,
        count: int,
        *,
        stiffness: float = 1000.0,
        damping: float = 0.0,
        response: str = DEFAULT_RESPONSE,
        coverage: str = "soft",
        force_max: float | None = None,
        threads: int | None = None,
    ) -> None:
        """`count` worlds in free space; the settings are those of `crease.World`, the same for all.

        threads: that tick; None: one for each core this process may use.
        Errors   SceneError for a setting out of range, a count or threads below 1, and more worlds than half of the
                 machine's memory holds.
        Cost     60 kB of memory a world, more with a large tool; 0.1 s for a thousand.
        """
        count = check_whole("count", count, 1, SceneError)
        if threads is not None:
            threads = check_whole("threads", threads, 1, SceneError)

        def fresh() -> World:
            return World(
                self.scene,
                stiffness=stiffness,
                damping=damping,
                response=response,
                coverage=coverage,
                force_max=force_max,
            )

        self._alone = Alone("batch of worlds")
        self.scene: Scene = scene if isinstance(scene, Scene) else Scene.open(scene)
        self._worlds = [fresh()]
        each_bytes = self._worlds[0].size_bytes + ROW.itemsize
        check_memory("worlds", count, each_bytes, SceneError)
        self._worlds += [fresh() for _ in range(count - 1)]
        wanted = threads or len(os.sched_getaffinity(0))
        self.threads = 1 if count < _PARALLEL else min(wanted, count)
        """That tick."""
        self._pool = ThreadPoolExecutor(self.threads) if self.threads > 1 else None
        edges = np.linspace(0, count, self.threads + 1).astype(int).tolist()
        self._parts = list(pairwise(edges))
        self._native = self._worlds[0].native
        self._handles = self._native.ffi.new("cr_world *[]", count)
        self._fresh(range(count))
        self.rows: npt.NDArray[Any] = np.zeros(count, ROW)
        """Structured array (count,), `cr_replay_row` of host/native/replay.h: the last step, whole."""

    def __reduce__(self) -> NoReturn:
        stays("Worlds", "send the path of its scene file, and make one there")

    def __len__(self) -> int:
        return len(self._worlds)

    @alone
    def step(self, actions: npt.ArrayLike, period_s: float = PERIOD_S) -> Observation:
        """One tick of every world.

        actions: (count, 7), one pose a world: x y z in m, unit quaternion w x y z of world_from_tool.
        Output   observations by name, world frame: force_N (count, 3), torque_Nm (count, 3) about the tool origin,
                 depth_m (count,), normal (count, 3) of the deepest area, faults (count,) bits as `Output.faults` has
                 them. Copies. The forces of `World.tick` to the bit. A pose that is not sane latches a fault in its
                 world: no force until its `reset`.
        Errors   TrajectoryError for another shape.
        Cost     the ticks over the threads, and 1 us a world.
        """
        try:
            poses = np.ascontiguousarray(actions, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise TrajectoryError("actions are not numbers; give one pose a world") from error
        if poses.shape != (len(self), POSE_NUMBERS):
            raise TrajectoryError(
                f"actions of shape {poses.shape}: give ({len(self)}, {POSE_NUMBERS}), one pose a world"
            )
        ffi, each = self._native.ffi, self._native.lib.cr_replay_each
        given = ffi.from_buffer("double[]", poses)
        rows = ffi.from_buffer("cr_replay_row[]", self.rows, require_writable=True)

        def tick(part: tuple[int, int]) -> None:
            at, end = part
            each(self._handles + at, given + POSE_NUMBERS * at, end - at, period_s, rows + at)

        if self._pool is None:
            tick(self._parts[0])
        else:
            list(self._pool.map(tick, self._parts))  # the ticks run without the interpreter's lock
        return self._observe()

    @alone
    def reset(self, which: npt.ArrayLike | None = None) -> Observation:
        """Back to free space, without faults. which: (count,) bool; None: all.

        Output   observations as of `step`: zeros where a world begins again.
        Errors   TrajectoryError for another shape.
        """
        chosen = np.ones(len(self), np.bool_) if which is None else np.asarray(which)
        if chosen.shape != (len(self),) or chosen.dtype != np.bool_:
            raise TrajectoryError(f"which: give {len(self)} truth values, one a world")
        self.rows[chosen] = np.zeros((), ROW)
        self._fresh(np.flatnonzero(chosen).tolist())
        return self._observe()

    @property
    def faults(self) -> U32:
        """(count,) bits as `Output.faults` has them; 0: none. A view; an observation has a copy."""
        view: U32 = self.rows["faults"]
        return view

    @property
    def areas(self) -> U32:
        """(count,) contact areas."""
        view: U32 = self.rows["areas"]
        return view

    def close(self) -> None:
        """End the threads; the last step's arrays stay."""
        if self._pool is not None:
            self._pool.shutdown()

    def _fresh(self, which: Any) -> None:
        for i in which:
            self._worlds[i].reset()
            self._handles[i] = self._worlds[i].handle

    def _observe(self) -> Observation:
        return {name: self.rows[name].copy() for name in OBSERVED}
