"""The checks of `make check-device` can fail: each is shown something that is wrong."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from callgraph import CallGraphError, Graph, deepest, read_graph, worst_chain
from check import (
    FLAGS,
    Breaches,
    allowed_symbols,
    check_bound,
    check_budgets,
    undefined_symbols,
)
from crease.base.scene import open_scene
from crease.replay.trajectory import load_trajectory
from jobs import COUPLE_C, FIRMWARE_C, ROOT, path_job, path_rows
from runs import Run, read_counts
from worst import (
    ALL_LOOKUPS,
    BOARD_LOOKUPS,
    SCENES,
    TICKS,
    Counted,
    Found,
    climb,
    dearer,
    read_poses,
    write_poses,
)

EXTERNAL = {"memset": 32, "memcpy": 32}


def compile_c(folder: Path, name: str, text: str, *options: str) -> Path:
    """An object and its call graph from a few lines of C."""
    source = folder / f"{name}.c"
    source.write_text(text, encoding="ascii")
    words = [
        "gcc",
        "-c",
        "-O1",
        "-fcallgraph-info=su",
        *options,
        source,
        "-o",
        folder / f"{name}.o",
    ]
    subprocess.run([str(word) for word in words], check=True, cwd=folder)
    return folder / f"{name}.ci"


def test_recursion_through_two_files_is_found(tmp_path: Path) -> None:
    a = compile_c(tmp_path, "a", "int pong(int); int ping(int n) { return pong(n - 1) + 1; }")
    b = compile_c(tmp_path, "b", "int ping(int); int pong(int n) { return n ? ping(n) + 2 : 0; }")
    with pytest.raises(CallGraphError, match=r"recursion: p.ng -> p.ng -> p.ng"):
        worst_chain(read_graph([a, b], EXTERNAL))


def test_frame_of_variable_size_is_found(tmp_path: Path) -> None:
    text = "void use(char *); void vary(int n) { char room[n]; use(room); }"
    with pytest.raises(CallGraphError, match="vary: the size of its stack is dynamic"):
        read_graph([compile_c(tmp_path, "vla", text)], {"use": 8})


def test_call_through_a_pointer_is_found(tmp_path: Path) -> None:
    text = "int (*hook)(int); int poke(int n) { return hook(n) + 1; }"
    file = compile_c(tmp_path, "hook", text)
    with pytest.raises(CallGraphError, match="poke calls through a pointer"):
        read_graph([file], EXTERNAL)


def test_function_of_unknown_stack_is_found(tmp_path: Path) -> None:
    file = compile_c(
        tmp_path, "call", "int far_away(int); int near(int n) { return far_away(n) + 1; }"
    )
    with pytest.raises(CallGraphError, match="near calls far_away"):
        read_graph([file], EXTERNAL)


def test_chain_is_the_deepest_not_the_longest() -> None:
    frames = {"root": 10, "a": 5, "b": 5, "c": 5, "wide": 100}
    calls = {"root": {"a", "wide"}, "a": {"b"}, "b": {"c"}, "c": set(), "wide": set()}
    chain = deepest(Graph(frames, calls), "root")
    assert (chain.bytes, chain.functions) == (110, (("root", 10), ("wide", 100)))


def test_symbol_from_outside_is_found(tmp_path: Path) -> None:
    compile_c(tmp_path, "heap", "#include <stdlib.h>\nvoid *get(void) { return malloc(8); }")
    compile_c(tmp_path, "own", "void *get(void); void *twice(void) { return get() ? get() : 0; }")
    needed = undefined_symbols([tmp_path / "heap.o", tmp_path / "own.o"], nm="nm")
    assert needed == {"heap.o": ["malloc"], "own.o": []}
    assert "malloc" not in allowed_symbols()


def test_budget_that_is_exceeded_or_not_measured_is_a_breach() -> None:
    row = {"build": "m7", "what": "flash", "budget": "100", "target": "90", "unit": "bytes"}
    for value, expected in ((100, 0), (101, 1), (None, 1)):
        breaches = Breaches()
        check_budgets("m7", {} if value is None else {"flash": value}, [row], breaches)
        assert len(breaches.lines) == expected


def test_tick_beyond_the_bound_is_a_breach() -> None:
    counts = np.zeros((2, 17), dtype=np.uint32)
    for cost, expected in ((1_000, 0), (1_000_000, 1)):
        ticks = np.array([[cost, cost, 0, 0, 0, 0]] * 2)
        breaches = Breaches()
        check_bound("x", Run(("", ""), {}, ticks, ("tick",)), counts, breaches)
        assert len(breaches.lines) == expected


def test_ticks_that_were_not_counted_are_an_error() -> None:
    text = "stages tick detect\ntick 0 10 6 4\nfn 10 10 cr_tick\n"
    assert read_counts(("", ""), {"ticks": 1}, text).functions == (("cr_tick", 10, 10),)
    with pytest.raises(Exception, match="1 ticks were counted, 2 were run"):
        read_counts(("", ""), {"ticks": 2}, text)


@pytest.mark.slow
def test_another_rounding_gives_another_hash(tmp_path: Path) -> None:
    """One step of one constant: what a compiler that contracts or reorders would do to a product."""
    rows = path_rows(load_trajectory(ROOT / "build/meshes/edge90_sphere.csv"))[400:600]
    scene = (ROOT / "build/scenes/edge90_sphere.crs").read_bytes()
    job = tmp_path / "one.job"
    job.write_bytes(path_job(scene, rows))
    hashes = []
    for name in ("as it is", "off by one"):
        folder = tmp_path / name.replace(" ", "_")
        shutil.copytree(ROOT / "firmware", folder, ignore=shutil.ignore_patterns("port", "rivals"))
        if name == "off by one":
            feel = folder / "contact/feel.c"
            text, exact = feel.read_text("utf-8"), "config->stiffness_N_m * area->depth_m"
            assert text.count(exact) == 1
            feel.write_text(text.replace(exact, exact + " * 1.0000001f"), "utf-8")
        parts = [ROOT / f"tests/check/{part}.c" for part in ("replay_hash", "job", "blob")]
        firmware = FIRMWARE_C + COUPLE_C
        parts += [folder / path.relative_to(ROOT / "firmware") for path in firmware]
        includes = [f"-I{folder}", f"-I{ROOT / 'tests/check'}"]
        words = ["gcc", "-O1", *FLAGS, *includes, *parts, "-lm", "-o", folder / "runner"]
        subprocess.run([str(word) for word in words], check=True)
        said = subprocess.run([folder / "runner", job], capture_output=True, text=True, check=True)
        told = said.stdout.split()
        assert int(told[told.index("touching") + 1]) > 50
        hashes.append(told[told.index("answers") + 1])
    assert hashes[0] != hashes[1]


# ---------------------------------------------------------------------------------------------------- worst poses


def found(instructions: int = 1000) -> Found:
    """At a place of its own."""
    return Found("edge90_cube", BOARD_LOOKUPS, instructions, np.array([1e-3, 0, 2e-3, 1, 0, 0, 0]))


def test_a_climb_goes_up_and_never_down() -> None:
    top = np.array([3e-3, -2e-3, 1e-3])
    start = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])

    def cost(pose: npt.NDArray[np.float64]) -> int:
        return round(1e9 - 1e9 * float(np.linalg.norm(pose[:3] - top)))

    best, at = climb(start, cost, 10e-3, np.random.default_rng(1))
    assert best == cost(at)
    assert cost(start) < best
    assert np.linalg.norm(at[:3] - top) < 0.5 * np.linalg.norm(top)
    assert abs(np.linalg.norm(at[3:]) - 1.0) < 1e-9


def test_a_pose_that_takes_more_than_it_did_is_told() -> None:
    assert dearer([found()], [1020]) == []
    (line,) = dearer([found()], [1021])
    assert line.endswith("its worst pose takes 1,021 instructions, not 1,000")


def test_poses_are_kept_to_the_last_bit_of_a_float(tmp_path: Path) -> None:
    one = found()
    write_poses([one], tmp_path / "poses.csv")
    (again,) = read_poses(tmp_path / "poses.csv")
    assert (again.scene, again.lookups, again.instructions) == (one.scene, BOARD_LOOKUPS, 1000)
    assert (again.pose.astype(np.float32) == one.pose.astype(np.float32)).all()


def test_every_scene_has_its_worst_poses() -> None:
    kept = {(f.scene, f.lookups) for f in read_poses()}
    assert kept == {(scene, lookups) for scene in SCENES for lookups in TICKS}


def test_work_at_a_pose_does_not_depend_on_what_was_asked_before() -> None:
    scene = open_scene(ROOT / "build/scenes/edge90_cube.crs")
    poses = [f.pose for f in read_poses() if f.scene == "edge90_cube"]
    counted = Counted(scene, BOARD_LOOKUPS)
    once = [counted.work(pose) for pose in poses]
    assert [counted.work(pose) for pose in reversed(poses)] == once[::-1]
    assert max(once) > BOARD_LOOKUPS


def test_found_poses_are_dearer_than_the_paths() -> None:
    """A search that finds less than a replay would be none."""
    scene = open_scene(ROOT / "build/scenes/edge90_cube.crs")
    rows = path_rows(load_trajectory(ROOT / "build/meshes/edge90_cube.csv"))[::20, :7]
    (kept,) = (f.pose for f in read_poses() if f.scene == "edge90_cube" and f.lookups > 1000)
    counted = Counted(scene, ALL_LOOKUPS)
    assert counted.work(kept) > max(counted.work(row.astype(np.float64)) for row in rows)
