"""`make check-device`: every build replays the goldens to the same hash; cost and size against tests/check/budgets.csv.

Prints one table and ends with status 1 when a hash differs, a budget is exceeded, a firmware object needs a symbol that
is not listed, or the call graph is not bounded. Needs the device builds that `make check-device` makes first.
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt
from callgraph import CallGraphError, Chain, interrupted, read_graph, worst_chain
from jobs import (
    COUPLE_C,
    FIRMWARE_C,
    ROOT,
    STEPS,
    free_rows,
    golden_held_jobs,
    golden_path_job,
    path_job,
    recording_job,
)
from loops import golden_recording
from runs import BUILD, DEVICES, CheckError, Run, build_counter, command, read_line, run_device
from worst import BOARD_LOOKUPS, dearer, measure, read_poses

SCENES = ("corner3_sphere", "edge90_cube", "part_spanner", "bar_u", "groove_block")
LOOP = "closed_loop"
FREE = "free_space"
LOOP_SCENE = CUBE = "edge90_cube"
LATE = {f"{name}_late": name for name in (CUBE, "bar_u", "wall_cube", "groove_block", "step_cube")}
"""Scenes once more with a bound on the work of a tick that searches itself: most answers are late."""
STEPPED = {f"{name}_steps": name for name in (CUBE, "wall_cube", "part_spanner")}
"""And at two rates: one step of the search after each feel."""
HELD = {f"{name}_held": name for name in ("peg_04", "cylinder_edges")}
"""Tools that a hand holds by springs, of meshes/six."""
DIRECT = {f"{name}_direct": name for name in HELD.values()}
"""The same paths by the direct force, for the cost alone."""
GOLDENS = (*SCENES, *LATE, *STEPPED, FREE, LOOP, *HELD)
STRESS = ("wall_cube", "edge120_cube", "edge60_cube", "corner3_cube", "step_cube", "cylinder_ball")
"""More scenes, for the cost alone, with --long."""
FLAGS = ("-std=c11", "-D_POSIX_C_SOURCE=200809L", "-ffp-contract=off", "-fno-math-errno")
HOSTS = {
    **{
        f"{cc} {level}": (cc, level)
        for cc in ("gcc", "clang")
        for level in ("-O0", "-O1", "-O2", "-O3")
    },
    "gcc -O2 scalar": ("gcc", "-O2", "-fno-tree-vectorize"),
    "gcc -O3 native": ("gcc", "-O3", "-march=native"),
    "clang -O3 native": ("clang", "-O3", "-march=native"),
    "gcc -O2 lane by lane": ("gcc", "-O2", "-DCR_SCALAR=1"),
    "aarch64 -O2": ("aarch64-linux-gnu-gcc", "-O2", "-static"),
}
QUICK_HOSTS = (
    "gcc -O2 lane by lane",
    "gcc -O0",
    "gcc -O3 native",
    "clang -O2",
    "clang -O3 native",
    "aarch64 -O2",
)
REFERENCE = "gcc -O2"


@dataclass
class Breaches:
    """Everything that is not as it has to be."""

    lines: list[str] = field(default_factory=list)

    def add(self, line: str) -> None:
        """One more."""
        self.lines.append(line)


# ---------------------------------------------------------------------------------------------------------- runs


def runner_of(name: str) -> Path:
    """Where a host's job runner lies."""
    return BUILD / ("runner " + name).replace(" ", "_")


def build_host(name: str) -> Path:
    """The job runner for Linux, built with one compiler and its options."""
    compiler, *options = HOSTS[name]
    program = runner_of(name)
    sources = [ROOT / f"tests/check/{part}.c" for part in ("replay_hash", "job", "blob")]
    sources += FIRMWARE_C + COUPLE_C
    includes = [f"-I{ROOT / 'firmware'}", f"-I{ROOT / 'tests/check'}"]
    command([compiler, *FLAGS, *options, *includes, *sources, "-lm", "-o", program])
    return program


def run_host(name: str, program: Path, job: Path, made: Path | None = None) -> Run:
    """One job on this machine, or under user-mode emulation."""
    emulator = ["qemu-aarch64"] if name.startswith("aarch64") else []
    return Run(*read_line(command([*emulator, program, job, *([made] if made else [])])))


def write_jobs(names: Iterable[str]) -> dict[str, Path]:
    """The goldens as files."""
    paths = {}
    for name in names:
        paths[name] = BUILD / f"{name}.job"
        if name == LOOP:
            scene = ROOT / "build" / "scenes" / f"{LOOP_SCENE}.crs"
            paths[name].write_bytes(recording_job(scene.read_bytes(), golden_recording(scene)))
        elif name == FREE:
            scene = ROOT / "build" / "scenes" / f"{CUBE}.crs"
            paths[name].write_bytes(path_job(scene.read_bytes(), free_rows()))
        elif name in HELD:
            paths[name].write_bytes(golden_held_jobs(HELD[name])[0])
        elif name in DIRECT:
            paths[name].write_bytes(golden_held_jobs(DIRECT[name])[1])
        elif name in LATE:
            job = golden_path_job(LATE[name], damping_Ns_m=2.0, lookups_max=BOARD_LOOKUPS)
            paths[name].write_bytes(job)
        elif name in STEPPED:
            job = golden_path_job(STEPPED[name], kind=STEPS, damping_Ns_m=2.0)
            paths[name].write_bytes(job)
        else:
            paths[name].write_bytes(golden_path_job(name, damping_Ns_m=2.0))
    return paths


# --------------------------------------------------------------------------------------------------------- checks


def library_objects(build: str) -> list[Path]:
    """Objects of the firmware library of a device build."""
    made = ROOT / "build" / build
    return [made / source.relative_to(ROOT).with_suffix(".o") for source in FIRMWARE_C]


def couple_objects(build: str) -> list[Path]:
    """Objects of libcouple.a, the coupling's library of a device build."""
    made = ROOT / "build" / build
    return [made / source.relative_to(ROOT).with_suffix(".o") for source in COUPLE_C]


def allowed_symbols() -> dict[str, int]:
    """Symbols that the firmware may take from outside, and the stack that they use."""
    with (ROOT / "tests/check/undefined.csv").open(encoding="ascii") as file:
        return {row["symbol"]: int(row["stack_bytes"]) for row in csv.DictReader(file)}


def undefined_symbols(
    objects: Sequence[Path], nm: str = "arm-none-eabi-nm"
) -> dict[str, list[str]]:
    """What each object needs that none of them has."""
    defined: set[str] = set()
    needed: dict[str, list[str]] = {}
    for path in objects:
        for line in command([nm, path]).splitlines():
            kind, name = line.split()[-2:]
            if kind == "U":
                needed.setdefault(path.name, []).append(name)
            else:
                defined.add(name)
    return {path: [name for name in names if name not in defined] for path, names in needed.items()}


def check_symbols(build: str, breaches: Breaches) -> None:
    """Every symbol from outside is in the list."""
    allowed = allowed_symbols()
    for path, names in undefined_symbols(library_objects(build) + couple_objects(build)).items():
        for name in sorted(set(names) - allowed.keys()):
            breaches.add(
                f"{build}: {path} needs {name}, which tests/check/undefined.csv does not allow"
            )


def code_bytes(objects: list[Path]) -> int:
    """Flash of a library: code and constants of all its objects."""
    lines = command(["arm-none-eabi-size", *objects]).splitlines()[1:]
    return sum(int(line.split()[0]) + int(line.split()[1]) for line in lines)


def static_bytes(build: str) -> int:
    """Variables that the libraries themselves have: none, all memory is the caller's."""
    objects = [*library_objects(build), *couple_objects(build)]
    lines = command(["arm-none-eabi-size", *objects]).splitlines()[1:]
    return sum(int(line.split()[1]) + int(line.split()[2]) for line in lines)


def stack_of(build: str, more: Sequence[Path] = ()) -> Chain:
    """The worst chain of the library, and of what calls it in `more` objects.   Errors: CallGraphError."""
    files = [path.with_suffix(".ci") for path in (*library_objects(build), *more)]
    return worst_chain(read_graph(files, allowed_symbols()))


LOOP_OF_BOARD = ("controller", "stm32h743", "fdcan")
"""Files of the port that are the loop of the STM32H743: startup.c has the handlers of those that have none."""


def stack_of_board() -> tuple[Chain, Chain]:
    """The main loop of the STM32H743 and its interrupt over it: a servo that searches beside its ticks never calls
    cr_tick.   Errors: CallGraphError.
    """
    port = ROOT / "build" / "m7" / "firmware" / "port" / "cortex-m7"
    files = [path.with_suffix(".ci") for path in library_objects("m7")]
    files += [port / f"{name}.ci" for name in LOOP_OF_BOARD]
    return interrupted(
        read_graph(files, allowed_symbols()), "main", "board_systick", never="cr_tick"
    )


def combined(runs: dict[str, Run]) -> str:
    """One short hash of a build over the goldens."""
    value = 0
    for name in GOLDENS:
        for text in runs[name].hashes:
            value = (value * 0x100000001B3 + int(text, 16)) & (1 << 64) - 1
    return f"{value:016x}"


def measured_figures(build: str, runs: dict[str, Run], stack: Chain) -> dict[str, int]:
    """What budgets.csv can ask of a device build."""
    figures = {
        "library code": code_bytes(library_objects(build)),
        "code of the coupling": code_bytes(couple_objects(build)),
        "variables of the library": static_bytes(build),
        "state of the world": max(
            run.figures["state"] for name, run in runs.items() if name not in (LOOP, *HELD)
        ),
        "worst stack": stack.bytes,
        "worst stack of the coupling": stack_of(build, couple_objects(build)).bytes,
    }
    if LOOP in runs:
        figures["state of the servo with its world"] = runs[LOOP].figures["state"]
    for name, run in runs.items():
        assert run.ticks is not None
        figures[f"{name} tick max"] = int(run.ticks[:, 0].max())
    for name, scene in HELD.items():
        direct = f"{scene}_direct tick max"
        if direct in figures:
            figures[f"{name} more than direct"] = figures[f"{name} tick max"] - figures[direct]
    feel = {
        name: run.ticks[:, 1 + run.stages.index("feel")]
        for name, run in runs.items()
        if run.ticks is not None
    }
    figures["feel of all replays max"] = int(max(cost.max() for cost in feel.values()))
    steps = [
        int((run.ticks[:, 0] - feel[name]).max())
        for name, run in runs.items()
        if name in STEPPED and run.ticks is not None
    ]
    figures["step of the search max"] = max(steps)
    return figures


def check_budgets(
    build: str, figures: dict[str, int], rows: Sequence[dict[str, str]], breaches: Breaches
) -> None:
    """Every budget of a build is kept; one that nothing was measured for is a breach too."""
    for row in rows:
        if row["build"] != build:
            continue
        value = figures.get(row["what"])
        if value is None:
            breaches.add(f"{build}: {row['what']}: a budget, but nothing was measured")
        elif value > int(row["budget"]):
            breaches.add(
                f"{build}: {row['what']}: {value:,} {row['unit']} exceed {int(row['budget']):,}"
            )


COST_FIXED, COST_WORK = 30_000, 4_500
"""Instructions of the M7 for a tick, and for each unit of the work that it counts: DESIGN.md "On a Cortex-M7"."""
COUNTS, WORK = 18, 12
"""Words of a row of replay_hash's MADE.bin; of these, the work."""


def bound_of(counts: npt.NDArray[np.uint32]) -> npt.NDArray[np.int64]:
    """Instructions that ticks with these counts do not exceed. counts: rows of replay_hash's MADE.bin."""
    return COST_FIXED + COST_WORK * counts[:, WORK].astype(np.int64)


def check_bound(name: str, run: Run, counts: npt.NDArray[np.uint32], breaches: Breaches) -> float:
    """No measured tick exceeds the bound of the tick.   Output: the largest share of it that was used."""
    assert run.ticks is not None
    share = run.ticks[:, 0] / bound_of(counts)
    worst = int(share.argmax())
    if share[worst] > 1.0:
        cost = f"{int(run.ticks[worst, 0]):,} instructions, bound {int(bound_of(counts)[worst]):,}"
        breaches.add(f"{name}: tick {worst}: {cost}")
    return float(share[worst])


def read_budgets() -> list[dict[str, str]]:
    """Rows of tests/check/budgets.csv."""
    with (ROOT / "tests/check/budgets.csv").open(encoding="ascii") as file:
        return list(csv.DictReader(file))


# ---------------------------------------------------------------------------------------------------------- report


def thousands(value: int | None) -> str:
    """1,234 or a dash."""
    return "-" if value is None else f"{value:,}"


def print_table(rows: Sequence[Sequence[str]]) -> None:
    """Columns as wide as their longest entry, the first one to the left."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    for row in rows:
        cells = [
            text.ljust(width) if i < 2 else text.rjust(width)
            for i, (text, width) in enumerate(zip(row, widths, strict=True))
        ]
        print("  ".join(cells).rstrip())


def print_builds(hashes: dict[str, str], figures: dict[str, dict[str, int]]) -> None:
    """The table that the issue asks for."""
    rows = [["build", "hash", f"{CUBE} max", "free max", "flash B", "RAM B", "stack B", ""]]
    for name, value in hashes.items():
        of = figures.get(name, {})
        keys = (
            f"{CUBE} tick max",
            f"{FREE} tick max",
            "library code",
            "state of the servo with its world",
            "worst stack",
        )
        cells = [thousands(of.get(key)) for key in keys]
        rows.append([name, value, *cells, "" if value == hashes[REFERENCE] else "DIFFERS"])
    print_table(rows)


def print_costs(runs: dict[str, Run]) -> None:
    """Instructions of each golden on the M7: all of it, and by stage in the most expensive tick."""
    any_run = next(iter(runs.values()))
    rows = [
        [
            "replay on m7",
            "ticks",
            "median",
            "p99",
            "max",
            "at tick",
            *(f"{s}" for s in any_run.stages),
        ]
    ]
    for name, run in runs.items():
        assert run.ticks is not None
        total = run.ticks[:, 0]
        at = int(total.argmax())
        quantiles = [int(np.quantile(total, q, method="higher")) for q in (0.5, 0.99)]
        cells = [*quantiles, int(total[at]), at, *run.ticks[at, 1:].tolist()]
        rows.append([name, thousands(len(total)), *(thousands(int(cell)) for cell in cells)])
    print_table(rows)


def print_functions(run: Run, count: int = 12) -> None:
    """Where the instructions of the most expensive tick go."""
    assert run.ticks is not None
    total = sum(worst for _, _, worst in run.functions)
    print(f"most expensive tick of {CUBE}, by function:")
    for name, _, worst in run.functions[:count]:
        print(f"  {worst:9,}  {100 * worst / total:4.1f} %  {name}")


def print_budgets(figures: dict[str, int], rows: Sequence[dict[str, str]]) -> None:
    """Measured against budget and target."""
    table = [["budget of m7", "unit", "measured", "budget", "target", ""]]
    for row in rows:
        value = figures.get(row["what"])
        verdict = (
            "not measured"
            if value is None
            else "EXCEEDED"
            if value > int(row["budget"])
            else "target missed"
            if value > int(row["target"])
            else "ok"
        )
        table.append(
            [
                row["what"],
                row["unit"],
                thousands(value),
                thousands(int(row["budget"])),
                thousands(int(row["target"])),
                verdict,
            ]
        )
    print_table(table)


# ------------------------------------------------------------------------------------------------------------ all


def run_hosts(
    names: Sequence[str], jobs: dict[str, Path], breaches: Breaches
) -> dict[str, dict[str, Run]]:
    """Goldens on this machine's builds."""

    def one(name: str) -> dict[str, Run]:
        program = build_host(name)
        return {job: run_host(name, program, path) for job, path in jobs.items() if job in GOLDENS}

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        runs = dict(zip(names, pool.map(one, names), strict=True))
    loop = runs[REFERENCE][LOOP].figures
    if loop["different"]:
        breaches.add(
            f"{LOOP}: {loop['different']} of {loop['ticks']} records came out other than they were recorded"
        )
    return runs


def run_devices(jobs: dict[str, Path]) -> dict[str, dict[str, Run]]:
    """Goldens on the emulated boards; what is not a golden on the M7 only."""
    pairs = [(name, job) for name in DEVICES for job in jobs if job in GOLDENS or name == "m7"]

    def one(pair: tuple[str, str]) -> Run:
        name, job = pair
        made = BUILD / "made_on_m7.bin" if pair == ("m7", LOOP) else None
        return run_device(name, ROOT / "build" / name / "replay.elf", jobs[job], made)

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        done = list(pool.map(one, pairs))
    runs: dict[str, dict[str, Run]] = {name: {} for name in DEVICES}
    for (name, job), run in zip(pairs, done, strict=True):
        runs[name][job] = run
    return runs


def check_bounds(
    jobs: dict[str, Path], runs: dict[str, Run], breaches: Breaches
) -> dict[str, float]:
    """Measured instructions against those that the counts of the same ticks allow."""
    shares = {}
    for name, run in runs.items():
        if name not in (LOOP, *STEPPED, *HELD):
            made = BUILD / f"{name}.counts"
            run_host(REFERENCE, runner_of(REFERENCE), jobs[name], made)
            counts = np.fromfile(made, dtype="<u4").reshape(-1, COUNTS)
            shares[name] = check_bound(name, run, counts, breaches)
    return shares


def check_recording_of_device(jobs: dict[str, Path], breaches: Breaches) -> None:
    """The records that the M7 made are those of this machine, and run again here."""
    job = jobs[LOOP].read_bytes()
    made = (BUILD / "made_on_m7.bin").read_bytes()
    head = job[: len(job) - len(made)]
    mixed = BUILD / "made_on_m7.job"
    mixed.write_bytes(head + made)
    run = run_host(REFERENCE, runner_of(REFERENCE), mixed)
    if len(made) != run.figures["ticks"] * 512 or run.figures["different"]:
        breaches.add(
            f"{LOOP}: {run.figures['different']} records made on the m7 do not run again on this machine"
        )


def main() -> int:
    """Command line: see the Makefile."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--long", action="store_true", help="all compilers and options, and more scenes"
    )
    args = parser.parse_args()
    breaches = Breaches()
    budgets = read_budgets()
    BUILD.mkdir(parents=True, exist_ok=True)
    names = [name for name in HOSTS if args.long or name in (*QUICK_HOSTS, REFERENCE)]
    names.sort(key=lambda name: name != REFERENCE)
    try:
        build_counter()
        jobs = write_jobs((*GOLDENS, *DIRECT, *(STRESS if args.long else ())))
        runs = run_hosts(names, jobs, breaches) | run_devices(jobs)
        check_recording_of_device(jobs, breaches)
        bounds = check_bounds(jobs, runs["m7"], breaches)
        found = read_poses()
        costs = measure(found)
        for line in dearer(found, costs):
            breaches.add(line)
        figures = {}
        for build in DEVICES:
            check_symbols(build, breaches)
            figures[build] = measured_figures(build, runs[build], stack_of(build))
            if build == "m7":
                of_board = [
                    c for f, c in zip(found, costs, strict=True) if f.lookups == BOARD_LOOKUPS
                ]
                figures[build]["tick of the worst poses found"] = max(of_board)
                loop, interrupt = stack_of_board()
                figures[build]["stack of the loop with its interrupt"] = (
                    loop.bytes + interrupt.bytes
                )
            check_budgets(build, figures[build], budgets, breaches)
        stack = stack_of("m7")
    except (CheckError, CallGraphError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    hashes = {name: combined(of) for name, of in runs.items()}
    for name, of in runs.items():
        for job in GOLDENS:
            if of[job].hashes != runs[REFERENCE][job].hashes:
                breaches.add(f"{name}: {job}: another hash than {REFERENCE}")
    print_builds(hashes, figures)
    print()
    print_costs(runs["m7"])
    print(f"largest share of the bound of the tick: {max(bounds.values()):.2f}")
    print()
    print_functions(runs["m7"][CUBE])
    for what, chain in {
        "deepest calls": stack,
        "under the board's interrupt": loop,
        "and in it": interrupt,
    }.items():
        print(f"{what}, {chain.bytes} bytes: " + " > ".join(f"{n} {b}" for n, b in chain.functions))
    print()
    print_budgets(figures["m7"], [row for row in budgets if row["build"] == "m7"])
    for line in breaches.lines:
        print(f"breach: {line}", file=sys.stderr)
    return 1 if breaches.lines else 0


if __name__ == "__main__":
    sys.exit(main())
