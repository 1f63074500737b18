"""Throughput of `crease.Worlds`: ticks a second over batch sizes and threads, free and in contact.

    python tests/bench/worlds.py SCENE.crs PATH.csv [--steps N]      # make bench-worlds

Each world stands at a pose of its own along the path, all in contact, and moves on by one a step. The least time of a
step counts, so that the machine's other work does not.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import crease
import numpy as np
import numpy.typing as npt

COUNTS = (64, 256, 1024)


def least_s(worlds: crease.Worlds, actions: list[npt.NDArray[np.float64]]) -> float:
    """Least time of a step."""
    best = float("inf")
    for action in actions:
        start = time.perf_counter()
        worlds.step(action)
        best = min(best, time.perf_counter() - start)
    return best


def main() -> None:
    """Command line: see above."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("scene", type=Path)
    parser.add_argument("path", type=Path)
    parser.add_argument("--steps", type=int, default=200)
    args = parser.parse_args()
    scene, rows = crease.Scene.open(args.scene), crease.load_path(args.path).rows[:, 1:]
    touching = np.flatnonzero(crease.World(scene).replay(rows).areas > 0)
    first, last = int(touching[0]), int(touching[-1]) - args.steps
    print(f"{args.scene.stem}: ticks a second, least of {args.steps} steps")
    print(f"{'worlds':>7} {'threads':>8} {'free':>12} {'in contact':>12}")
    for count in COUNTS:
        at = np.linspace(first, last, count).astype(int)
        contact = [rows[at + k] for k in range(args.steps)]
        free = [np.tile(rows[0], (count, 1))] * args.steps
        for threads in (1, 2):
            worlds = crease.Worlds(scene, count, threads=threads)
            speeds = [count / least_s(worlds, actions) for actions in (free, contact)]
            worlds.close()
            print(f"{count:7d} {threads:8d} {speeds[0]:12,.0f} {speeds[1]:12,.0f}")


if __name__ == "__main__":
    main()
