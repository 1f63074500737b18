"""How right the time is that `crease bake` foresees: before the work, and at 25, 50 and 75 % of it.

    PYTHONPATH=meshes python tests/bench/bake_estimate.py [--only NAME...] [--stages]

Needs build/meshes (make meshes). One line per pair of meshes: estimates of the whole time over the time it took, and
the largest factor between them. Status 1 when that is over 2 for a bake of over 2 s. --stages: units of each stage
foreseen and counted, the work of these by the weights of host/crease/bake/estimate.py, and what it took: the weights
are taken from these quotients. UNSEEN, marked *, were never looked at for that.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import parts
import trimesh
from crease.bake.bake import BakeOptions, bake_scene
from crease.bake.bodies import pack_bodies
from crease.base.progress import Forecast
from crease.mesh.mesh import load_mesh

ROOT = Path(__file__).resolve().parents[2]
MESHES = ROOT / "build" / "meshes"
FACTOR_MAX, FLOOR_S = 2.0, 2.0
PARTS_OF_TIME = (0.25, 0.5, 0.75)
TWO_MM = BakeOptions(voxel_m=2e-3, spacing_m=2e-3)


class Pair(NamedTuple):
    """Names of STATIC and TOOL in `shapes`, or of files of build/meshes; options of the bake."""

    static: str
    tool: str = "ball15"
    options: BakeOptions = BakeOptions()


PAIRS = {
    **{name: Pair(name) for name in (*parts.PARTS, "spanner", "featuretype", "gear", "bowl")},
    "block45k": Pair("block45k", "cube60_2700", TWO_MM),
    "block45k defaults": Pair("block45k"),
    "ball 82k": Pair("ball_82k"),
    "ball 1.3M": Pair("ball_1310k", "cube60_2700", TWO_MM),
    "tool gear_pair": Pair("block60", "gear_pair"),
    "tool lattice": Pair("block60", "lattice"),
    "tool of 140,000 samples": Pair("block60", "ball_82k", BakeOptions(2e-3, 1.33e-3)),
}
UNSEEN = {
    "torus": Pair("torus"),
    "hexagon": Pair("hexagon"),
    "countersink": Pair("countersink", "ball8"),
    "hole_block": Pair("hole_block", "cylinder20"),
    "fork": Pair("fork", "jaw"),
    "groove": Pair("groove", "groove_tool"),
    "spanner by spanner": Pair("spanner", "spanner"),
    "featuretype coarse": Pair("featuretype", "cube20", BakeOptions(voxel_m=3e-3)),
    "spanner fine": Pair("spanner", "ball15", BakeOptions(voxel_m=0.5e-3)),
    "bowl tolerance": Pair("bowl", "ball15", BakeOptions(tolerance_m=5e-5)),
    "noisy bracket": Pair("noisy_bracket"),
    "holes in knob": Pair("holes_knob"),
}


def shapes() -> dict[str, Callable[[], trimesh.Trimesh]]:
    """Meshes that are made here."""
    return {
        **parts.PARTS,
        "ball_82k": partial(trimesh.creation.icosphere, subdivisions=6, radius=100.0),
        "ball_1310k": partial(trimesh.creation.icosphere, subdivisions=8, radius=100.0),
        "noisy_bracket": lambda: parts.SPOILERS["noise"](parts.PARTS["bracket"]()),
        "holes_knob": lambda: parts.SPOILERS["holes"](parts.PARTS["knob"]()),
    }


class Watched(Forecast):
    """A forecast that keeps what it told: seconds since the start and the whole time foreseen then; stages."""

    def __init__(self) -> None:
        super().__init__(self._keep)
        self.start_s = time.monotonic()
        self.told: list[tuple[float, float]] = []
        self.foreseen: dict[str, tuple[float, float]] = {}
        self.stages: list[tuple[str, float, float]] = []

    def _keep(self, _name: str, _part: float, left_s: float) -> None:
        if math.isfinite(left_s):
            now_s = time.monotonic() - self.start_s
            self.told.append((now_s, now_s + left_s))

    def foresee(self, name: str, units: float, unit_s: float) -> None:
        self.foreseen.setdefault(name, (units, unit_s))
        super().foresee(name, units, unit_s)

    def begin(self, name: str, units: float | None = None) -> None:
        super().begin(name, units)
        counted = self.foreseen[name][0] if units is None else units
        self.stages.append((name, counted, time.monotonic() - self.start_s))


def watch(static: Path, tool: Path, options: BakeOptions) -> tuple[Watched, float]:
    """One bake as the command does it, and the seconds it took."""
    work = Watched()
    meshes = load_mesh(static, "mm", work.prepare), load_mesh(tool, "mm", work.prepare)
    bake_scene(*meshes, options, work)
    pack_bodies(*meshes)
    work.end()
    return work, time.monotonic() - work.start_s


def factors(work: Watched, took_s: float) -> list[float]:
    """The whole time foreseen over that it took: before the work, and what was last told at each of PARTS_OF_TIME."""
    before_s = work.told[0][1]
    last = [[all_s for at_s, all_s in work.told if at_s <= p * took_s] for p in PARTS_OF_TIME]
    return [before_s / took_s, *((told[-1] if told else before_s) / took_s for told in last)]


def print_stages(work: Watched, took_s: float) -> None:
    """One line per stage."""
    ends = [at_s for _, _, at_s in work.stages[1:]] + [took_s]
    for (name, counted, at_s), end_s in zip(work.stages, ends, strict=True):
        units, unit_s = work.foreseen[name]
        print(
            f"    {name:10s} {units:10,.0f} units foreseen, {counted:10,.0f} counted; work {units * unit_s:6.2f} s "
            f"foreseen, {counted * unit_s:6.2f} s counted, took {end_s - at_s:6.2f} s"
        )


def main() -> int:
    """Print one line per pair; status 1 when an estimate was off by more than FACTOR_MAX."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    pairs = {**PAIRS, **UNSEEN}
    parser.add_argument("--only", nargs="+", choices=list(pairs), default=list(pairs))
    parser.add_argument("--stages", action="store_true", help="work of each stage")
    args = parser.parse_args()
    made, failed, worst = shapes(), 0, 1.0
    print(f"{'pair':24s} {'took s':>7s}  before   25 %   50 %   75 %  largest factor")
    with tempfile.TemporaryDirectory() as folder:
        for name in args.only:
            pair = pairs[name]
            paths = []
            for shape in (pair.static, pair.tool):
                path = MESHES / f"{shape}.stl"
                if shape in made:
                    path = Path(folder) / f"{shape}.stl"
                    made[shape]().export(path)
                paths.append(path)
            work, took_s = watch(paths[0], paths[1], pair.options)
            found = factors(work, took_s)
            factor = max(max(f, 1 / f) for f in found)
            said = " ".join(f"{f:6.2f}" for f in found)
            counts = took_s > FLOOR_S
            bad = counts and factor > FACTOR_MAX
            failed, worst = failed + bad, max(worst, factor if counts else 1.0)
            mark = "  OVER" if bad else "" if counts else "  (short)"
            new = "*" if name in UNSEEN else ""
            print(f"{name + new:24s} {took_s:7.1f}  {said}  {factor:.2f}{mark}", flush=True)
            if args.stages:
                print_stages(work, took_s)
    print(
        f"{len(args.only)} bakes, {failed} off by more than {FACTOR_MAX:g}; largest factor {worst:.2f}"
    )
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
