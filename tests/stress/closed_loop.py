"""The stability map of the closed loop: the largest stiffness that settles, over damping, delay and hand.

For each response on a flat wall, an edge, a three-face corner and in a groove.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import numpy as np
from crease.base.table import write_bytes
from crease.loop.loop import (
    LIGHT_GRIP,
    NORMAL_GRIP,
    PERIOD_S,
    Hand,
    Setup,
    bound_N_m,
    stable_stiffness_N_m,
)
from crease.loop.places import Case, cases, groove_case, groove_scene, pad_scene, press_N

RESPONSES = ("way_out", "fixed45", "extent", "deepest_group", "overlap")
HANDS = {"light": LIGHT_GRIP, "normal": NORMAL_GRIP}
DELAYS_S = (0.0, None, 3e-3)
"""None: the bus as it is, one period."""
DAMPING_NS_M = (0.0, 5.0)


@dataclass(frozen=True)
class Cell:
    """One point of the map. largest_N_m: 0 when even half the bound does not settle, inf when four times it does."""

    response: str
    place: str
    hand: str
    delay_ms: float
    damping_Ns_m: float
    bound_N_m: float
    largest_N_m: float


@dataclass(frozen=True)
class Job:
    """What one process works out."""

    folder: Path
    response: str
    case: Case
    hand: str
    delay_s: float | None
    damping_Ns_m: float


def linear_setup(response: str, hand: Hand, delay_s: float | None, damping_Ns_m: float) -> Setup:
    """The device without what would hide the limit: no dry friction, fine encoder steps, no passivity controller."""
    return Setup(
        response=response,
        hand=hand,
        delay_s=delay_s,
        damping_Ns_m=damping_Ns_m,
        dry_friction=False,
        axes={axis: {"step_m": 5e-6} for axis in "XYZ"},
        control={"passivity_damping_max_Ns_m": 0.0},
    )


def delay_ms(job: Job) -> float:
    """Of sensing, bus and computation together."""
    return 1e3 * (PERIOD_S if job.delay_s is None else job.delay_s)


def cell_file(job: Job) -> Path:
    """Where a point of the map is kept, so that a map can be stopped and taken up again."""
    loop = f"{job.hand}-{delay_ms(job):g}ms-{job.damping_Ns_m:g}Nsm"
    return (
        job.folder / "cells" / f"{job.response}-{job.case.place.name.replace(' ', '_')}-{loop}.json"
    )


def work(job: Job) -> Cell:
    """One bisection, unless its file is there already.   Cost: about 10 s."""
    path = cell_file(job)
    if path.exists():
        return Cell(**json.loads(path.read_text(encoding="utf-8")))
    cell = bisect(job)
    path.parent.mkdir(exist_ok=True)
    write_bytes(path, (json.dumps(asdict(cell)) + "\n").encode())
    return cell


def bisect(job: Job) -> Cell:
    """The largest stiffness of one point."""
    hand = HANDS[job.hand]
    setup = replace(
        linear_setup(job.response, hand, job.delay_s, job.damping_Ns_m),
        base_from_world=job.case.base_from_world,
    )
    scene = (groove_scene if job.case.groove else pad_scene)(job.folder)
    bound = bound_N_m(setup, job.case.direction)
    largest = stable_stiffness_N_m(
        scene, setup, job.case.place, press_N(hand), 0.5 * bound, 4.0 * bound
    )
    return Cell(
        job.response,
        job.case.place.name,
        job.hand,
        delay_ms(job),
        job.damping_Ns_m,
        bound,
        largest,
    )


def jobs_of(folder: Path, quick: bool) -> list[Job]:
    """Every point; quick: two responses, the bus as it is, no damping, the light hand."""
    places = [*cases(), groove_case()]
    responses = RESPONSES[:2] if quick else RESPONSES
    hands = ("light",) if quick else tuple(HANDS)
    delays = (None,) if quick else DELAYS_S
    dampings = (0.0,) if quick else DAMPING_NS_M
    return [
        Job(folder, response, case, hand, delay_s, damping)
        for response in responses
        for hand in hands
        for delay_s in delays
        for damping in dampings
        for case in places
    ]


def run_map(
    folder: Path, processes: int, quick: bool, progress: Callable[[float], None]
) -> list[Cell]:
    """The points that are missing, on some processes; DIR/closed_loop.csv and .png of all.   Errors: CreaseError."""
    pad_scene(folder)
    groove_scene(folder)
    jobs = jobs_of(folder, quick)
    cells = []
    with ProcessPoolExecutor(processes) as pool:
        for done, cell in enumerate(pool.map(work, jobs), 1):
            cells.append(cell)
            progress(done / len(jobs))
    table = io.StringIO()
    writer = csv.DictWriter(table, [f.name for f in fields(Cell)], lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(cell) for cell in cells)
    write_bytes(folder / "closed_loop.csv", table.getvalue().encode())
    draw(cells, folder / "closed_loop.png")
    return cells


def draw(cells: list[Cell], path: Path) -> None:
    """A panel for each response: places against loops, the share of the bound in colour and in figures."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    responses = list(dict.fromkeys(c.response for c in cells))
    places = list(dict.fromkeys(c.place for c in cells))
    loops = list(dict.fromkeys((c.hand, c.delay_ms, c.damping_Ns_m) for c in cells))
    share = {
        (c.response, c.place, (c.hand, c.delay_ms, c.damping_Ns_m)): min(
            c.largest_N_m / c.bound_N_m, 4.0
        )
        for c in cells
    }
    figure, axes = plt.subplots(
        len(responses), 1, figsize=(3.5 + 0.85 * len(loops), 1.2 + 2.3 * len(responses)), squeeze=False,
        layout="constrained",
    )  # fmt: skip
    for axis, response in zip(axes[:, 0], responses, strict=True):
        grid = np.array([[share[(response, place, loop)] for loop in loops] for place in places])
        image = axis.imshow(grid, vmin=0.0, vmax=2.0, cmap="RdYlBu", aspect="auto")
        for (row, column), value in np.ndenumerate(grid):
            dark = not 0.3 < value < 1.7
            axis.text(
                column, row, f"{value:.2f}", ha="center", va="center", fontsize=8,
                color="white" if dark else "black",
            )  # fmt: skip
        axis.set_yticks(range(len(places)), places)
        axis.set_xticks(
            range(len(loops)),
            [f"{hand}\n{delay:g} ms\nB {damping:g}" for hand, delay, damping in loops],
            fontsize=8,
        )
        axis.set_title(response, loc="left", fontweight="bold")
    figure.colorbar(
        image, ax=axes, label="largest stiffness that settles / bound (b + B) / (T/2 + td)"
    )
    figure.suptitle(
        "Stable stiffness of the closed loop; columns: hand, delay, contact damping N s/m"
    )
    figure.savefig(path, dpi=110)
    plt.close(figure)
