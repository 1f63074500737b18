"""What a scene costs on a controller: flash, RAM, and instructions of a tick."""

from __future__ import annotations

import tomllib
from dataclasses import asdict, dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.base.errors import SceneError
from crease.base.scene import Scene
from crease.replay.replay import ReplayOptions, World
from crease.replay.trajectory import Trajectory

BOARD_WORK = 40
"""Units of work in a tick that fits an STM32H743 (firmware/DESIGN.md, "A tick that fits")."""
PERIOD_S = 1e-3


@dataclass(frozen=True)
class Device:
    """A controller. flash_bytes 0: it has none, the image lies in RAM."""

    name: str
    core: str
    clock_Hz: float
    flash_bytes: int
    ram_bytes: int
    code_bytes: int
    stack_bytes: int


@dataclass(frozen=True)
class Ticks:
    """Along a path: instructions at most (50th, 99th percentile, largest), and how many ticks late the answers are."""

    path: str
    ticks: int
    p50: int
    p99: int
    most: int
    late_mean: float
    late_most: int


@dataclass(frozen=True)
class Cost:
    """Bytes in flash and in RAM. instructions: of any tick with so much work; largest_s: at one instruction a cycle."""

    device: Device
    flash_bytes: int
    ram_bytes: int
    work: int
    instructions: int
    largest_s: float
    along: Ticks | None = None

    @property
    def fits(self) -> bool:
        """Whether flash and RAM are enough."""
        device = self.device
        return self.ram_bytes <= device.ram_bytes and (
            device.flash_bytes == 0 or self.flash_bytes <= device.flash_bytes
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
        1024 * entry["flash_KiB"],
        1024 * entry["ram_KiB"],
        core["code_bytes"],
        core["stack_bytes"],
    )


def instructions_of(work: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Bound of the instructions of ticks that did so much work; shape as given.

    Source: firmware/DESIGN.md, "On a Cortex-M7": measured, rounded up, not derived.
    """
    library = _table()["library"]
    return np.asarray(library["tick_instructions"] + library["work_instructions"] * work)


def along_path(scene: Scene, path: Trajectory, work: int) -> Ticks:
    """The work of each tick of a path, no more than `work` each and one step.   Cost: 50 us a tick."""
    world = World(scene, ReplayOptions(lookups_max=work))
    periods_s = np.diff(path.t_s, prepend=path.t_s[0] - path.first_period_s)
    did, late = np.zeros(len(path), dtype=np.int64), np.zeros(len(path), dtype=np.int64)
    for i, (row, period_s) in enumerate(zip(path.rows, periods_s.tolist(), strict=True)):
        stats = world.tick(row[1:], period_s).stats
        did[i], late[i] = stats.work, stats.late_ticks
    cost = instructions_of(did)
    p50, p99 = (int(np.quantile(cost, q, method="higher")) for q in (0.5, 0.99))
    return Ticks(
        path.source, len(path), p50, p99, int(cost.max()), float(late.mean()), int(late.max())
    )


def cost_of(
    scene: Scene, name: str, work: int = BOARD_WORK, path: Trajectory | None = None
) -> Cost:
    """What a scene takes of a controller that ticks with `work` units at most.

    Errors: SceneError for an unknown device, or settings that the firmware refuses.
    """
    device, library = find_device(name), _table()["library"]
    groups = int(scene.handle.group_count)
    state = library["servo_bytes"] + library["group_bytes"] * groups
    image = len(scene.image)
    in_flash = device.flash_bytes > 0
    most = int(instructions_of(np.array([work]))[0])
    along = None if path is None else along_path(scene, path, work)
    largest = most if along is None else max(most, along.most)
    return Cost(
        device,
        (device.code_bytes + image) if in_flash else 0,
        state + device.stack_bytes + (0 if in_flash else device.code_bytes + image),
        work,
        most,
        largest / device.clock_Hz,
        along,
    )
