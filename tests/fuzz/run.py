"""Runs every fuzz target for its share of the time, seeds first; fails on a crash, or when a target did no work."""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
SECONDS_MIN = 2
"""A shorter run tries nothing but the seeds."""

RUNS = re.compile(r"^stat::number_of_executed_units:\s+(\d+)", re.MULTILINE)
COVER = re.compile(r"cov: (\d+)")


@dataclass(frozen=True)
class Target:
    """share: part of the time. options: of libFuzzer. seeds: more than those of the target's folder."""

    name: str
    share: float
    options: Sequence[str] = ()
    seeds: Sequence[Path] = ()


TARGETS = (
    Target("scene", 0.20, ["-max_len=16384", "-len_control=0"]),
    Target("scene_scalar", 0.10, ["-max_len=16384", "-len_control=0"]),
    Target("servo", 0.26, ["-max_len=400"]),
    Target("recording", 0.12, ["-max_len=220000", "-len_control=0"]),
    Target(
        "device",
        0.10,
        ["-max_len=6000", f"-dict={HERE / 'device.dict'}"],
        [ROOT / "firmware" / "port" / "linux" / "device.toml"],
    ),
    Target("drive", 0.06, ["-max_len=1200"]),
    Target("bitrate", 0.03, ["-max_len=300"]),
    Target("csv", 0.03, ["-max_len=700"]),
    Target("path", 0.10, ["-max_len=1200", f"-dict={HERE / 'path.dict'}"]),
)


def command_of(target: Target, build: Path) -> list[str]:
    """The program of a target, without libFuzzer's options."""
    if target.name == "path":
        return [sys.executable, str(HERE / "fuzz_path.py")]
    return [str(build / f"fuzz_{target.name}")]


def run(target: Target, build: Path, seconds: int) -> tuple[bool, str]:
    """One target: whether it went well, and a line about it."""
    corpus, crashes = build / "corpus" / target.name, build / "crashes"
    corpus.mkdir(parents=True, exist_ok=True)
    crashes.mkdir(parents=True, exist_ok=True)
    for seed in target.seeds:
        (corpus / seed.name).write_bytes(seed.read_bytes())
    seeds = HERE / "seeds" / target.name
    command = [
        *command_of(target, build),
        f"-max_total_time={seconds}",
        "-timeout=10",
        "-rss_limit_mb=2048",
        "-print_final_stats=1",
        f"-artifact_prefix={crashes / target.name}-",
        *target.options,
        str(corpus),
        *([str(seeds)] if seeds.is_dir() else []),
    ]
    result = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, errors="replace", check=False
    )
    output = result.stdout + result.stderr
    found, cover = RUNS.search(output), COVER.findall(output)
    runs = int(found[1]) if found else 0
    good = result.returncode == 0 and runs > 0
    (build / f"{target.name}.log").write_text(output)
    (build / f"{target.name}.count").write_text(f"{target.name},{seconds},{runs}\n")
    verdict = "ok" if good else f"FAILED: {build / target.name}.log, reproducer in {crashes}"
    line = f"fuzz_{target.name:10} {seconds:5} s {runs:9} runs, {cover[-1] if cover else 0:>5} edges: {verdict}"
    return good, line if good else line + "\n" + output[-3000:]


def main() -> int:
    """Command line: see the Makefile."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--build", type=Path, required=True, help="folder of the targets")
    parser.add_argument("--seconds", type=float, default=60.0, help="of the clock, in all")
    parser.add_argument("--jobs", type=int, default=2, help="targets at a time")
    parser.add_argument("--only", choices=[t.name for t in TARGETS], help="one target alone")
    parser.add_argument("--keep", type=Path, help="ledger to which seconds and runs are added")
    args = parser.parse_args()
    targets = [t for t in TARGETS if args.only in (None, t.name)]
    whole = sum(t.share for t in targets)
    jobs = min(args.jobs, len(targets))
    with ThreadPoolExecutor(jobs) as pool:

        def start(target: Target) -> tuple[bool, str]:
            share = args.seconds * jobs * target.share / whole
            good, line = run(target, args.build.resolve(), max(SECONDS_MIN, int(share)))
            print(line, flush=True)
            return good, line

        results = list(pool.map(start, targets))
    failed = sum(not good for good, _ in results)
    if args.keep and not failed:
        with args.keep.open("a", encoding="ascii") as ledger:
            ledger.writelines((args.build / f"{t.name}.count").read_text() for t in targets)
    print(f"fuzz: {len(results) - failed} of {len(results)} targets without a crash", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
