"""Golden replays of the rival `extent`: no figure may get worse than tests/golden/bounds_extent.csv says.

The exact tables in tests/golden/exact_extent hold the extent of the overlap, what the contact-zone method stands for:
tests/golden/gen/extent_tables.py makes them. To refresh the bounds: as in test_golden.py.
"""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "bench")]

import test_golden as golden  # noqa: E402
from crease.replay.measures import Accuracy  # noqa: E402
from crease.replay.replay import ReplayOptions  # noqa: E402

EXACT = HERE / "exact_extent"
BOUNDS = HERE / "bounds_extent.csv"
SPECS = golden.WITH_TABLE


@cache
def figures(name: str) -> Accuracy:
    """The figures of a scene with this response."""
    return golden.figures_of(SPECS[name], ReplayOptions(response="extent"))


@pytest.mark.parametrize("measure_name", golden.MEASURES)
@pytest.mark.parametrize("name", SPECS)
def test_figure_stays_within_its_bound(name: str, measure_name: str) -> None:
    assert getattr(figures(name), measure_name) <= golden.read_bounds(BOUNDS)[name, measure_name]


def test_torque_bounds_are_at_most_15_percent_above_what_is_measured() -> None:
    for (name, key), bound in golden.read_bounds(BOUNDS).items():
        if key.startswith("torque"):
            assert bound == float(f"{bound:.2g}")
            assert bound <= max(
                1.05 * golden.ROOM * getattr(figures(name), key), golden.LEAST["mm"]
            )


def test_every_scene_with_an_exact_table_has_its_bounds() -> None:
    assert set(golden.read_bounds(BOUNDS)) == {
        (name, each) for name in SPECS for each in golden.MEASURES
    }


def test_every_exact_table_belongs_to_a_scene() -> None:
    assert {path.name for path in EXACT.iterdir()} == {spec.exact for spec in SPECS.values()}


if __name__ == "__main__":
    sys.exit(golden.main(BOUNDS, figures, SPECS))
