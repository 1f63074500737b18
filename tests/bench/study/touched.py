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
HEADS = ("scene", "ticks in contact", "p50, KiB", "p99, KiB", "max, KiB", "most of it at p99")


def build_counter(program: Path) -> Path:
    """Errors: CreaseError, with the compiler's first line; it has to be gcc."""
    return build(program, COUNTED, "touched.c")


def count(
    program: Path, scene: Scene, path: Trajectory, options: ReplayOptions
) -> npt.NDArray[Any]:
    """Lines read in each tick, ROW (n,).   Errors: CreaseError."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        words = words_for(program, folder, scene.image, path.rows, options)
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise CreaseError(f"{scene.source}, counted: {done.stderr.strip()}")
        return np.fromfile(folder / "rows", ROW)


def bytes_of(rows: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
    """Bytes of each tick."""
    return np.asarray(LINE * (rows["lines"].sum(axis=1, dtype=np.int64) + rows["rest"]))


def row_of(name: str, rows: npt.NDArray[Any]) -> tuple[object, ...]:
    """A line of the table: over the ticks in contact."""
    touching = rows[rows["contacts"] > 0]
    if len(touching) == 0:
        return name, 0, "", "", "", ""
    sizes = bytes_of(touching) / 1024
    p50, p99 = np.percentile(sizes, [50, 99])
    near = touching[np.abs(sizes - p99) <= 0.02 * p99]["lines"].mean(axis=0) * LINE / 1024
    most = [f"{SECTIONS[i][1]} {near[i]:.1f}" for i in np.argsort(-near)[:3]]
    return name, len(touching), f"{p50:.1f}", f"{p99:.1f}", f"{sizes.max():.1f}", ", ".join(most)


def run(setup: BenchSetup) -> Result:
    """A row for each scene of meshes/scenes.toml, or for those that are named.   Errors: CreaseError."""
    result = Result(
        "touched",
        "Bytes of the image that a tick reads",
        f"Distinct lines of {LINE} bytes in a tick, over the ticks in contact, lane by lane as a Cortex-M runs it. "
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
            found = count(program, scene, setup.path(spec.path.stem), ReplayOptions())
            rows.append(row_of(name, found))
            write_counts(setup, result, name, found)
    result.tables.append(Table("Lines of the image", HEADS, text_rows(rows)))
    over = [f"{row[0]} {row[3]} KiB" for row in rows if float(str(row[3] or 0)) > GOAL_KIB]
    result.found.append(
        f"more than {GOAL_KIB:g} KiB at p99: {', '.join(over)}"
        if over
        else f"every scene reads at most {GOAL_KIB:g} KiB at p99"
    )
    return result


def write_counts(setup: BenchSetup, result: Result, name: str, rows: npt.NDArray[Any]) -> None:
    """A CSV with a row a tick: bytes by section, and what the tick looked at."""
    columns = {f"{word}_bytes": LINE * rows["lines"][:, i] for i, (_, word) in enumerate(SECTIONS)}
    columns |= {word: rows[word] for word in ("contacts", "nodes", "points")}
    setup.write_csv(result, f"touched_{name}.csv", {"bytes": bytes_of(rows), **columns})
