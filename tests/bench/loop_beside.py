"""The loop with its contact searched for beside the ticks: what an older contact costs."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

from crease.loop.loop import NORMAL_GRIP, Setup
from crease.loop.places import cases
from loop_contact import DEFAULT, Extent, Job, drag_case, linear_setup, work

WHOLE = 1 << 20
"""Lookups beside each tick that end every search before the next one."""
WORKS = (0, WHOLE, 40, 8)
"""Lookups beside each tick; 0: the tick searches itself."""
SCENES = ("edge90_sphere", "edge90_cube")


@dataclass(frozen=True)
class Beside:
    """A ball and a cube round an edge. Buzz: m/s^2; step: share of the force in one tick; turn: deg; ages: ticks."""

    scene: str
    work: int
    late_mean: float
    late_max: int
    buzz: float
    worst: float
    force_step: float
    turn_deg: float
    faults: str


@dataclass(frozen=True)
class Settles:
    """Largest stiffness that settles at a place, N/m, for each of WORKS that was tried."""

    place: str
    bound: float
    found: tuple[float, ...]


def dragged(scene: str, lookups: int) -> Beside:
    """One way round, 50 mm/s, normal hand."""
    row, result = drag_case(scene, 0.5, NORMAL_GRIP, "way_out", Setup(search_work=lookups))
    felt = result.recording.rows[result.path_start :]
    late = felt["contact_late_ticks"][felt["areas"] > 0]
    return Beside(
        scene,
        lookups,
        float(late.mean()),
        int(late.max()),
        row.buzz,
        row.worst,
        row.force_step,
        row.turn_deg,
        row.faults,
    )


def works(extent: Extent) -> tuple[int, ...]:
    """All, or two for a short run."""
    return WORKS if extent.off is None else WORKS[:2]


def dragged_beside(extent: Extent = DEFAULT) -> list[Beside]:
    """Each scene with each amount of work."""
    scenes = SCENES if extent.off is None else SCENES[:1]
    return [dragged(scene, lookups) for scene in scenes for lookups in works(extent)]


def settles_beside(extent: Extent, processes: int) -> list[Settles]:
    """Each place, normal hand, the bus as it is, no passivity controller."""
    linear = linear_setup(NORMAL_GRIP, None, False, "way_out")
    chosen = [c for c in cases() if not extent.places or c.place.name in extent.places[-1:]]
    tried = works(extent)
    jobs = [Job(case, replace(linear, search_work=n), False) for case in chosen for n in tried]
    with ProcessPoolExecutor(processes) as pool:
        rows = list(pool.map(work, jobs))
    groups = [rows[i : i + len(tried)] for i in range(0, len(rows), len(tried))]
    return [Settles(g[0].place, g[0].bound, tuple(r.measured for r in g)) for g in groups]


def name_of(lookups: int) -> str:
    """For a table."""
    return {0: "in the tick", WHOLE: "whole"}.get(lookups, f"{lookups} lookups a tick")


def print_beside(rows: list[Beside], stable: list[Settles]) -> None:
    """Both tables."""
    print(
        "\ncontact searched for beside the ticks: k = 1000 N/m, 50 mm/s, normal hand; age in ticks"
    )
    print(
        f"{'scene':15s} {'search':20s} {'age':>5s} {'max':>4s} {'buzz':>6s} {'worst':>6s} "
        f"{'step':>5s} {'turn':>6s}  faults"
    )
    for r in rows:
        print(
            f"{r.scene:15s} {name_of(r.work):20s} {r.late_mean:5.1f} {r.late_max:4d} {r.buzz:6.3f} {r.worst:6.3f} "
            f"{100 * r.force_step:4.0f}% {r.turn_deg:5.1f}d  {r.faults}"
        )
    tried = [name_of(n) for n in WORKS[: len(stable[0].found)]]
    print(f"largest stiffness that settles, N/m, {', '.join(tried)}:")
    for s in stable:
        print(f"{s.place:19s} bound {s.bound:6.0f}  " + " ".join(f"{n:6.0f}" for n in s.found))
