"""Replays as one block of bytes each (tests/check/job.h), for programs that run them on any target."""

from __future__ import annotations

import json
import struct
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from crease.bake.bake import bake_scene
from crease.base.native import ffi, lib
from crease.lab.setup import image_options
from crease.mesh.mesh import load_mesh
from crease.replay.trajectory import Trajectory, load_trajectory

ROOT = Path(__file__).resolve().parents[2]
FIRMWARE_C = [
    p for room in ("contact", "servo") for p in sorted((ROOT / "firmware" / room).glob("*.c"))
]
"""All that a device library is made of."""
COUPLE_C = sorted((ROOT / "firmware/couple").glob("*.c"))
"""And the one beside it."""
PATH, RECORDING, STEPS, HELD = 0, 1, 2, 3
_CONFIG_AT = 64
_ALIGN = 64


def _align(size: int) -> int:
    return -(-size // _ALIGN) * _ALIGN


def make_job(kind: int, scene: bytes, data: bytes, config: bytes = b"") -> bytes:
    """The block: head, settings, scene, data."""
    scene_at = _align(_CONFIG_AT + len(config) + _ALIGN)
    data_at = _align(scene_at + len(scene))
    head = struct.pack("<8s5I", b"CRJOB001", kind, scene_at, len(scene), data_at, len(data))
    block = bytearray(data_at + len(data))
    block[: len(head)] = head
    block[_CONFIG_AT : _CONFIG_AT + len(config)] = config
    block[scene_at : scene_at + len(scene)] = scene
    block[data_at:] = data
    return bytes(block)


def path_rows(path: Trajectory) -> npt.NDArray[np.float32]:
    """Poses and periods as the firmware takes them: (n, 8), position, quaternion, period."""
    period_s = np.diff(path.t_s, prepend=path.t_s[0] - path.first_period_s)
    return np.column_stack([path.rows[:, 1:], period_s]).astype("<f4")


def path_job(
    scene: bytes, rows: npt.NDArray[np.float32], kind: int = PATH, **settings: float
) -> bytes:
    """A path through a scene, of kind PATH or STEPS; settings: members of cr_config beside the defaults."""
    config = ffi.new("cr_config *", lib.cr_config_default())
    for name, value in settings.items():
        setattr(config, name, value)
    return make_job(kind, scene, rows.astype("<f4").tobytes(), bytes(ffi.buffer(config)))


def held_job(scene: bytes, rows: npt.NDArray[np.float32], springs: tuple[float, float]) -> bytes:
    """The path of a hand that holds the tool by springs, N/m and N m/rad."""
    config = ffi.new("cr_config *", lib.cr_config_default())
    couple = ffi.new("cr_couple_config *", lib.cr_couple_config_default())
    couple.stiffness_N_m, couple.stiffness_Nm_rad = springs
    settings = bytes(ffi.buffer(config)) + bytes(ffi.buffer(couple))
    return make_job(HELD, scene, rows.astype("<f4").tobytes(), settings)


def recording_job(scene: bytes, recording: bytes) -> bytes:
    """A recording of the servo, run again."""
    return make_job(RECORDING, scene, recording)


def golden_path_job(scene: str, **settings: Any) -> bytes:
    """One of meshes/scenes.toml with its own path, from build/."""
    image = (ROOT / "build" / "scenes" / f"{scene}.crs").read_bytes()
    path = load_trajectory(ROOT / "build" / "meshes" / f"{scene}.csv")
    return path_job(image, path_rows(path), **settings)


@cache
def golden_held_jobs(name: str) -> tuple[bytes, bytes]:
    """One of meshes/six with its own path, springs and image, from build/: held, and by the direct force."""
    folder = ROOT / "build" / "meshes" / "six"
    spec = json.loads((folder / f"{name}.json").read_text("utf-8"))
    static, tool = (load_mesh(folder / spec[part], 1e-3) for part in ("static", "tool"))
    springs = spec["spring"]["stiffness_N_m"], spec["spring"]["stiffness_Nm_rad"]
    scene = bake_scene(static, tool, image_options(spec["image"])).image
    rows = path_rows(load_trajectory(folder / f"{name}.csv"))
    return held_job(scene, rows, springs), path_job(scene, rows)


def free_rows(ticks: int = 300) -> npt.NDArray[np.float32]:
    """The tool in free space, 0.2 to 0.5 m above the object, moving and turning as a hand does."""
    t = np.arange(ticks) * 1e-3
    half = 0.3 * np.sin(2.0 * np.pi * t)
    z = 0.35 + 0.15 * np.cos(2.0 * np.pi * t)
    zero = 0.0 * t
    columns = [0.05 * np.sin(7.0 * t), zero, z, np.cos(half), np.sin(half), zero, zero, zero + 1e-3]
    return np.column_stack(columns).astype("<f4")
