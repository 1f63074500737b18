"""Stability of the loop: what the simulator does against what theory says.

    python tests/bench/loop.py [--json OUT] [--figure OUT.png] [--more | --quick] [--processes N]

1. Self-test: the rigid device, free or held by a hand, against the textbook virtual wall on axis X, sampled and held at
1 kHz with a delay. The largest stiffness that settles must lie within 5 % of K = b / (T / 2 + td) and of the
eigenvalues of the sampled loop.
2. The loop in contact (loop_contact.py): dragged round an edge and over a corner; largest stiffness at each place.
It ends with one line for each claim, and fails when one does not hold.
"""

from __future__ import annotations

import argparse
import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path

import loop_report
import numpy as np
import numpy.typing as npt
from crease.bus.drives import Mech, Params
from crease.lab.setup import machine
from loop_contact import DEFAULT, MORE, QUICK
from loop_report import Claim
from scipy.linalg import expm

F64 = npt.NDArray[np.float64]

MASS_KG, VISCOUS_NS_M, PERIOD_S = 5.4, 3.5, 1e-3
"""Guide X of the default device."""
SELF_TEST_SHARE = 0.05
SECONDS = 6
"""Long enough for a growth of 5 % in stiffness to show."""


@dataclass(frozen=True)
class Case:
    """One row: delay s, and the hand kg, N s/m, N/m (zeros: nobody)."""

    delay_s: float
    hand: tuple[float, float, float] = (0.0, 0.0, 0.0)


CASES = (Case(0.0), Case(1e-3), Case(2e-3), Case(5e-3), Case(1e-3, (0.8, 5.5, 30.0)))


def formula_N_m(case: Case) -> float:
    """K = b / (T / 2 + td), the hand's damping counted in."""
    return (VISCOUS_NS_M + case.hand[1]) / (0.5 * PERIOD_S + case.delay_s)


def sampled_loop(case: Case, stiffness_N_m: float) -> F64:
    """State matrix of the loop from sample to sample: x, v, and the forces on their way."""
    mass, viscous = MASS_KG + case.hand[0], VISCOUS_NS_M + case.hand[1]
    plant = np.array(
        [[0.0, 1.0, 0.0], [-case.hand[2] / mass, -viscous / mass, 1.0 / mass], [0.0, 0.0, 0.0]]
    )
    held = expm(plant * PERIOD_S)
    count = round(case.delay_s / PERIOD_S)
    loop = np.zeros((2 + count, 2 + count))
    loop[:2, :2] = held[:2, :2]
    spring = np.zeros(2 + count)
    spring[0] = -stiffness_N_m
    if count == 0:
        loop[:2, :] += np.outer(held[:2, 2], spring)
        return loop
    loop[:2, -1] = held[:2, 2]  # the oldest force acts
    loop[2, :] = spring
    for i in range(1, count):
        loop[2 + i, 1 + i] = 1.0
    return loop


def eigenvalue_N_m(case: Case) -> float:
    """Largest stiffness with every eigenvalue inside the unit circle."""
    low, high = 1.0, 1e5
    while high / low > 1.0001:
        middle = float(np.sqrt(low * high))
        if np.abs(np.linalg.eigvals(sampled_loop(case, middle))).max() < 1.0:
            low = middle
        else:
            high = middle
    return low


def settles(case: Case, stiffness_N_m: float) -> bool:
    """The simulated device, pushed once, comes to rest at the wall."""
    values = {"torque_delay_s": case.delay_s, "hand_mass_kg": case.hand[0]}
    values |= {"hand_damping_Ns_m": case.hand[1], "hand_stiffness_N_m": case.hand[2]}
    mech = Mech(Params(True, None, **values))
    mech.kick(0, 0.01)
    count = round(SECONDS / PERIOD_S)
    swing = np.abs(mech.wall(0, stiffness_N_m, count))
    early, late = swing[count // 10 : count // 3].max(), swing[-count // 4 :].max()
    return bool(swing[-2:].any() and late < early)


def simulated_N_m(case: Case) -> float:
    """Largest stiffness that settles, to 1 %."""
    low, high = 0.5 * formula_N_m(case), 2.0 * formula_N_m(case)
    while high / low > 1.01:
        middle = float(np.sqrt(low * high))
        if settles(case, middle):
            low = middle
        else:
            high = middle
    return float(np.sqrt(low * high))


@dataclass(frozen=True)
class Result:
    """Stiffness in N/m by three ways."""

    delay_ms: float
    hand: str
    formula: float
    eigenvalue: float
    simulated: float

    @property
    def error(self) -> float:
        """Of the simulator, as a share of theory: the larger one."""
        return max(
            abs(self.simulated / self.eigenvalue - 1.0), abs(self.simulated / self.formula - 1.0)
        )


def self_test() -> list[Result]:
    """Every case."""
    return [
        Result(
            1e3 * case.delay_s,
            "{:g} kg {:g} N s/m {:g} N/m".format(*case.hand) if case.hand[0] else "free",
            formula_N_m(case),
            eigenvalue_N_m(case),
            simulated_N_m(case),
        )
        for case in CASES
    ]


def print_self_test(results: list[Result]) -> None:
    """The table of part 1."""
    print(f"largest stable stiffness of guide X, N/m (rigid, {VISCOUS_NS_M} N s/m, 1 kHz)")
    print(
        f"{'delay':>6s}  {'hand':28s} {'b/(T/2+td)':>10s} {'eigenvalue':>10s} {'simulated':>10s}  error"
    )
    for r in results:
        print(
            f"{r.delay_ms:3.0f} ms  {r.hand:28s} {r.formula:10.0f} {r.eigenvalue:10.0f} "
            f"{r.simulated:10.0f}  {r.error:.1%}"
        )


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", metavar="OUT", type=Path)
    parser.add_argument("--figure", metavar="OUT.png", type=Path)
    extents = {"more": MORE, "quick": QUICK, "default": DEFAULT}
    much = parser.add_mutually_exclusive_group()
    much.add_argument(
        "--more",
        dest="extent",
        action="store_const",
        const="more",
        help="more speeds, hands and delays",
    )
    much.add_argument(
        "--quick",
        dest="extent",
        action="store_const",
        const="quick",
        help="one speed, one hand, one edge",
    )
    parser.set_defaults(extent="default")
    parser.add_argument(
        "--responses", action="store_true", help="instead: buzz, turn and energy of four responses"
    )
    parser.add_argument("--processes", type=int, default=min(os.cpu_count() or 1, 4))
    args = parser.parse_args()
    print(f"{machine()}\n")
    if args.responses:
        loop_report.print_dragged(loop_report.responses_table())
        return 0
    results = self_test()
    print_self_test(results)
    worst = max(r.error for r in results)
    claims = [
        Claim(
            "simulator within 5 % of theory", worst <= SELF_TEST_SHARE, f"worst {worst:.1%}", "5 %"
        )
    ]
    contact = loop_report.run(extents[args.extent], args.processes, args.figure)
    claims += contact.claims
    print()
    for claim in claims:
        print(claim)
    if args.json:
        report = {"self_test": [asdict(r) for r in results], **contact.tables}
        args.json.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    return 0 if all(claim.holds for claim in claims) else 1


if __name__ == "__main__":
    raise SystemExit(main())
