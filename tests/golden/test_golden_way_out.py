"""Golden replays of the response way_out: no figure may get worse than tests/golden/bounds_way_out.csv says.

The exact tables in tests/golden/exact_new hold the way out and its moment on exact geometry: the program that makes
them, tests/golden/gen/way_out.py, shares nothing with the firmware. To refresh the bounds: as in test_golden.py.
"""

from __future__ import annotations

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


@pytest.mark.parametrize("measure_name", golden.MEASURES)
@pytest.mark.parametrize("name", SPECS)
def test_figure_stays_within_its_bound(name: str, measure_name: str) -> None:
    assert getattr(figures(name), measure_name) <= golden.read_bounds(BOUNDS)[name, measure_name]


def test_every_scene_with_an_exact_table_has_its_bounds() -> None:
    assert set(golden.read_bounds(BOUNDS)) == {
        (name, each) for name in SPECS for each in golden.MEASURES
    }


def test_every_exact_table_belongs_to_a_scene() -> None:
    assert {path.name for path in EXACT.iterdir()} == {spec.exact for spec in SPECS.values()}


if __name__ == "__main__":
    sys.exit(golden.main(BOUNDS, figures, SPECS))
