"""How many bytes of the image a tick reads: distinct lines of 32 bytes, by a build that sees every access to memory."""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from crease.bake.scene_list import load_specs
from crease.base.errors import CreaseError
from crease.base.native import lib
from crease.base.scene import Scene
from crease.lab.setup import Result, Table, text_rows
from crease.replay.cost import BOARD_WORK
from crease.replay.replay import ReplayOptions
from crease.replay.trajectory import Trajectory

from study.against_exact import BenchSetup
from study.program import ROOT, build, words_for

LINE = 32
"""Bytes that external flash gives at a time."""
GOAL_KIB = 32.0
SECTIONS = sorted(
    (int(getattr(lib, name)), name.removeprefix("CR_SEC_").lower())
    for name in dir(lib)
    if name.startswith("CR_SEC_") and name != "CR_SEC_COUNT"
)
COUNTED = (
    *("-O2", "-DCR_SCALAR=1", "-fsanitize=kernel-address"),
    *("--param=asan-instrumentation-with-call-threshold=0", "--param=asan-stack=0"),
    "--param=asan-globals=0",
)
"""Lane by lane, as a Cortex-M runs it, a call before every access to memory, and no guards round variables."""
ROW = np.dtype(
    [("lines", "<u4", (len(SECTIONS),)), ("rest", "<u4")]
    + [(name, "<u4") for name in ("contacts", "nodes", "points")]
)
"""struct touched of tests/bench/touched.c."""
QUICK = ("edge90_cube",)
HEADS = (
    *("scene", "ticks in contact", "p50, KiB", "p99, KiB", "max, KiB", "most of it at p99"),
    *(f"{BOARD_WORK} units: p50, KiB", "p99, KiB", "max, KiB"),
)


def build_counter(program: Path) -> Path:
    """Errors: CreaseError, with the compiler's first line; it has to be gcc."""
    return build(program, COUNTED, "touched.c")


def count(
    program: Path, scene: Scene, path: Trajectory, work: int | None = None
) -> npt.NDArray[Any]:
    """Lines read in each tick, ROW (n,). work: of a tick, in units; None: as much as the answer takes.

    Errors: CreaseError.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        words = words_for(program, folder, scene.image, path.rows, ReplayOptions())
        words += [] if work is None else [str(work)]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise CreaseError(f"{scene.source}, counted: {done.stderr.strip()}")
        return np.fromfile(folder / "rows", ROW)


def bytes_of(rows: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
    """Bytes of each tick."""
    return np.asarray(LINE * (rows["lines"].sum(axis=1, dtype=np.int64) + rows["rest"]))


def _percentiles(sizes: npt.NDArray[np.float64]) -> tuple[str, str, str]:
    p50, p99 = np.percentile(sizes, [50, 99])
    return f"{p50:.1f}", f"{p99:.1f}", f"{sizes.max():.1f}"


def row_of(name: str, rows: npt.NDArray[Any], slices: npt.NDArray[Any]) -> tuple[object, ...]:
    """A line of the table: over the poses in contact, with the answer in one tick and with BOARD_WORK a tick."""
    touching = rows["contacts"] > 0
    if not touching.any():
        return name, 0, *[""] * (len(HEADS) - 2)
    sizes, lines = bytes_of(rows[touching]) / 1024, rows["lines"][touching]
    p99 = np.percentile(sizes, 99)
    near = lines[np.abs(sizes - p99) <= 0.02 * p99].mean(axis=0) * LINE / 1024
    most = ", ".join(f"{SECTIONS[i][1]} {near[i]:.1f}" for i in np.argsort(-near)[:3])
    cut = _percentiles(bytes_of(slices[touching]) / 1024)
    return name, len(sizes), *_percentiles(sizes), most, *cut


def run(setup: BenchSetup) -> Result:
    """A row for each scene of meshes/scenes.toml, or for those that are named.   Errors: CreaseError."""
    result = Result(
        "touched",
        "Bytes of the image that a tick reads",
        f"Distinct lines of {LINE} bytes in a tick, over the poses in contact, lane by lane as a Cortex-M runs it: "
        f"with the whole answer in one tick, and with {BOARD_WORK} units of work a tick, as the boards do it. "
        f"External flash is ten times slower than memory on the chip: at most {GOAL_KIB:g} KiB at p99 is wanted.",
    )
    specs = load_specs(ROOT / "meshes/scenes.toml", setup.meshes)
    if unknown := [name for name in setup.scenes if name not in specs]:
        raise CreaseError(f"no scene {', '.join(unknown)}; there are {', '.join(specs)}")
    names = setup.scenes or (QUICK if setup.quick else tuple(specs))
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        program = build_counter(Path(folder) / "touched")
        for name in names:
            spec = specs[name]
            scene = setup.scene(
                spec.static.stem, spec.tool.stem, 1e3 * spec.voxel_m, 1e3 * spec.spacing_m
            )
            path = setup.path(spec.path.stem)
            found = count(program, scene, path)
            rows.append(row_of(name, found, count(program, scene, path, BOARD_WORK)))
            write_counts(setup, result, name, found)
    result.tables.append(Table("Lines of the image", HEADS, text_rows(rows)))
    result.found += [
        _verdict(rows, 3, "the answer in one tick"),
        _verdict(rows, 7, f"{BOARD_WORK} units a tick"),
    ]
    return result


def _verdict(rows: list[tuple[object, ...]], column: int, what: str) -> str:
    """Which scenes read more than the goal."""
    over = [f"{row[0]} {row[column]}" for row in rows if float(str(row[column] or 0)) > GOAL_KIB]
    said = f"more than {GOAL_KIB:g} KiB at p99: {', '.join(over)}"
    return f"{what}: {said if over else f'every scene reads at most {GOAL_KIB:g} KiB at p99'}"


def write_counts(setup: BenchSetup, result: Result, name: str, rows: npt.NDArray[Any]) -> None:
    """A CSV with a row a tick: bytes by section, and what the tick looked at."""
    columns = {f"{word}_bytes": LINE * rows["lines"][:, i] for i, (_, word) in enumerate(SECTIONS)}
    columns |= {word: rows[word] for word in ("contacts", "nodes", "points")}
    setup.write_csv(result, f"touched_{name}.csv", {"bytes": bytes_of(rows), **columns})
