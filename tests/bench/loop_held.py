"""Largest springs of the coupling that a handle of six axes holds still, by how many feet the tool stands on.

    python tests/bench/loop_held.py [--json OUT] [--quick | --more]

A plate on 1, 4 or 24 feet is pressed on a block and knocked (crease.loop.held): k_t along, k_r about roll and pitch, a
period of delay as over the bus, no controller. It ends with one line for each claim, and fails when one does not hold.
--more: delays of 0 and 2 ms.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, dataclass
from pathlib import Path

from crease.lab.setup import machine
from crease.loop.held import (
    bound_about_Nm_rad,
    bound_along_N_m,
    held_setup,
    hold_held,
    points_pressing,
    stable_about_Nm_rad,
    stable_along_N_m,
)
from crease.loop.places import FEET, feet_scene

FOLDER = Path(__file__).resolve().parents[2] / "build/loop"
RATIO, RATIO_QUICK = 1.01, 1.05
"""To which the search goes."""
LOW, HIGH = 0.7, 1.6
"""Of the bound: where it looks."""
ALIKE = 1.05
"""Of the largest to the smallest k_t of 1, 4 and 24 feet."""


@dataclass(frozen=True)
class Row:
    """One search; k_r of one foot is none: a point resists no turning."""

    feet: int
    delay_ms: float
    pressing: float
    along_N_m: float
    along_bound_N_m: float
    about_Nm_rad: float | None
    about_bound_Nm_rad: float


def measure(feet: int, delay_s: float | None, quick: bool) -> Row:
    """Both springs for one number of feet."""
    scene, setup = feet_scene(FOLDER, feet), held_setup(delay_s=delay_s)
    ratio = RATIO_QUICK if quick else RATIO
    along, about = bound_along_N_m(setup), bound_about_Nm_rad(setup)
    about_found = None
    if feet > 1 and not quick:
        about_found = stable_about_Nm_rad(scene, setup, LOW * about, HIGH * about, ratio)
    return Row(
        feet,
        1.0 if delay_s is None else 1e3 * delay_s,
        points_pressing(hold_held(scene, setup, 0.0, 0.0)),
        stable_along_N_m(scene, setup, LOW * along, HIGH * along, ratio),
        along,
        about_found,
        about,
    )


def show(row: Row) -> str:
    """A row of the table of COUPLED_LOOP.md."""
    about = "" if row.about_Nm_rad is None else f"{row.about_Nm_rad:.1f}"
    along = f"{row.along_N_m:.0f} | {row.along_bound_N_m:.0f}"
    turning = f"{about} | {row.about_bound_Nm_rad:.1f}"
    return f"| {row.delay_ms:g} ms | {row.feet} | {row.pressing:.0f} | {along} | {turning} |"


def claims(rows: list[Row]) -> list[tuple[str, bool]]:
    """What COUPLED_LOOP.md says of the bus as it is."""
    plain = [row for row in rows if row.delay_ms == 1.0]
    found = [row.along_N_m for row in plain]
    turning = [row.about_Nm_rad for row in plain if row.about_Nm_rad is not None]
    spread = max(found) / min(found)
    out = [(f"k_t of 1, 4 and 24 feet within 5 %: {100 * (spread - 1):.1f} %", spread <= ALIKE)]
    if turning:
        spread = max(turning) / min(turning)
        out.append(
            (f"k_r of 4 and 24 feet within 5 %: {100 * (spread - 1):.1f} %", spread <= ALIKE)
        )
    return out


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", metavar="OUT", type=Path)
    much = parser.add_mutually_exclusive_group()
    much.add_argument("--quick", action="store_true", help="k_t alone, to 5 %%")
    much.add_argument("--more", action="store_true", help="other delays")
    args = parser.parse_args()
    delays: tuple[float | None, ...] = (None, 0.0, 2e-3) if args.more else (None,)
    print(machine())
    print("| delay | feet | press | k_t, N/m | bound | k_r, N m/rad | bound |")
    rows = []
    for delay_s in delays:
        for feet in FEET:
            rows.append(measure(feet, delay_s, args.quick))
            print(show(rows[-1]), flush=True)
    found = claims(rows)
    for text, holds in found:
        print(f"{'PASS' if holds else 'FAIL'} {text}")
    if args.json is not None:
        args.json.write_text(json.dumps([asdict(row) for row in rows], indent=2), encoding="ascii")
    return 0 if all(holds for _, holds in found) else 1


if __name__ == "__main__":
    raise SystemExit(main())
