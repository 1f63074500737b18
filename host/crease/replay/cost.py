"""What a scene costs on a controller: room for it, memory, and instructions of a tick."""

from __future__ import annotations

import tomllib
from dataclasses import asdict, dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.base.errors import SceneError
from crease.base.native import ffi, lib
from crease.base.scene import Scene
from crease.replay.replay import ReplayOptions, World
from crease.replay.trajectory import Trajectory

BOARD_WORK = 40
"""Units of work in a tick that fits an STM32H743 (firmware/DESIGN.md, "A tick that fits")."""
PERIOD_S = 1e-3
BOARD_LATE_MAX = 50
"""Ticks: the boards' loop faults when the answer is older (BOARD_LATE_MAX_TICKS of board.h)."""


@dataclass(frozen=True)
class Device:
    """A controller: room for a scene, and for servo and world; code and stack of the library on its core.

    beside_stack_bytes: of a search and of the interrupt with the tick that only feels over it.
    """

    name: str
    core: str
    clock_Hz: float
    scene_bytes: int
    memory_bytes: int
    code_bytes: int
    stack_bytes: int
    beside_stack_bytes: int


@dataclass(frozen=True)
class Ticks:
    """Along a path: instructions as reckoned (50th, 99th percentile, most), and how many ticks late the answers are.

    most: with the step of the search that ends a tick. largest_s: at one instruction a cycle.
    """

    path: str
    ticks: int
    p50: int
    p99: int
    most: int
    largest_s: float
    late_mean: float
    late_most: int


@dataclass(frozen=True)
class Beside:
    """Along a path, contact being searched for beside ticks that only feel and interrupt it, in the time they leave.

    largest_s: of a tick, at one instruction a cycle.
    """

    feel: int
    largest_s: float
    late_mean: float
    late_most: int


@dataclass(frozen=True)
class Cost:
    """Bytes of the scene, and of servo and world. instructions, step: as reckoned, of a tick with so much work and of
    the step of the search that ends it, the longest that was found at deep poses: no bound. largest_s: of both, at one
    instruction a cycle. within, beside: along a path.
    """

    device: Device
    scene_bytes: int
    memory_bytes: int
    work: int
    instructions: int
    step: int
    largest_s: float
    within: Ticks | None = None
    beside: Beside | None = None

    @property
    def fits(self) -> bool:
        """Whether there is room for the scene, and for servo and world."""
        return (
            self.scene_bytes <= self.device.scene_bytes
            and self.memory_bytes <= self.device.memory_bytes
        )

    def report(self) -> dict[str, Any]:
        """For a program."""
        return asdict(self) | {"fits": self.fits}


@cache
def _table() -> dict[str, Any]:
    return tomllib.loads((files("crease.replay") / "devices.toml").read_text("utf-8"))


def device_names() -> list[str]:
    """Those that are known."""
    return sorted(_table()["device"])


def find_device(name: str) -> Device:
    """A controller by its name, in any case.   Errors: SceneError that names those that are known."""
    table = _table()
    entry = table["device"].get(name.lower())
    if entry is None:
        raise SceneError(f"device '{name}' is not known; use {', '.join(device_names())}")
    core = table["core"][entry["core"]]
    return Device(
        name.lower(),
        core["name"],
        1e6 * entry["clock_MHz"],
        1024 * entry["scene_KiB"],
        1024 * entry["memory_KiB"],
        core["code_bytes"],
        core["stack_bytes"],
        core["beside_stack_bytes"],
    )


def instructions_of(work: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Instructions of ticks that did so much work, as reckoned; shape as given.

    Source: firmware/DESIGN.md, "On a Cortex-M7": measured, rounded up, not derived; ticks of paths stay below.
    """
    library = _table()["library"]
    return np.asarray(library["tick_instructions"] + library["work_instructions"] * work)


def _periods_s(path: Trajectory) -> list[float]:
    periods_s: list[float] = np.diff(path.t_s, prepend=path.t_s[0] - path.first_period_s).tolist()
    return periods_s


def within_ticks(scene: Scene, path: Trajectory, work: int, clock_Hz: float) -> Ticks:
    """Ticks of a path that search for themselves: `work` each and the step that ends it.   Cost: 50 us a tick."""
    world = World(scene, ReplayOptions(lookups_max=work))
    did, late = np.zeros(len(path), dtype=np.int64), np.zeros(len(path), dtype=np.int64)
    for i, (row, period_s) in enumerate(zip(path.rows, _periods_s(path), strict=True)):
        out = world.tick(row[1:], period_s)
        did[i], late[i] = out.stats.work, out.stats.late_ticks
    cost = instructions_of(did)
    p50, p99 = (int(np.quantile(cost, q, method="higher")) for q in (0.5, 0.99))
    most = int(cost.max())
    return Ticks(
        path.source,
        len(path),
        p50,
        p99,
        most,
        most / clock_Hz,
        float(late.mean()),
        int(late.max()),
    )


def beside_ticks(scene: Scene, path: Trajectory, clock_Hz: float) -> Beside:
    """Ticks of a path that only feel, and a search of one step after the other in the time between them.

    Each period has the instructions of a tick that takes all of it; a step that takes longer goes on in the next one.
    Cost: 50 us a tick.
    """
    library = _table()["library"]
    world, out, pose = World(scene), ffi.new("cr_output *"), ffi.new("cr_pose *")
    each, fixed = library["work_instructions"], library["tick_instructions"]
    late, left = np.zeros(len(path), dtype=np.int64), 0.0
    for i, (row, period_s) in enumerate(zip(path.rows, _periods_s(path), strict=True)):
        x, y, z, *rot = row[1:].tolist()
        pose.pos_m, pose.rot = (x, y, z), rot
        lib.cr_feel(world.handle, pose, period_s, out)
        late[i] = out.stats.late_ticks
        left = min(left, 0.0) + clock_Hz * period_s - fixed
        while left > 0.0 and (did := int(lib.cr_search(world.handle, 1))) > 0:
            left -= each * did
    feel = library["feel_instructions"]
    return Beside(feel, feel / clock_Hz, float(late.mean()), int(late.max()))


def cost_of(
    scene: Scene, name: str, work: int = BOARD_WORK, path: Trajectory | None = None
) -> Cost:
    """What a scene takes of a controller that ticks with `work` units, along a path where there is one.

    Errors: SceneError for an unknown device, or settings that the firmware refuses.
    """
    device, library = find_device(name), _table()["library"]
    most = int(instructions_of(np.array([work]))[0])
    step = int(library["step_work"] * library["work_instructions"])
    return Cost(
        device,
        len(scene.image),
        library["servo_bytes"] + library["group_bytes"] * int(scene.handle.group_count),
        work,
        most,
        step,
        (most + step) / device.clock_Hz,
        None if path is None else within_ticks(scene, path, work, device.clock_Hz),
        None if path is None else beside_ticks(scene, path, device.clock_Hz),
    )
