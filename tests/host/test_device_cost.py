"""`crease info --device`: its figures are those that were measured, and what does not fit is said."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from check import COST_FIXED, COST_WORK, read_budgets
from crease.base.native import ffi, lib
from crease.base.scene import open_scene
from crease.base.units import parse_size
from crease.replay.cost import (
    BOARD_LATE_MAX,
    BOARD_WORK,
    PERIOD_S,
    beside_ticks,
    cost_of,
    device_names,
    find_device,
    instructions_of,
    within_ticks,
)
from crease.replay.replay import World
from crease.replay.trajectory import load_trajectory
from host_tools import Run
from worst import BOARD_LOOKUPS, read_poses

ROOT = Path(__file__).resolve().parents[2]
PORT = ROOT / "firmware" / "port" / "cortex-m7"
DEEP = {
    "part_spanner": [
        *(0.0662186789, 0.0072077554, 0.0041613122),
        *(-0.1374795374, 0.6222531507, 0.7231234244, -0.2664449405),
    ],
    "cylinder_ball": [
        *(-0.0153860699, -0.0490284021, -0.0138036511),
        *(-0.999862683, -0.0110811306, -0.0114404359, -0.00457605983),
    ],
    "bar_u": [
        *(0.000366395051, -0.0388560042, 0.000144285712),
        *(-0.0741277952, 0.835253361, 0.0636686103, 0.541112928),
    ],
}
"""Poses of the longest steps that were found, by search over deep ones."""
STEP_WORK = 14
"""Units of the longest: a half-space of a hit."""
MANY_SURFACES = [
    *(-0.0483156793, 0.0241204067, 0.0264952154),
    *(0.3741173558, -0.0854342292, 0.1434040570, 0.9122350936),
]
"""Deep in `part_spanner`: 4,605 units of work for an answer."""


def test_code_and_stack_are_those_of_the_page_of_memory() -> None:
    page = (ROOT / "firmware" / "MEMORY.md").read_text("utf-8")
    for name in device_names():
        device = find_device(name)
        row = re.search(rf"^\| {device.core} \|(.*)$", page, re.MULTILINE)
        assert row is not None, device.core
        code, _, stack, beside, *_ = (
            int(cell.replace(",", "")) for cell in row[1].strip(" |").split("|")
        )
        assert (device.code_bytes, device.stack_bytes) == (code, stack)
        assert device.beside_stack_bytes == beside > stack


def test_ticks_are_reckoned_as_check_device_holds_them(scene_crs: Path, press_csv: Path) -> None:
    assert instructions_of(np.array([0, 40])).tolist() == [COST_FIXED, COST_FIXED + 40 * COST_WORK]
    (feel,) = (row for row in read_budgets() if row["what"] == "feel of all replays max")
    cost = cost_of(open_scene(scene_crs), "stm32h743", path=load_trajectory(press_csv))
    assert cost.beside is not None
    assert cost.beside.feel == int(feel["budget"])


def test_feel_at_10_kHz_takes_less_than_a_fifth_of_an_m7() -> None:
    """By the budget that `make check-device` holds every feel of every replay to."""
    (feel,) = (row for row in read_budgets() if row["what"] == "feel of all replays max")
    assert int(feel["budget"]) * 10e3 < 0.2 * find_device("stm32h743").clock_Hz


def linked(board: str) -> dict[str, int]:
    """KiB of each memory of a linker script, and of the stack."""
    text = (PORT / f"{board}.ld").read_text("ascii")
    found = re.findall(r"^ +(\w+) \(\w+\) : .*LENGTH = (\d+)([KM])$", text, re.MULTILINE)
    sizes = {name: int(size) * {"K": 1, "M": 1024}[unit] for name, size, unit in found}
    (stack,) = re.findall(r"^STACK_BYTES = (\d+)K;$", text, re.MULTILINE)
    return sizes | {"stack": int(stack)}


def test_room_of_a_board_is_what_its_linker_script_and_its_loop_leave() -> None:
    loop = (PORT / "controller.c").read_text("ascii")
    (memory,) = re.findall(r"^#define MEMORY_BYTES \((\d+)u \* 1024u\)$", loop, re.MULTILINE)
    device, sizes = find_device("stm32h743"), linked("stm32h743")
    assert device.scene_bytes == 1024 * sizes["SCENE"]
    assert device.memory_bytes == 1024 * int(memory)
    assert int(memory) + sizes["stack"] < sizes["RAM"]
    assert device.code_bytes < 1024 * sizes["CODE"]
    device, sizes = find_device("mps3-an547"), linked("mps3-an547")
    assert device.scene_bytes == 1024 * sizes["SCENE"]
    assert device.memory_bytes == 1024 * (sizes["RAM"] - sizes["stack"])


def test_groups_that_the_loop_says_it_has_memory_for_are_those_that_fit(scene_crs: Path) -> None:
    loop = (PORT / "controller.c").read_text("ascii")
    (told,) = re.findall(r"/\* A servo and a world with (\d+) groups", loop)
    scene = open_scene(scene_crs)
    cost, groups = cost_of(scene, "stm32h743"), int(scene.handle.group_count)
    each = 64
    assert (cost.device.memory_bytes - cost.memory_bytes) // each == int(told) - groups


def test_sizes_that_pages_propose_for_a_scene_fit_the_board() -> None:
    room = find_device("stm32h743").scene_bytes
    places = ("README.md", "host/docs/my_board.md", "host/crease/verbs/bake.py")
    for place in (*places, "firmware/package/man/crease.1.in"):
        said = re.findall(r"\b[\d.]+MiB\b", (ROOT / place).read_text("utf-8"))
        assert said, place
        assert all(0.99 * room < parse_size(size) <= room for size in said), place


def test_ram_is_what_the_library_asks_for(scene_crs: Path) -> None:
    """The extension is compiled as the library ships."""
    config = ffi.new("cr_servo_config *", lib.cr_servo_config_default())
    for path in (scene_crs, ROOT / "build" / "scenes" / "part_spanner.crs"):
        scene = open_scene(path)
        cost = cost_of(scene, "stm32h743")
        size = lib.cr_servo_size(scene.handle, config)
        assert cost.memory_bytes == size


def test_part_that_there_is_no_room_for_is_said(crease: Run) -> None:
    spanner, cube = (
        ROOT / "build" / "scenes" / f"{n}.crs" for n in ("part_spanner", "edge90_cube")
    )
    assert (
        "of 1,920 KiB (scene): DOES NOT FIT" in crease("info", spanner, "--device", "stm32h743").out
    )
    said = crease("info", cube, "--device", "STM32H743").out
    assert "DOES NOT FIT" not in said
    assert "Cortex-M7, 480 MHz" in said
    assert not crease("info", spanner, "--device", "stm32h743", "--json").json["device"]["fits"]


def test_verdict_is_by_the_room_that_is_left_for_a_scene(scene_crs: Path) -> None:
    """Not by the flash: code lies there too."""
    cost = cost_of(open_scene(scene_crs), "stm32h743")
    room, memory = cost.device.scene_bytes, cost.device.memory_bytes
    assert replace(cost, scene_bytes=room).fits
    assert not replace(cost, scene_bytes=room + 1).fits
    assert replace(cost, memory_bytes=memory).fits
    assert not replace(cost, memory_bytes=memory + 1).fits


def test_ticks_of_a_path_are_counted(scene_crs: Path, press_csv: Path, crease: Run) -> None:
    few = crease(
        "info", scene_crs, "--device", "stm32f407", "--path", press_csv, "--work", 32, "--json"
    ).json["device"]
    many = crease(
        "info", scene_crs, "--device", "stm32f407", "--path", press_csv, "--work", 8192, "--json"
    ).json["device"]
    assert few["within"]["ticks"] == many["within"]["ticks"] == 400
    assert many["within"]["late_most"] == 0
    assert few["within"]["late_most"] > 0
    within = few["within"]
    assert COST_FIXED < within["p50"] <= within["p99"] <= within["most"]
    assert within["most"] < many["within"]["most"]
    assert within["largest_s"] == pytest.approx(within["most"] / 168e6)
    assert within["most"] > few["instructions"], "the step that ends a tick counts"


def test_search_beside_the_ticks_is_told_too(scene_crs: Path, press_csv: Path) -> None:
    """Answers are a tick late at best, later on a slower controller, and never where it has no time."""
    scene, path = open_scene(scene_crs), load_trajectory(press_csv)
    fast, slow, none = (beside_ticks(scene, path, clock) for clock in (1e10, 40e6, 1e6))
    assert 0.99 < fast.late_mean <= 1.0
    assert fast.late_most == 1
    assert fast.late_mean < slow.late_mean < none.late_mean
    assert none.late_most == len(path)
    assert slow.largest_s == pytest.approx(slow.feel / 40e6)


def controller_rows() -> list[list[str]]:
    """Cells of the table of README.md, by name."""
    scene = open_scene(ROOT / "build" / "scenes" / "edge90_cube.crs")
    path = load_trajectory(ROOT / "build" / "meshes" / "edge90_cube.csv")
    rows = []
    for name in device_names():
        cost = cost_of(scene, name, path=path)
        assert cost.within is not None
        assert cost.beside is not None
        room = f"{cost.device.scene_bytes // 1024:,} KiB"
        row = [f"`{name}`", room if cost.fits else f"{room}, too small"]
        for along in (cost.within, cost.beside):
            row += [
                f"{1e3 * along.largest_s:.2f} ms",
                "yes" if along.largest_s <= PERIOD_S else "no",
                f"{along.late_mean:.1f} / {along.late_most}",
            ]
        rows.append(row)
    return rows


@pytest.mark.slow
def test_answers_later_than_the_boards_bear_are_told(crease: Run) -> None:
    board = (ROOT / "firmware/port/cortex-m7/board.h").read_text("utf-8")
    assert f"#define BOARD_LATE_MAX_TICKS {BOARD_LATE_MAX}u" in board
    scene, path = (
        ROOT / "build" / name for name in ("scenes/edge90_cube.crs", "meshes/edge90_cube.csv")
    )
    for device, too_late in (("mps3-an547", 1), ("stm32h743", 0)):
        said = crease("info", scene, "--device", device, "--path", path)
        assert said.out.count("TOO LATE, the boards fault beyond 50") == too_late


def test_table_of_controllers_in_the_readme_is_what_info_tells() -> None:
    text = (ROOT / "README.md").read_text("utf-8")
    (table,) = re.findall(r"<!-- devices: begin -->\n(.*?)<!-- devices: end -->", text, re.DOTALL)
    head, _, *rows = (
        [c.strip() for c in line.strip("|").split("|")] for line in table.splitlines()
    )
    assert len(head) == 8
    assert rows == controller_rows()
    scene = open_scene(ROOT / "build" / "scenes" / "edge90_cube.crs")
    path = load_trajectory(ROOT / "build" / "meshes" / "edge90_cube.csv")
    assert f"`edge90_cube`: an image of {len(scene.image) / 1024:,.0f} KiB" in text
    assert f"counted work ({within_ticks(scene, path, BOARD_WORK, 1e6).most:,} here" in text


def longest_step(world: World, pose: list[float]) -> int:
    """Work of the longest step of the search at a pose."""
    out, at = ffi.new("cr_output *"), ffi.new("cr_pose *")
    at.pos_m, at.rot = pose[:3], pose[3:]
    world.reset()
    lib.cr_feel(world.handle, at, 1e-3, out)
    longest = 0
    while (did := int(lib.cr_search(world.handle, 1))) > 0:
        longest = max(longest, did)
    return longest


def test_longest_step_of_the_search_that_was_found_is_told(crease: Run) -> None:
    """The deepest poses: a tick may take all of it more, and info counts it; it calls nothing a bound."""
    found = []
    for name, pose in DEEP.items():
        world = World(open_scene(ROOT / "build" / "scenes" / f"{name}.crs"))
        found.append(longest_step(world, pose))
    spanner = ROOT / "build" / "scenes" / "part_spanner.crs"
    cost = crease("info", spanner, "--device", "stm32h743", "--json").json["device"]
    step = cost["step"] // COST_WORK
    assert 0.9 * step < max(found) <= step
    assert cost["largest_s"] == pytest.approx((cost["instructions"] + cost["step"]) / 480e6)
    said = crease("info", spanner, "--device", "stm32h743").out
    assert f"{cost['step']:,} at the deepest pose found, no bound" in said
    assert "at most" not in said


def test_answer_in_slices_takes_little_more_work_than_at_once() -> None:
    """A hit over many surfaces goes on where it was left. Begun anew in each slice it took 57,547 units here."""
    out, at = ffi.new("cr_output *"), ffi.new("cr_pose *")
    at.pos_m, at.rot = MANY_SURFACES[:3], MANY_SURFACES[3:]
    spent = {}
    for slice_work in (BOARD_LOOKUPS, 1 << 30):
        world = World(open_scene(ROOT / "build" / "scenes" / "part_spanner.crs"))
        lib.cr_feel(world.handle, at, 1e-3, out)
        steps = []
        while (did := int(lib.cr_search(world.handle, slice_work))) > 0:
            steps.append(did)
        spent[slice_work] = sum(steps), len(steps)
        assert len(steps) == 1 or max(steps) < BOARD_LOOKUPS + STEP_WORK
    (sliced, slices), (whole, _) = spent[BOARD_LOOKUPS], spent[1 << 30]
    assert slices > 10
    assert whole < sliced + slices  # what is left of a unit is lost at the end of each slice
    assert sliced < 1.15 * whole


def test_found_poses_take_no_more_than_is_told(crease: Run) -> None:
    """Those of `make worst`, measured on the emulator with the work of a board's tick."""
    cube = ROOT / "build" / "scenes" / "edge90_cube.crs"
    cost = crease("info", cube, "--device", "stm32h743", "--json").json["device"]
    worst = max(f.instructions for f in read_poses() if f.lookups == BOARD_LOOKUPS)
    assert worst <= cost["instructions"] + cost["step"]


def test_wrong_words_have_one_line(scene_crs: Path, press_csv: Path, crease: Run) -> None:
    said = crease("info", scene_crs, "--device", "z80")
    assert said.status == 2
    known = ", ".join(device_names())
    assert said.err == (
        f"error: --device: 'z80' is not known; use {known}; see `crease info --help`\n"
    )
    for option in (("--path", press_csv), ("--work", "50")):
        said = crease("info", scene_crs, *option)
        assert said.status == 2
        assert said.err.startswith(
            f"error: {option[0]}: counts ticks for a controller; name it with --device;"
        )
