"""The open benchmark of meshes/six: every scene through the coupled tick, judged by exact means, beside rivals.

    python tests/bench/six_bench.py [--quick] [--scenes NAME ...] [--no-rivals] [--compare METHOD ...]
                                    [--renew NAME ...] [-o DIR]

Writes SIX.md, six.csv and six_methods.csv. A goal that is missed is written down as missed, and is no failure of the
program.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import six_compare
import six_judge
import six_least
import six_report
import six_run
from crease.base.scene import Scene
from crease.replay.trajectory import Trajectory
from six_judge import MM, Case, Felt, Solids
from six_report import Row
from six_run import Coupled, run_coupled

F64 = npt.NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[2]
DATA, IMAGES = ROOT / "build" / "meshes" / "six", ROOT / "build" / "six" / "images"
QUICK = ("cube_plane", "book_tip", "corner", "plate_1")
PEGS = ("peg_04", "peg_01", "peg_002")
ENERGY = (
    "corner",
    "book_tip",
    "plate_1",
    "key",
    "peg_04",
    "cylinder_edges",
    "ladder",
    "jaw",
    "gears",
    "ball_joint",
)
LOOPS = (("plate_needle", 1, 0.0), ("cube_plane", 4, 0.010), ("ladder", 24, 0.004))
"""Scene, contacts, height of the tool's origin where it touches, m."""


@dataclass(frozen=True)
class Extent:
    """How much is run."""

    scenes: tuple[str, ...]
    every: int
    """Of so many ticks one is judged for what is inside."""
    hands: int
    strokes: int
    repeat: int
    loops: bool


def judge_scene(case: Case, scene: Scene, extent: Extent) -> list[Row]:
    """Everything that is asked of one scene by itself."""
    solids = Solids(case.mesh("static"), case.mesh("tool"))
    goals, friction, path = case.spec["goals"], float(case.spec["friction"]), case.path

    def run(along: Trajectory) -> Felt:
        return run_coupled(scene, case.springs, along, friction)[0]

    felt, rows = run_coupled(scene, case.springs, path, friction, extent.repeat)
    found = [
        Row.most(
            case.name,
            "inside, mm",
            goals["inside_max_mm"],
            six_judge.inside_mm(solids, felt.held, extent.every),
        ),
        Row.most(
            case.name,
            "felt before it touches, N",
            0.0,
            six_judge.felt_early_N(solids, path, felt.wrench),
        ),
        Row.most(
            case.name,
            "change at half the step",
            goals["halved_change_max"],
            six_judge.change_halves(case, run, felt),
        ),
        Row.most(case.name, "ticks with a fault, or left behind in the end", 0.0, _trouble(rows)),
    ]
    if not found[2].kept and friction <= 0.0:
        found += _beside_least(case, felt)
    if len(case.exact[0]):
        off = six_judge.wrench_rms_mm(case, felt.wrench)
        for name, value in zip(("force off", "torque off"), off, strict=True):
            found.append(Row.most(case.name, f"{name}, mm RMS", goals["wrench_rms_max_mm"], value))
    found += _of_its_own(case, felt)
    touching = rows["points"] > 0
    if not touching.any():
        found.append(Row.most(case.name, "ticks that touch nothing at all", 0.0, float(len(rows))))
    else:
        us = 1e-3 * rows["tick_ns"][touching]
        for share, goal in ((50, 10.0), (99, 20.0)):
            found.append(
                Row.most(
                    case.name,
                    f"tick p{share}, us",
                    goal,
                    float(np.percentile(us, share)),
                    case.name in ("peg_04", "cylinder_edges"),
                )
            )
    return found


def _beside_least(case: Case, felt: Felt) -> list[Row]:
    """What the scene itself does: the held tool by least motion over the meshes. No goals."""
    right, half = (six_least.follow(case, p)[0] for p in (case.path, six_judge.halved(case.path)))
    whole, halves = (six_judge.largest_change_N(case, f.wrench) for f in (right, half))
    force, torque = six_judge.off_rms_mm(case, felt.wrench, right.wrench)
    return [
        Row.most(case.name, what, 0.0, value, False)
        for what, value in (
            ("change at half the step, least motion over the meshes", halves / whole),
            ("force off least motion, mm RMS", force),
            ("torque off least motion, mm RMS", torque),
        )
    ]


def _trouble(rows: npt.NDArray[np.void]) -> float:
    return float(np.count_nonzero(rows["faults"]) + np.count_nonzero(rows["late_ticks"][-20:]))


def _of_its_own(case: Case, felt: Felt) -> list[Row]:
    """Goals that only this scene has."""
    spec, z_mm = case.spec, felt.held[:, 2] / MM
    found = []
    if "never_beyond" in spec:
        least = spec["never_beyond"]["held_origin_above_mm"]
        found.append(Row.least(case.name, "held tool's lowest place, mm", least, float(z_mm.min())))
    if "ends" in spec:
        found.append(
            Row.most(
                case.name, "how low it gets, mm", spec["ends"]["held_z_below_mm"], float(z_mm.min())
            )
        )
    if "rests" in spec:
        still = felt.held[spec["rests"]["from_tick"] :, :3] / MM
        found.append(
            Row.most(
                case.name,
                "moves at rest, mm",
                spec["rests"]["moves_max_mm"],
                float(np.ptp(still, axis=0).max()),
            )
        )
    return found


def judge_energy(case: Case, scene: Scene) -> list[Row]:
    """Closed loops, without friction and with it."""
    found = []
    for friction in (0.0, 0.3):

        def run(along: Trajectory, friction: float = friction) -> Felt:
            return run_coupled(scene, case.springs, along, friction)[0]

        given = six_judge.loop_energy(case, run)
        found.append(
            Row.most(
                case.name,
                f"energy given over a loop, friction {friction:g}, of stored",
                case.spec["goals"]["energy_max"],
                given,
            )
        )
    return found


def judge_hands(case: Case, scene: Scene, count: int, every: int) -> list[Row]:
    """Hands that put the peg in: how many get it in, and what is inside on the way."""
    solids = Solids(case.mesh("static"), case.mesh("tool"))
    goes = case.spec["goes_in"]
    ins, deep, unfelt = 0, 0.0, 0.0
    for place, turns in six_judge.hands_of(case, count):
        held, wrench = six_run.guide(Coupled(scene, case.springs), case.spec["hand"], place, turns)
        ins += bool(held[-1, 2] / MM - goes["grip_mm"] < goes["tip_below_mm"])
        deep = max(deep, six_judge.inside_mm(solids, held, every))
        unfelt = max(
            unfelt,
            float(np.abs(wrench[held[:, 2] > 1e-3 * (goes["grip_mm"] + 2.0)]).max(initial=0.0)),
        )
    return [
        Row.least(case.name, f"hands of {count} that put it in", float(count), float(ins)),
        Row.most(case.name, "inside, by hand, mm", case.spec["goals"]["inside_max_mm"], deep),
        Row.most(case.name, "felt by hand 2 mm above, N", 0.0, unfelt),
    ]


def judge_strokes(case: Case, scene: Scene, count: int) -> list[Row]:
    """A cube in any attitude, at 1 m/s, to 10 mm below the plate's top: how many come through."""
    run = six_compare.runner(six_compare.OURS, scene, case.springs)
    assert run is not None
    through = six_compare.let_through(run, count)
    return [Row.most(case.name, f"let through, of {count:,} strokes at 1 m/s", 0.0, float(through))]


def judge_loops() -> list[Row]:
    """The largest stiffness that settles with one contact and with many."""
    found = {
        count: six_run.largest_stiffness_N_m(Case.load(DATA, name).image(IMAGES), height_m)
        for name, count, height_m in LOOPS
    }
    spread = max(found.values()) / min(found.values()) - 1.0
    text = ", ".join(f"{k:.0f} N/m with {n}" for n, k in found.items())
    return [
        Row.most("loop, 1 ms late", f"spread of the largest k_t ({text} contacts)", 0.05, spread)
    ]


def bench(extent: Extent, say: bool = True) -> list[Row]:
    """Every row."""
    rows: list[Row] = []
    for name in extent.scenes:
        start = time.monotonic()
        case = Case.load(DATA, name)
        scene = case.image(IMAGES)
        more = judge_scene(case, scene, extent)
        if name in ENERGY:
            more += judge_energy(case, scene)
        if name in PEGS and extent.hands:
            more += judge_hands(case, scene, extent.hands, 8 * extent.every)
        if name == "plate_1" and extent.strokes:
            more += judge_strokes(case, scene, extent.strokes)
        rows += more
        if say:
            missed = [r.what for r in more if r.kept is False]
            spent = f"{len(more)} measured, {time.monotonic() - start:.0f} s"
            print(f"{name}: {spent}; missed: {', '.join(missed) or 'none'}", flush=True)
    if extent.loops:
        rows += judge_loops()
    return rows


HANDS, STROKES = 10, 50
"""Of the comparison."""


def compare(methods: Sequence[str], folder: Path) -> str:
    """These methods measured, those of the file beside them: the section of the page."""
    file = folder / "six_methods.csv"
    found = [f for f in six_compare.read(file) if f.method not in methods]
    found += six_compare.measure(DATA, IMAGES, HANDS, STROKES, methods=methods)
    six_compare.write(file, found)
    return six_compare.page(six_compare.read(file), HANDS, STROKES)


def main(arguments: Sequence[str] | None = None) -> None:
    """Command line; see the module text."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    names = sorted(p.stem for p in DATA.glob("*.json"))
    parser.add_argument("--quick", action="store_true", help="four scenes, no hands, few strokes")
    parser.add_argument("--scenes", nargs="+", metavar="NAME", choices=names)
    parser.add_argument("--no-rivals", action="store_true")
    parser.add_argument(
        "--compare",
        nargs="+",
        metavar="METHOD",
        choices=six_compare.METHODS,
        help="measure these methods alone, and put their rows into the page that is there",
    )
    parser.add_argument(
        "--renew",
        nargs="+",
        metavar="NAME",
        choices=names,
        help="measure these scenes alone, and put their rows into the page that is there",
    )
    parser.add_argument(
        "-o", "--output", metavar="DIR", type=Path, help="tests/bench; build/six for a part"
    )
    args = parser.parse_args(arguments)
    if args.compare:
        folder = args.output or ROOT / "tests" / "bench"
        six_report.renew(folder, compare(args.compare, folder))
        return
    if args.renew:
        rows = bench(Extent(tuple(args.renew), 4, 50, 10_000, 3, False))
        six_report.put(args.output or ROOT / "tests" / "bench", rows)
        return
    if args.quick:
        extent = Extent(tuple(args.scenes or QUICK), 20, 0, 50, 1, False)
    else:
        extent = Extent(tuple(args.scenes or names), 4, 50, 10_000, 3, not args.scenes)
    rows, more = bench(extent), ""
    whole = not (args.quick or args.scenes or args.no_rivals)
    folder = args.output or ROOT / ("tests/bench" if whole else "build/six")
    if whole:
        more = compare(six_compare.METHODS, folder)
    six_report.write(folder, rows, more)


if __name__ == "__main__":
    main()
