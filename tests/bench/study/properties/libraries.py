"""Answers of other people's libraries, as tests/bench/peers/query.py writes them, through the same checks.

Force is depth times normal, over stiffness: a library with several contacts answers with the deepest depth along the
mean of the normals weighted by depth. Without torque and without steps between ticks, P3 and P8 fall out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from crease.base.errors import CreaseError

from study.properties.answers import Answer
from study.properties.geometry import Pair
from study.properties.judge import Effort, Row, judge, make_stage
from study.properties.scenes import PropertyScene, load_meshes


def libraries_of(folder: Path, scenes: Sequence[PropertyScene]) -> list[str]:
    """Names of the libraries that answered one of the scenes.   Errors: CreaseError when there is none."""
    names = {scene.name for scene in scenes}
    found = [file.stem.rsplit("-", 1) for file in sorted(folder.glob("*.npz"))]
    libraries = list(dict.fromkeys(library for library, scene in found if scene in names))
    if not libraries:
        raise CreaseError(
            f"{folder}: holds no answers to these scenes; `make bench-properties` writes them"
        )
    return libraries


def judge_libraries(
    scenes: Sequence[PropertyScene],
    folder: Path,
    meshes: Path,
    effort: Effort,
    progress: Callable[[str], None] = lambda _: None,
) -> Iterator[Row]:
    """Every scene with every library that answered it."""
    libraries = libraries_of(folder, scenes)
    answers: dict[str, dict[str, Answer]] = {library: {} for library in libraries}
    for scene in scenes:
        files = {name: folder / f"{name}-{scene.name}.npz" for name in libraries}
        there = {name: dict(np.load(file)) for name, file in files.items() if file.exists()}
        if not there:
            continue
        pair = Pair(*load_meshes(scene, meshes))
        stages = {
            n: make_stage(scene, meshes, pair, effort, n)
            for n in {int(f["every"]) for f in there.values()}
        }
        for name, found in there.items():
            stage = stages[int(found["every"])]
            if len(found["depth_m"]) != len(stage.poses):
                raise CreaseError(
                    f"{files[name]}: is of another path; make it again with `make bench-properties`"
                )
            way_mm = 1e3 * found["depth_m"][:, None] * found["normal"]
            no_torque = np.full_like(way_mm, np.nan)
            answer = Answer(way_mm, no_torque, found["time_us"], found["depth_m"] > 0.0)
            answers[name][scene.name] = answer
            yield judge(stage, name, answer, None, answers[name])
        progress(f"{scene.name}: {len(there)} libraries")
