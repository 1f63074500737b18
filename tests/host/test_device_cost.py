"""`crease info --device`: its figures are those that were measured, and what does not fit is said."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from check import COST_FIXED, COST_WORK
from crease.base.native import ffi, lib
from crease.base.scene import open_scene
from crease.replay.cost import cost_of, device_names, find_device, instructions_of
from host_tools import Run

ROOT = Path(__file__).resolve().parents[2]


def test_code_and_stack_are_those_of_the_page_of_memory() -> None:
    page = (ROOT / "firmware" / "MEMORY.md").read_text("utf-8")
    for name in device_names():
        device = find_device(name)
        row = re.search(rf"^\| {device.core} \|(.*)$", page, re.MULTILINE)
        assert row is not None, device.core
        code, _, stack, *_ = (int(cell.replace(",", "")) for cell in row[1].strip(" |").split("|"))
        assert (device.code_bytes, device.stack_bytes) == (code, stack)


def test_bound_of_a_tick_is_the_one_that_check_device_holds() -> None:
    import numpy as np

    assert instructions_of(np.array([0, 40])).tolist() == [COST_FIXED, COST_FIXED + 40 * COST_WORK]


def test_ram_is_what_the_library_asks_for(scene_crs: Path) -> None:
    """The extension is compiled as the library ships."""
    config = ffi.new("cr_servo_config *", lib.cr_servo_config_default())
    for path in (scene_crs, ROOT / "build" / "scenes" / "part_spanner.crs"):
        scene = open_scene(path)
        cost = cost_of(scene, "stm32h743")
        size = lib.cr_servo_size(scene.handle, config)
        assert cost.ram_bytes - cost.device.stack_bytes == size


def test_part_that_is_too_large_for_flash_is_said(crease: Run) -> None:
    spanner, cube = (
        ROOT / "build" / "scenes" / f"{n}.crs" for n in ("part_spanner", "edge90_cube")
    )
    assert "of 2.00 MiB: DOES NOT FIT" in crease("info", spanner, "--device", "stm32h743").out
    said = crease("info", cube, "--device", "STM32H743").out
    assert "DOES NOT FIT" not in said
    assert "Cortex-M7, 480 MHz" in said
    assert not crease("info", spanner, "--device", "stm32h743", "--json").json["device"]["fits"]


def test_without_flash_all_of_it_is_in_ram(scene_crs: Path) -> None:
    device = find_device("mps3-an547")
    scene = open_scene(scene_crs)
    cost, other = cost_of(scene, "mps3-an547"), cost_of(scene, "stm32h743")
    own = other.ram_bytes - other.device.stack_bytes + device.stack_bytes
    assert cost.ram_bytes == own + device.code_bytes + len(scene.image)


def test_ticks_of_a_path_are_counted(scene_crs: Path, press_csv: Path, crease: Run) -> None:
    few = crease(
        "info", scene_crs, "--device", "stm32f407", "--path", press_csv, "--work", 32, "--json"
    ).json["device"]
    many = crease(
        "info", scene_crs, "--device", "stm32f407", "--path", press_csv, "--work", 8192, "--json"
    ).json["device"]
    assert few["along"]["ticks"] == many["along"]["ticks"] == 400
    assert many["along"]["late_most"] == 0
    assert few["along"]["late_most"] > 0
    assert COST_FIXED < few["along"]["p50"] <= few["along"]["p99"] <= few["along"]["most"]
    assert few["along"]["most"] < many["along"]["most"]
    assert few["largest_s"] == pytest.approx(few["along"]["most"] / 168e6)


def test_wrong_words_have_one_line(scene_crs: Path, press_csv: Path, crease: Run) -> None:
    said = crease("info", scene_crs, "--device", "z80")
    assert said.status == 1
    assert said.err == f"error: device 'z80' is not known; use {', '.join(device_names())}\n"
    said = crease("info", scene_crs, "--path", press_csv)
    assert said.status == 1
    assert "name it with --device" in said.err
