"""`crease stress --closed-loop`: what a map holds, and one point of it."""

from __future__ import annotations

from pathlib import Path

import matplotlib.image
import pytest
from stress.closed_loop import Cell, draw, jobs_of, work


def test_map_covers_every_place_for_every_response_and_loop() -> None:
    jobs = jobs_of(Path("unused"), quick=False)
    seen = {(j.response, j.case.place.name, j.hand, j.delay_s, j.damping_Ns_m) for j in jobs}
    assert len(seen) == len(jobs)
    places = {job.case.place.name for job in jobs}
    assert {"edge", "corner", "groove"} < places
    loops = len(jobs) // len(places)
    assert all(sum(j.case.place.name == place for j in jobs) == loops for place in places)
    assert {job.response for job in jobs_of(Path("unused"), quick=True)} == {"way_out", "fixed45"}


def test_figure_is_drawn_also_where_nothing_or_everything_settles(tmp_path: Path) -> None:
    largest = {"wall": 1000.0, "edge": 0.0, "corner": float("inf")}
    cells = [
        Cell(response, place, "light", delay_ms, 0.0, 1000.0, largest[place])
        for response in ("way_out", "fixed45")
        for delay_ms in (0.0, 1.0)
        for place in largest
    ]
    draw(cells, tmp_path / "map.png")
    picture = matplotlib.image.imread(tmp_path / "map.png")
    assert picture.std() > 0.05


@pytest.mark.slow
def test_ball_in_a_groove_holds_about_what_the_bound_allows(tmp_path: Path) -> None:
    job = next(
        j for j in jobs_of(tmp_path, quick=True) if j.case.groove and j.response == "way_out"
    )
    cell = work(job)
    assert 0.85 < cell.largest_N_m / cell.bound_N_m < 1.2
    assert cell.delay_ms == 1.0
