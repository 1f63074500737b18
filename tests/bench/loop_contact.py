"""The loop in contact: dragged round an edge over a corner; the largest stiffness that settles at each place."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
from crease.base.scene import Scene, open_scene
from crease.loop.hil import LoopResult
from crease.loop.loop import (
    FIRM_GRIP,
    LIGHT_GRIP,
    NORMAL_GRIP,
    PERIOD_S,
    Hand,
    Setup,
    at_speed,
    bound_N_m,
    drag,
    stable_stiffness_N_m,
)
from crease.loop.places import Case, cases, pad_scene, press_N
from crease.replay.measures import (
    angle_deg,
    buzz_m_s2,
    buzz_worst_m_s2,
    force_steps,
    loop_energy,
)
from crease.replay.recording import fault_names
from crease.replay.trajectory import Trajectory, load_trajectory

F64 = npt.NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / "build"
PATH_SPEED_MM_S = 100.0
"""Of the paths as they come."""
HAND_NAMES = {LIGHT_GRIP: "light", NORMAL_GRIP: "normal", FIRM_GRIP: "firm"}
CREASES = ("edge", "corner")
SCENES = ("edge90_sphere", "corner3_sphere")
FLOOR_N = 0.5
"""Steps of smaller forces are not counted: a share of nothing."""


@dataclass(frozen=True)
class Extent:
    """How much is tried. Delays in s, none: the device's. Off: how many of `causes`. Places: all when there is none."""

    scenes: tuple[str, ...] = SCENES
    factors: tuple[float, ...] = (0.2, 0.5, 1.0)
    hands: tuple[Hand, ...] = (NORMAL_GRIP, FIRM_GRIP)
    off: int | None = None
    loops: tuple[tuple[Hand, float | None], ...] = (
        (LIGHT_GRIP, None),
        (NORMAL_GRIP, None),
        (LIGHT_GRIP, 0.0),
    )
    controller_without_delay: bool = False
    places: tuple[str, ...] = ()


DEFAULT = Extent()
MORE = Extent(
    factors=(0.1, 0.2, 0.5, 1.0),
    loops=(*DEFAULT.loops, (NORMAL_GRIP, 0.0)),
    controller_without_delay=True,
)
QUICK = Extent(
    scenes=SCENES[:1],
    factors=(0.2,),
    hands=(FIRM_GRIP,),
    off=2,
    loops=((NORMAL_GRIP, 0.0),),
    places=("flat as the edge", "edge"),
)


@cache
def scene_and_path(name: str) -> tuple[Scene, Trajectory]:
    """A scene of meshes/scenes.toml and its path."""
    return (
        open_scene(BUILD / "scenes" / f"{name}.crs"),
        load_trajectory(BUILD / "meshes" / f"{name}.csv"),
    )


# ------------------------------------------------------------------------------------------------------------ dragged


@dataclass(frozen=True)
class Dragged:
    """One way round a crease. Buzz in m/s^2; worst: over the worst 0.1 s. Steps: of the commanded force in one tick."""

    scene: str
    speed_mm_s: float
    hand: str
    response: str
    buzz: float
    worst: float
    buzz_free: float
    worst_free: float
    force_step: float
    turn_deg: float
    energy: float
    force_max_N: float
    faults: str
    passivity_ticks: int


def in_contact(result: LoopResult) -> npt.NDArray[np.bool_]:
    """Ticks of the path with contact."""
    counts = result.recording.rows["areas"] > 0
    counts[: result.path_start] = False
    return np.asarray(counts)


def along_path(result: LoopResult) -> npt.NDArray[np.bool_]:
    """Ticks of the path."""
    counts = np.zeros(len(result.mechanism), dtype=bool)
    counts[result.path_start :] = True
    return counts


def drag_case(
    name: str, factor: float, hand: Hand, response: str, setup: Setup | None = None
) -> tuple[Dragged, LoopResult]:
    """Drag at a speed, and the same motion with the block taken away."""
    scene, path = scene_and_path(name)
    setup = replace(setup or Setup(), hand=hand, response=response)
    path = at_speed(path, factor)
    result = drag(scene, setup, path)
    touched = in_contact(result)
    free = drag(scene, replace(setup, stiffness_N_m=0.0), path)
    rows = result.recording.rows
    force_N = rows["force_N"].astype(np.float64)
    acceleration = result.mechanism["tip_acc_m_s2"]
    held = force_N[result.path_start :]
    size = np.linalg.norm(held, axis=1)
    both = (size[1:] > FLOOR_N) & (size[:-1] > FLOOR_N)
    contact_N = rows["contact_force_N"].astype(np.float64)[result.path_start :]
    where = rows["position_m"].astype(np.float64)[result.path_start :]
    return Dragged(
        name,
        PATH_SPEED_MM_S * factor,
        HAND_NAMES[hand],
        response,
        buzz_m_s2(acceleration, touched),
        buzz_worst_m_s2(acceleration, touched),
        buzz_m_s2(free.mechanism["tip_acc_m_s2"], touched),
        buzz_worst_m_s2(free.mechanism["tip_acc_m_s2"], touched),
        float(force_steps(held, FLOOR_N).max(initial=0.0)),
        float(angle_deg(held[1:], held[:-1])[both].max(initial=0.0)),
        loop_energy(contact_N, where, setup.stiffness_N_m),
        float(size.max(initial=0.0)),
        ", ".join(fault_names(int(np.bitwise_or.reduce(rows["faults"])))) or "none",
        int(np.count_nonzero(rows["limits"] & 32)),
    ), result


def causes(
    count: int | None, name: str = "edge90_sphere", factor: float = 0.5
) -> list[tuple[str, float, float]]:
    """Buzz with one thing switched off at a time: name, in contact, the same motion without the block."""
    fine = {axis: {"step_m": 5e-6} for axis in "XYZ"}
    uncompensated = {"friction_share": 0.0}
    table = {
        "as it is": Setup(),
        "encoder steps of 5 um": Setup(axes=fine),
        "no friction compensation": Setup(control=uncompensated),
        "no passivity controller": Setup(control={"passivity_damping_max_Ns_m": 0.0}),
        "no amplifier lag": Setup(params={"amplifier_Hz": 0.0}),
        "no bus time": Setup(delay_s=0.0),
        "damping of contact 5 N s/m": Setup(damping_Ns_m=5.0),
        "target through 3 Hz instead of 10": Setup(params={"path_Hz": 3.0}),
        "no vibration mode (rigid)": Setup(params={"rigid": 1}),
        "no dry friction": Setup(dry_friction=False),
        "no dry friction, no mode": Setup(dry_friction=False, params={"rigid": 1}),
        "the two, and fine steps": Setup(dry_friction=False, params={"rigid": 1}, axes=fine),
    }
    rows = []
    for label, setup in list(table.items())[:count]:
        row, _ = drag_case(name, factor, NORMAL_GRIP, "way_out", setup)
        rows.append((label, row.buzz, row.buzz_free))
    return rows


# ---------------------------------------------------------------------------------------------------- stable stiffness


@dataclass(frozen=True)
class Stable:
    """Largest stiffness that settles at a place, N/m. passive: with the passivity controller."""

    place: str
    flat: str
    hand: str
    delay_ms: float
    response: str
    passive: bool
    bound: float
    measured: float


@dataclass(frozen=True)
class Job:
    """What one process works out."""

    case: Case
    setup: Setup
    passive: bool


def linear_setup(hand: Hand, delay_s: float | None, passive: bool, response: str) -> Setup:
    """The device without what would hide the limit.

    Dry friction holds any wall still, up to 20,000 N/m, and coarse encoder steps keep a stable loop awake.
    """
    return Setup(
        hand=hand,
        delay_s=delay_s,
        response=response,
        dry_friction=False,
        axes={axis: {"step_m": 5e-6} for axis in "XYZ"},
        control={} if passive else {"passivity_damping_max_Ns_m": 0.0},
    )


def work(job: Job) -> Stable:
    """One bisection."""
    setup = replace(job.setup, base_from_world=job.case.base_from_world)
    bound = bound_N_m(setup, job.case.direction)
    scene = pad_scene(BUILD / "loop")
    found = stable_stiffness_N_m(
        scene, setup, job.case.place, press_N(setup.hand), 0.5 * bound, 4.0 * bound
    )
    delay_ms = 1e3 * (PERIOD_S if setup.delay_s is None else setup.delay_s)
    return Stable(
        job.case.place.name,
        job.case.flat,
        HAND_NAMES[setup.hand],
        delay_ms,
        setup.response,
        job.passive,
        bound,
        found,
    )


def stable_jobs(extent: Extent) -> list[Job]:
    """Every place, the way out, with and without the passivity controller; fixed45 at the creases."""
    jobs = []
    chosen = [c for c in cases() if not extent.places or c.place.name in extent.places]
    for hand, delay_s in extent.loops:
        both = extent.controller_without_delay or delay_s is None
        kinds = [("way_out", passive, c) for c in chosen for passive in (False, True)[: 1 + both]]
        kinds += [("fixed45", False, c) for c in chosen if c.place.name in CREASES]
        jobs += [
            Job(case, linear_setup(hand, delay_s, passive, response), passive)
            for response, passive, case in kinds
        ]
    return jobs


def stable_table(extent: Extent, processes: int) -> list[Stable]:
    """All of them, on some processes at a time."""
    pad_scene(BUILD / "loop")
    with ProcessPoolExecutor(processes) as pool:
        return list(pool.map(work, stable_jobs(extent)))


def share_of_flat(row: Stable, table: list[Stable]) -> float:
    """A place against the flat wall in the same direction, all else equal, the way out."""
    for flat in table:
        same = (flat.hand, flat.delay_ms, flat.passive) == (row.hand, row.delay_ms, row.passive)
        if same and flat.place == row.flat and flat.response == "way_out":
            return row.measured / flat.measured if flat.measured > 0.0 else 0.0
    raise LookupError(f"no flat wall for {row}")
