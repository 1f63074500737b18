"""Golden replays of the response way_out: no figure may get worse than tests/golden/bounds_way_out.csv says.

The exact tables in tests/golden/exact_new hold the way out and its moment on exact geometry: the program that makes
them, tests/golden/gen/way_out.py, shares nothing with the firmware. To refresh the bounds: as in test_golden.py.
"""

from __future__ import annotations

import argparse
import csv
import sys
from functools import cache
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "bench")]

import bench  # noqa: E402
import test_golden as golden  # noqa: E402
from crease.bake.scene_list import SceneSpec  # noqa: E402
from crease.base.scene import open_scene  # noqa: E402
from crease.replay.measures import Accuracy  # noqa: E402
from crease.replay.replay import ReplayOptions  # noqa: E402
from crease.replay.trajectory import load_trajectory  # noqa: E402
from study.against_exact import measure, read_exact  # noqa: E402

EXACT = HERE / "exact_new"
BOUNDS = HERE / "bounds_way_out.csv"
NO_TABLE = {"part_spanner"}
"""Exact arithmetic on the machined part takes hours: its convex pieces are hundreds."""
SPECS: dict[str, SceneSpec] = {
    name: spec for name, spec in golden.SPECS.items() if name not in NO_TABLE
}


@cache
def figures(name: str) -> Accuracy:
    """The figures of a scene with the default settings and this response."""
    spec = SPECS[name]
    assert spec.exact is not None
    scene, path = open_scene(bench.SCENES / f"{name}.crs"), load_trajectory(spec.path)
    options = ReplayOptions(stiffness_N_m=spec.stiffness_N_m, response="way_out")
    return measure(scene, path, read_exact(EXACT / spec.exact), options)


def read_bounds() -> dict[tuple[str, str], float]:
    """Bound of each (scene, measure)."""
    with BOUNDS.open(encoding="utf-8", newline="") as file:
        return {(row["scene"], row["measure"]): float(row["bound"]) for row in csv.DictReader(file)}


def write_bounds() -> None:
    """Measure every scene and write the table."""
    with BOUNDS.open("w", encoding="utf-8", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(("scene", "measure", "bound"))
        for name in SPECS:
            for each in golden.MEASURES:
                bound = golden.bound_of(each, float(getattr(figures(name), each)))
                out.writerow((name, each, f"{bound:g}"))


@pytest.mark.parametrize("measure_name", golden.MEASURES)
@pytest.mark.parametrize("name", SPECS)
def test_figure_stays_within_its_bound(name: str, measure_name: str) -> None:
    assert getattr(figures(name), measure_name) <= read_bounds()[name, measure_name]


def test_every_scene_with_an_exact_table_has_its_bounds() -> None:
    assert set(read_bounds()) == {(name, each) for name in SPECS for each in golden.MEASURES}


def test_every_exact_table_belongs_to_a_scene() -> None:
    assert {path.name for path in EXACT.iterdir()} == {spec.exact for spec in SPECS.values()}


def main() -> int:
    """Command line: see the module."""
    parser = argparse.ArgumentParser(description="Bounds of the golden replays of way_out.")
    parser.add_argument("--write", action="store_true", help=f"measure and write {BOUNDS.name}")
    if not parser.parse_args().write:
        parser.error("nothing to do without --write; the tests are run by pytest")
    write_bounds()
    print(BOUNDS)
    return 0


if __name__ == "__main__":
    sys.exit(main())
