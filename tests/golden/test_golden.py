"""Golden replays: no accuracy figure of a test scene may get worse than tests/golden/bounds.csv says.

The exact tables in tests/golden/exact hold the way out and its moment on exact geometry; a program of their own makes
them (tests/golden/gen/way_out_tables.py). The figures are those of `make bench` (tests/bench/bench.py,
crease.replay.measures). To refresh the bounds after a change that is meant to move them:

    make scenes
    .venv/bin/python tests/golden/test_golden.py --write

That measures every scene anew and writes each figure times 1.15, rounded up; of a torque the largest two digits within
that. Look at the difference before committing it: a bound that grows is a loss of accuracy and needs its reason in the
commit.
"""

from __future__ import annotations

import argparse
import csv
import math
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent / "bench")]

import bench  # noqa: E402
from crease.bake.scene_list import SceneSpec, load_specs  # noqa: E402
from crease.base.scene import open_scene  # noqa: E402
from crease.replay.measures import Accuracy  # noqa: E402
from crease.replay.replay import ReplayOptions  # noqa: E402
from crease.replay.trajectory import load_trajectory  # noqa: E402
from study.against_exact import exact_of, measure  # noqa: E402

BOUNDS = HERE / "bounds.csv"
ROOM = 1.15
"""How much worse than measured a figure may get."""
LEAST = {"mm": 1e-4, "deg": 1e-3}
"""Bounds below these would be about rounding: 0.1 um, a thousandth of a degree."""
MEASURES = (
    "force_rms_mm",
    "force_max_mm",
    "direction_p99_deg",
    "direction_max_deg",
    "depth_rms_mm",
    "depth_max_mm",
    "torque_rms_mm",
    "torque_max_mm",
    "amplification",
    "step_max_deg",
)
NO_TABLE = {"part_spanner"}
"""Exact arithmetic on the machined part takes hours: its convex pieces are hundreds."""
WITH_TABLE: dict[str, SceneSpec] = {
    name: spec
    for name, spec in load_specs(bench.ROOT / "meshes" / "scenes.toml", bench.MESHES).items()
    if spec.exact is not None
}
SPECS = {name: spec for name, spec in WITH_TABLE.items() if name not in NO_TABLE}


def figures_of(spec: SceneSpec, chosen: ReplayOptions) -> Accuracy:
    """The figures of a scene, with the settings that are chosen and the scene's stiffness."""
    scene, path = open_scene(bench.SCENES / f"{spec.name}.crs"), load_trajectory(spec.path)
    options = replace(chosen, stiffness_N_m=spec.stiffness_N_m)
    exact = exact_of(bench.EXACT, spec.exact, options)
    assert exact is not None
    return measure(scene, path, exact, options)


@cache
def figures(name: str) -> Accuracy:
    """The figures of a scene with the default settings."""
    return figures_of(SPECS[name], ReplayOptions())


def read_bounds(path: Path = BOUNDS) -> dict[tuple[str, str], float]:
    """Bound of each (scene, measure)."""
    with path.open(encoding="utf-8", newline="") as file:
        return {(row["scene"], row["measure"]): float(row["bound"]) for row in csv.DictReader(file)}


def bound_of(measure: str, value: float) -> float:
    """The bound for a measured value with room: three digits, rounded up; of a torque the largest two digits within it.

    The room is for bakes on other processors, whose samples differ in the last bits: figures move by up to 5 %.
    """
    value = max(value * ROOM, LEAST.get(measure.rsplit("_", 1)[-1], 0.0))
    size = 10.0 ** math.floor(math.log10(value))
    if measure.startswith("torque"):
        return float(f"{math.floor(10.0 * value / size + 1e-9) * size / 10.0:.6g}")
    return float(f"{math.ceil(100.0 * value / size - 1e-9) * size / 100.0:.6g}")


def write_bounds(path: Path, measured: Mapping[str, Accuracy]) -> None:
    """The table of these scenes."""
    with path.open("w", encoding="utf-8", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(("scene", "measure", "bound"))
        for name, accuracy in measured.items():
            for measure in MEASURES:
                bound = bound_of(measure, float(getattr(accuracy, measure)))
                out.writerow((name, measure, f"{bound:g}"))


@pytest.mark.parametrize("measure", MEASURES)
@pytest.mark.parametrize("name", SPECS)
def test_figure_stays_within_its_bound(name: str, measure: str) -> None:
    assert getattr(figures(name), measure) <= read_bounds()[name, measure]


def test_torque_bounds_are_two_digits_and_at_most_15_percent_above_what_is_measured() -> None:
    assert [bound_of("torque_max_mm", v) for v in (0.0, 0.0101, 0.0998, 1.0)] == [
        1e-4,
        0.011,
        0.11,
        1.1,
    ]
    for (name, key), bound in read_bounds().items():
        if key.startswith("torque"):
            assert bound == float(f"{bound:.2g}")
            assert bound <= max(1.05 * ROOM * getattr(figures(name), key), LEAST["mm"])


def test_every_scene_with_an_exact_table_has_its_bounds() -> None:
    assert set(read_bounds()) == {(name, measure) for name in SPECS for measure in MEASURES}


def test_every_exact_table_belongs_to_a_scene() -> None:
    assert {path.name for path in bench.EXACT.iterdir()} == {s.exact for s in SPECS.values()}


@pytest.mark.parametrize("name", SPECS)
def test_replay_has_contact_to_speak_of(name: str) -> None:
    """A path that misses its object would pass everything above."""
    assert figures(name).ticks > 100


def test_a_spanner_on_a_machined_part_amplifies_little() -> None:
    """Measured 2.86, where the extent has 13; without an exact table."""
    spec = WITH_TABLE["part_spanner"]
    scene, path = open_scene(bench.SCENES / f"{spec.name}.crs"), load_trajectory(spec.path)
    options = ReplayOptions(stiffness_N_m=spec.stiffness_N_m)
    assert measure(scene, path, None, options).amplification < 3.28


def main(path: Path, of_scene: Callable[[str], Accuracy], names: Iterable[str]) -> int:
    """Command line of a module of golden replays: --write measures and writes its table."""
    parser = argparse.ArgumentParser(description="Bounds of the golden replays.")
    parser.add_argument("--write", action="store_true", help=f"measure and write {path.name}")
    if not parser.parse_args().write:
        parser.error("nothing to do without --write; the tests are run by pytest")
    write_bounds(path, {name: of_scene(name) for name in names})
    print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main(BOUNDS, figures, SPECS))
