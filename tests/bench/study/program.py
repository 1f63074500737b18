"""A replay as a program of its own, built from the firmware's sources: to be counted, or in double precision."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from crease.bake.layout import RECORDS, pack, read_sections
from crease.base.errors import CreaseError
from crease.base.native import COVERAGES, RESPONSES
from crease.base.scene import Scene
from crease.replay.replay import DEFAULT_RESPONSE, ROW, ReplayOptions
from crease.replay.trajectory import Trajectory

ROOT = Path(__file__).resolve().parents[3]
FLAGS = ("-std=c11", "-D_POSIX_C_SOURCE=200809L", "-ffp-contract=off", "-fno-math-errno")
CORE = sorted((ROOT / "firmware/contact").glob("*.c"))
"""What a tick is made of: the servo round it keeps records of fixed size, which cannot be widened."""
WITH_RIVALS = "-DCR_RIVALS"
RIVALS = sorted((ROOT / "firmware/rivals").glob("*.c"))
"""What a build for another response has besides, and the option that it needs."""

COUNTED = ("-O2",)
"""No vectors beyond SSE2: what valgrind counts."""
IN_DOUBLE = ("-O3", "-march=native", "-include", str(ROOT / "tests/bench/widen.h"))


def widened(kind: np.dtype[Any]) -> np.dtype[Any]:
    """A record or number with float64 where it has float32, laid out as C lays it out."""
    if kind.subdtype is not None:
        return np.dtype((widened(kind.subdtype[0]), kind.subdtype[1]))
    if kind.fields is None:
        return np.dtype("<f8") if kind == np.dtype("<f4") else kind
    return np.dtype(
        [(name, widened(kind.fields[name][0])) for name in kind.names or ()], align=True
    )


ROW_IN_DOUBLE = widened(ROW)


def widen_image(scene: Scene) -> npt.NDArray[np.uint8]:
    """The scene's image with every float32 as a float64 of the same value; the program makes the sums anew."""
    sections = read_sections(scene.image)
    for key, kind in RECORDS.items():
        wide = np.zeros(len(sections[key]), widened(kind))
        for name in kind.names or ():
            wide[name] = sections[key][name]
        sections[key] = wide
    return pack(sections)


def build(program: Path, flags: tuple[str, ...], main: str = "replay_path.c") -> Path:
    """Compile a program of tests/bench with the core as it ships, or with WITH_RIVALS among the flags.

    Errors: CreaseError with the compiler's first line.
    """
    source = ROOT / "tests/bench" / main
    compiler = shutil.which("cc")
    if compiler is None:
        raise CreaseError("cc: not found; this benchmark builds C: run `make setup`")
    sources = [source, ROOT / "tests/check/blob.c", ROOT / "host/native/replay.c"]
    sources += [*CORE, *(RIVALS if WITH_RIVALS in flags else ())]
    folders = [f"-I{ROOT / name}" for name in ("firmware", "host/native", "tests/check")]
    words = [compiler, *FLAGS, *flags, *folders, *map(str, sources), "-lm", "-o", str(program)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        errors = [line for line in done.stderr.splitlines() if "error" in line] or [
            "no reason given"
        ]
        raise CreaseError(f"{source}: does not compile: {errors[0]}")
    return program


def build_each(folder: Path, flags: tuple[str, ...], responses: Iterable[str]) -> dict[str, Path]:
    """A program of the replay for each response: the one that ships, or the one with rivals.   Errors: CreaseError."""
    kinds = {
        response: () if response == DEFAULT_RESPONSE else (WITH_RIVALS,) for response in responses
    }
    built = {
        extra: build(folder / f"replay{''.join(extra)}", (*flags, *extra))
        for extra in sorted(set(kinds.values()))
    }
    return {response: built[extra] for response, extra in kinds.items()}


def words_for(program: Path, folder: Path, image: npt.NDArray[np.uint8], rows: npt.NDArray[np.float64],
              options: ReplayOptions) -> list[str]:  # fmt: skip
    """The command that runs a program of `build` on these poses; it writes folder/rows.

    Settings beside these two are the default ones.
    """
    assert options == ReplayOptions(response=options.response, coverage=options.coverage)
    (folder / "image").write_bytes(image.tobytes())
    (folder / "path").write_bytes(np.ascontiguousarray(rows).tobytes())
    numbers = (RESPONSES[options.response], COVERAGES[options.coverage])
    return [
        str(program),
        str(folder / "image"),
        str(folder / "path"),
        *map(str, numbers),
        str(folder / "rows"),
    ]


def run_in_double(program: Path, scene: Scene, path: Trajectory, options: ReplayOptions,
                  repeat: int = 1) -> npt.NDArray[Any]:  # fmt: skip
    """The rows of `run_path` in double precision, from a program of IN_DOUBLE.   Errors: CreaseError."""
    best: npt.NDArray[Any] | None = None
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        words = words_for(program, folder, widen_image(scene), path.rows, options)
        for _ in range(repeat):
            done = subprocess.run(words, capture_output=True, text=True, check=False)
            if done.returncode != 0:
                raise CreaseError(f"{scene.source}, in double precision: {done.stderr.strip()}")
            rows = np.fromfile(folder / "rows", ROW_IN_DOUBLE)
            best = rows if best is None else best
            np.minimum(best["tick_ns"], rows["tick_ns"], out=best["tick_ns"])
    assert best is not None
    return best
