"""The coupled tick beside three other methods: the same image, the same path, the same judges."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import numpy.typing as npt
import six_judge
import six_run
from crease.base.scene import Scene
from crease.lab.six_rivals import RIVALS
from crease.replay.trajectory import Trajectory
from scipy.spatial.transform import Rotation
from six_judge import MM, Case, Felt, Run, Solids
from six_report import number, table

F64 = npt.NDArray[np.float64]

SCENES = ("corner", "plate_1", "book_tip", "cylinder_edges", "key")
OURS = "coupled tick"
OF_SCENE = (
    "inside, mm",
    "felt before it touches, N",
    "force off, mm",
    "torque off, mm",
    "change at half the step",
    "energy given",
)
OF_ALL = ("pegs in", "let through", "tick, ms")
PAGE = """
## Beside other methods

Without friction. All see the image by the same lookups.

{scenes}
Pegs: hands of {hands} that put the peg with 0.4 mm play in; let through: strokes of {strokes} on the plate of 1 mm, at
1 m/s, 10 mm deep. Time: the worst mean of a scene; that of the others is Python's and says nothing of them.

{table}
{about}
Not there: the line tool by rays (Ho, Basdogan, Srinivasan 2000), force shading (Morgenbesser, Srinivasan 1996), contact
levels of detail (Otaduy, Lin 2003).
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
)


def runner(name: str, scene: Scene, springs: tuple[float, float]) -> Run:
    """A fresh method along a path."""
    if name == OURS:
        return lambda path: six_run.run_coupled(scene, springs, path)[0]
    return lambda path: six_run.run_method(RIVALS[name](scene, springs), path)


def method_of(name: str, scene: Scene, springs: tuple[float, float]) -> six_run.Method:
    """Tick by tick."""
    return six_run.Coupled(scene, springs) if name == OURS else RIVALS[name](scene, springs)


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


def compare(
    data: Path, images: Path, hands: int, strokes: int, every: int = 10
) -> tuple[str, list[dict[str, float]]]:
    """The section of SIX.md, and its numbers."""
    cases = [
        (case, case.image(images), Solids(case.mesh("static"), case.mesh("tool")))
        for case in (Case.load(data, n) for n in SCENES)
    ]
    peg, plate = Case.load(data, "peg_04"), Case.load(data, "plate_1")
    rows, texts, lines = [], [], []
    for name in (OURS, *RIVALS):
        found = [_of_scene(name, case, scene, solids, every) for case, scene, solids in cases]
        row = {k: max(f[k] for f in found) for k in found[0]}
        row["pegs in"] = _pegs(name, peg, peg.image(images), hands)
        row["let through"] = let_through(runner(name, plate.image(images), plate.springs), strokes)
        rows.append(row)
        texts.append([name, *(number(row[k]) for k in OF_ALL)])
        for scene, f in zip(SCENES, found, strict=True):
            lines.append([scene, name, *(number(f[k]) for k in OF_SCENE)])
        print(f"{name}: " + ", ".join(f"{k} {number(v)}" for k, v in row.items()), flush=True)
    about = table(("method", "implemented", "left out", "checked"), ABOUT)
    return PAGE.format(
        scenes=table(
            ("scene", "method", *OF_SCENE), sorted(lines, key=lambda line: SCENES.index(line[0]))
        ),
        hands=hands,
        strokes=strokes,
        table=table(("method", *OF_ALL), texts),
        about=about,
    ), rows


def _of_scene(name: str, case: Case, scene: Scene, solids: Solids, every: int) -> dict[str, float]:
    run, path = runner(name, scene, case.springs), case.path
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
