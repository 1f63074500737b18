"""The closed-loop golden: servo and simulated drives, with limits that act, a fault, and a second start."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from crease.base.native import ffi, lib
from crease.base.scene import Scene, open_scene
from crease.bus.drives import Fault
from crease.loop.hil import Loop, hand_targets, lead_in
from crease.replay.recording import Recording, recording_bytes, scene_crc32
from crease.replay.trajectory import Trajectory, check_rows

DOWN_TICKS, ALONG_TICKS = 250, 250
FAULT_AFTER_TICKS = 350
BRING_UP_MAX_TICKS = 3000


def press_and_slide(top_m: float, depth_m: float) -> Trajectory:
    """The tool comes down until it is depth_m deep, slides, turns a little, and leaves."""
    down = np.linspace([0.0, 0.0, top_m + 0.004], [0.0, 0.0, top_m - depth_m], DOWN_TICKS)
    along = np.linspace(down[-1], down[-1] + [0.006, 0.004, 0.0], ALONG_TICKS)
    position_m = np.concatenate([down, along, along[::-1], down[::-1]])
    t = np.arange(len(position_m)) * 1e-3
    half = 0.02 * np.sin(2.0 * np.pi * t)
    turn = np.column_stack([np.cos(half), np.sin(half), 0.0 * t, 0.0 * t])
    return check_rows(np.column_stack([t, position_m, turn]), "press and slide")


def _until(loop: Loop, modes: tuple[int, ...], target: list[float]) -> None:
    for _ in range(BRING_UP_MAX_TICKS):
        if loop.mode in modes:
            return
        loop.tick(target)
    raise AssertionError(f"mode {loop.mode} after {BRING_UP_MAX_TICKS} ticks")


def closed_loop(scene: Scene, path: Trajectory) -> Recording:
    """Limits on force, rate and power that act; frames that get lost; the bus goes off; clear; up again."""
    config = ffi.new("cr_servo_config *", lib.cr_servo_config_default())
    config.world.stiffness_N_m = 2000.0
    config.world.damping_Ns_m = 3.0
    config.control.force_max_N = 2.0
    config.control.force_rate_max_N_s = 150.0
    config.control.power_max_W = 0.03
    lost = [Fault("drop", tick, 2, 1, id=0x192) for tick in (1280, 2600)]
    loop = Loop(scene, config, faults=lost)
    targets = hand_targets(path, loop.config)
    loop.bring_up(lead_in(targets, loop.drives.state.tip_pos_m))
    loop.command(int(lib.CR_COMMAND_START))
    for target in targets[:FAULT_AFTER_TICKS].tolist():
        loop.tick(target)
    loop.command(int(lib.CR_INPUT_BUS_OFF))
    rest = targets[FAULT_AFTER_TICKS].tolist()
    for _ in range(50):
        loop.tick(rest)
    assert loop.mode == lib.CR_MODE_FAULT
    loop.command(int(lib.CR_COMMAND_CLEAR))
    loop.tick(rest)
    _until(loop, (int(lib.CR_MODE_IDLE),), rest)
    loop.command(int(lib.CR_COMMAND_START))
    for target in targets[FAULT_AFTER_TICKS:].tolist():
        loop.tick(target)
    return loop.result(0).recording


def golden_recording(scene_path: Path) -> bytes:
    """The bytes of a recording of the above, checked to hold what it should.   Cost: about 3 s."""
    scene = open_scene(scene_path)
    recording = closed_loop(scene, press_and_slide(0.030, 0.003))
    rows = recording.rows
    assert recording.scene_crc32 == scene_crc32(scene)
    modes = set(rows["mode"].tolist())
    assert modes >= {int(lib.CR_MODE_IDLE), int(lib.CR_MODE_RENDERING), int(lib.CR_MODE_LIMITED)}
    assert int(lib.CR_MODE_FAULT) in modes
    assert np.count_nonzero(rows["areas"]) > 300
    acted = np.bitwise_or.reduce(rows["limits"])
    assert acted & lib.CR_LIMIT_FORCE
    assert acted & lib.CR_LIMIT_RATE
    assert acted & lib.CR_LIMIT_STALE
    return recording_bytes(rows, recording.config, scene)
