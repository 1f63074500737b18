"""The coupled tick beside other methods: the same image, the same path, the same judges.

What is measured is kept, number by number, in six_methods.csv, so that methods can be measured one at a time.
"""

from __future__ import annotations

import csv
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import six_judge
import six_run
from crease.base.scene import Scene
from crease.lab import six_drum
from crease.lab.six_rivals import LINE, NAMES, Line, make_rival
from crease.replay.trajectory import Trajectory
from scipy.spatial.transform import Rotation
from six_judge import MM, Case, Felt, Run, Solids
from six_report import number, table

F64 = npt.NDArray[np.float64]

SCENES = (
    "corner",
    "plate_1",
    "book_tip",
    "cylinder_edges",
    "key",
    "ball_joint",
    "plate_needle",
    "stick_edge",
)
OURS = "coupled tick"
METHODS = (OURS, *NAMES)
ALL, DRUM = "all", "drum"
"""Instead of a scene: over all of them; the drum of facets."""
OF_SCENE = (
    "inside, mm",
    "felt before it touches, N",
    "force off, mm",
    "torque off, mm",
    "change at half the step",
    "energy given",
)
OF_ALL = ("pegs in", "let through", "tick, ms")
OF_DRUM = ("largest turn in a tick, deg", "off the round drum, deg RMS")
NO_LINE = "its tool is no line"
PAGE = """
## Beside other methods

    PYTHONPATH=tests/bench .venv/bin/python tests/bench/six_bench.py --compare METHOD ...   # these alone

Without friction. All see the image by the same lookups.

{scenes}
Pegs: hands of {hands} that put the peg with 0.4 mm play in; let through: strokes of {strokes} on the plate of 1 mm, at
1 m/s, 10 mm deep. Time: the worst mean of a scene; that of the others is Python's and says nothing of them.

{table}
What facets do to the direction of the force: a needle's tip drawn by 100 degrees round a drum R 20 mm of 24 sides, 2 mm
deep, 0.1 degrees a tick. Right for the drum as it is meshed is a turn of 15 degrees at each edge; shading shows the
round one: its normals are means over half a facet to each side.

{drum}
{about}
Of the last three methods the formulas were not at hand, but abstracts and what others say of them: read their figures
as those of our reading.
"""
ABOUT = (
    (
        "god-object: Ortega, Redon, Coquillart 2007",
        "least motion among half-spaces (NNLS), to the first new contact, four passes a tick; "
        "force: what contacts hold back",
        "contacts of edges; exact continuous detection: steps of a quarter voxel and bisection",
        "cube pressed on a plane: k_t times depth within 1 %",
    ),
    (
        "static coupling: Barbic, James 2008",
        "penalties of samples, linearised, one step of Newton's method a tick",
        "saturation of the spring, deformation, the tree",
        "the same: springs in series within 1 %",
    ),
    (
        "voxmap: McNeely, Puterbaugh, Troy 1999; Renz 2001; Wan, McNeely 2003",
        "body of 0.1 kg on spring and damper, planes through voxel centres, stiffness shared above ten points, inside "
        "the way to the surface",
        "braking before contact, tuned force layers, cutting by time",
        "the same: at rest within a voxel",
    ),
    (
        "force shading: Morgenbesser, Srinivasan 1996; two passes as Ruspini, Kolarov, Khatib 1997",
        "the god-object led by normals that are smooth over facets, then kept outside by the true ones; the force has "
        "the direction of the smooth ones",
        "normals at vertices: means over a disc, one voxel to each side, of the same smooth patch",
        "the same as the god-object; on a drum of 24 sides off the round one's normal by less than 1 degree RMS; "
        "not against the paper's text",
    ),
    (
        "contact levels: Otaduy, Lin 2003",
        "pieces of coarser shells, each the coarsest whose deviation, spread over what touches, is below 0.5 % of the "
        "tool's radius; then as static coupling",
        "collapse of edges, convex pieces, the saving, their body and its integration; the threshold is ours",
        "the same: springs in series within 1 %; with threshold 0 the static coupling; a flat face has fewer contacts; "
        "not against the paper's text",
    ),
    (
        "line by rays: Ho, Basdogan, Srinivasan 2000",
        "ideal line outside, stopped at its ends and where it is closest; forces at two handles, together the spring",
        "triangles and their neighbours, friction; tools that are no line",
        "tip on a plane: k_t times depth; across an edge: springs of shift and lean in series; both within 1 %; "
        "not against the paper's text",
    ),
)


@dataclass(frozen=True)
class Found:
    """One number of a method."""

    method: str
    scene: str
    what: str
    measured: float


def runner(
    name: str, scene: Scene, springs: tuple[float, float], line: Line | None = None
) -> Run | None:
    """A fresh method along a path; None: it is for lines, and the tool is none."""
    if name == OURS:
        return lambda path: six_run.run_coupled(scene, springs, path)[0]
    if make_rival(name, scene, springs, line) is None:
        return None
    return lambda path: six_run.run_method(method_of(name, scene, springs, line), path)


def method_of(
    name: str, scene: Scene, springs: tuple[float, float], line: Line | None = None
) -> six_run.Method:
    """Tick by tick."""
    if name == OURS:
        return six_run.Coupled(scene, springs)
    made = make_rival(name, scene, springs, line)
    assert made is not None
    return made


def stroke_path(rng: np.random.Generator) -> Trajectory:
    """A cube of 20 mm in any attitude at 1 m/s from 4 mm above a plate's top to 10 mm below it."""
    corners = 10e-3 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    turn = Rotation.from_quat(rng.normal(size=4))
    low = float(turn.apply(corners)[:, 2].min())
    z = np.arange(-low + 4e-3, -low - 10e-3, -1e-3)
    at = np.column_stack([np.tile(rng.uniform(-8e-3, 8e-3, 2), (len(z), 1)), z])
    return six_judge.trajectory(
        six_judge.poses(at, Rotation.from_quat(np.tile(turn.as_quat(), (len(z), 1))))
    )


def let_through(run: Run, count: int, seed: int = 6) -> int:
    """Strokes after which the held tool's middle is lower than any attitude allows on the plate's top."""
    rng = np.random.default_rng(seed)
    return sum(bool((run(stroke_path(rng)).held[:, 2] < 9e-3).any()) for _ in range(count))


def measure(
    data: Path,
    images: Path,
    hands: int,
    strokes: int,
    every: int = 10,
    methods: Sequence[str] = METHODS,
) -> list[Found]:
    """Every number of these methods."""
    cases = [
        (case, case.image(images), Solids(case.mesh("static"), case.mesh("tool")))
        for case in (Case.load(data, n) for n in SCENES)
    ]
    peg, plate = Case.load(data, "peg_04"), Case.load(data, "plate_1")
    needle = Case.load(data, "plate_needle")
    drum = six_drum.make_scene(needle.mesh("tool"))
    found = []
    for name in methods:
        of_all = {"tick, ms": 0.0}
        for case, scene, solids in cases:
            run = runner(name, scene, case.springs, Line.of(case.spec))
            if run is None:
                continue
            row = _of_scene(run, case, solids, every)
            of_all["tick, ms"] = max(of_all["tick, ms"], row["tick, ms"])
            found += [Found(name, case.name, what, row[what]) for what in OF_SCENE]
        stroke = runner(name, plate.image(images), plate.springs, Line.of(plate.spec))
        if stroke is not None:
            of_all["pegs in"] = _pegs(name, peg, peg.image(images), hands)
            of_all["let through"] = let_through(stroke, strokes)
        found += [Found(name, ALL, what, of_all[what]) for what in OF_ALL if what in of_all]
        turns = drum_turns(name, drum, needle)
        found += [Found(name, DRUM, *v) for v in zip(OF_DRUM, turns or (), strict=False)]
        print(f"{name}: " + ", ".join(f"{k} {number(v)}" for k, v in of_all.items()), flush=True)
    return found


def read(file: Path) -> list[Found]:
    """What write() wrote; nothing where nothing is."""
    if not file.exists():
        return []
    with file.open(encoding="utf-8", newline="") as rows:
        return [
            Found(r["method"], r["scene"], r["what"], float(r["measured"]))
            for r in csv.DictReader(rows)
        ]


def write(file: Path, found: Sequence[Found]) -> None:
    """One number a row, in the order of the page."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("w", encoding="utf-8", newline="") as rows:
        out = csv.writer(rows, lineterminator="\n")
        out.writerow(("method", "scene", "what", "measured"))
        for f in sorted(found, key=lambda f: METHODS.index(f.method)):
            out.writerow((f.method, f.scene, f.what, f"{f.measured:.6g}"))


def page(found: Sequence[Found], hands: int, strokes: int) -> str:
    """The section of SIX.md."""
    by = {(f.scene, f.method, f.what): number(f.measured) for f in found}
    methods = [m for m in METHODS if any(f.method == m for f in found)]

    def cells(scene: str, method: str, heads: Sequence[str]) -> list[str]:
        return [by.get((scene, method, what), "") for what in heads]

    rows = []
    for scene in SCENES:
        for method in methods:
            row = cells(scene, method, OF_SCENE)
            if not any(row):
                row[0] = NO_LINE if method == LINE else "not measured"
            rows.append([scene, method, *row])
    return PAGE.format(
        scenes=table(("scene", "method", *OF_SCENE), rows),
        hands=hands,
        strokes=strokes,
        table=table(("method", *OF_ALL), [[m, *cells(ALL, m, OF_ALL)] for m in methods]),
        drum=table(("method", *OF_DRUM), [[m, *cells(DRUM, m, OF_DRUM)] for m in methods]),
        about=table(("method", "implemented", "left out", "checked"), ABOUT),
    )


def drum_turns(name: str, scene: Scene, needle: Case) -> tuple[float, float] | None:
    """See OF_DRUM; None: the method cannot."""
    pose = six_drum.poses()
    if name == OURS:
        felt = six_run.run_coupled(scene, needle.springs, six_judge.trajectory(pose))[0]
    else:
        method = six_drum.rival(name, scene, needle.springs, Line.of(needle.spec))
        if method is None:
            return None
        felt = six_run.run_method(method, six_judge.trajectory(pose))
    return six_drum.turns_deg(felt.wrench, pose)


def _of_scene(run: Run, case: Case, solids: Solids, every: int) -> dict[str, float]:
    path = case.path
    start = time.perf_counter()
    felt: Felt = run(path)
    spent_ms = 1e3 * (time.perf_counter() - start) / len(path)
    force, torque = six_judge.wrench_rms_mm(case, felt.wrench)
    return {
        "inside, mm": six_judge.inside_mm(solids, felt.held, every),
        "felt before it touches, N": six_judge.felt_early_N(solids, path, felt.wrench),
        "force off, mm": force,
        "torque off, mm": torque,
        "change at half the step": six_judge.change_halves(case, run, felt),
        "energy given": six_judge.loop_energy(case, run),
        "tick, ms": spent_ms,
    }


def _pegs(name: str, case: Case, scene: Scene, hands: int) -> float:
    goes = case.spec["goes_in"]
    count = 0
    for place, turns in six_judge.hands_of(case, hands):
        held, _ = six_run.guide(
            method_of(name, scene, case.springs), case.spec["hand"], place, turns
        )
        count += bool(held[-1, 2] / MM - goes["grip_mm"] < goes["tip_below_mm"])
    return float(count)
