"""`make evidence`: the figures of firmware/EVIDENCE.md, MISRA.md and MEMORY.md, from what other commands measured.

evidence.py [--quick]

--quick: makes every figure that takes seconds, and writes nothing.
"""

from __future__ import annotations

import argparse
import csv
import re
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import misra
import promises
from callgraph import interrupted, read_graph, worst_chain

ROOT = Path(__file__).resolve().parents[2]
FIRMWARE = ROOT / "firmware"
COVERAGE = ROOT / "build/coverage/summary.txt"
PROVED = ROOT / "build/proved.csv"
SCENE = ROOT / "build/scenes/edge90_cube.crs"
SMALL = ("CR_CLUSTERS_MAX=128", "CR_AREAS_MAX=4", "CR_ZONES_MAX=4")
CONFIGURATIONS = (
    ("Cortex-M7", "m7", ()),
    ("Cortex-M7, small", "m7", SMALL),
    ("Cortex-M4 with FPU", "m4f", ()),
    ("Cortex-M55", "m55", ()),
)
"""Name, processor of device.mk, settings."""
SIZES = """#include "servo.h"
#include <stdio.h>
#include <stdlib.h>
int main(int argc, char **argv) {
    FILE *file = fopen(argv[argc - 1], "rb");
    static _Alignas(64) unsigned char image[1 << 23];
    const size_t size = file != NULL ? fread(image, 1, sizeof image, file) : 0u;
    cr_scene scene;
    if (cr_scene_open(&scene, image, size) != CR_OK) return 1;
    cr_servo_config config = cr_servo_config_default();
    config.world = cr_config_default();
    printf("%zu %zu %zu", cr_world_size(&scene, &config.world), cr_servo_size(&scene, &config), sizeof(cr_output));
    return 0;
}
"""


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A table of Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)


def rows_of(file: Path) -> list[dict[str, str]]:
    """A CSV.   Errors: SystemExit when it is not there."""
    if not file.exists():
        raise SystemExit(
            f"error: {file.relative_to(ROOT)} is not there: run the command that leaves it first"
        )
    with file.open(newline="", encoding="ascii") as text:
        return list(csv.DictReader(text))


def call(words: Sequence[object], cwd: Path = ROOT) -> str:
    """Output of a command.   Errors: SystemExit with what it said."""
    said = subprocess.run(
        [str(w) for w in words], cwd=cwd, capture_output=True, text=True, check=False
    )
    if said.returncode != 0:
        raise SystemExit(f"error: {words[0]}: {said.stderr.strip()[-1000:]}")
    return said.stdout


# ---------------------------------------------------------------------------------------------------------- tables


def figures() -> str:
    """The table that comes first."""
    shown = promises.read_promises()
    tests = {what for p in shown for what in p.by}
    proved = rows_of(PROVED)
    if not COVERAGE.exists():
        raise SystemExit(
            "error: build/coverage/summary.txt is not there: run make coverage-firmware first"
        )
    covered = dict(re.findall(r"^(lines|branches): ([\d.]+)%", COVERAGE.read_text("utf-8"), re.M))
    fuzzed = sum(float(row["seconds"]) for row in rows_of(ROOT / "tests/fuzz/hours.csv")) / 3600
    properties = sum(int(row["properties"]) for row in proved)
    reached = f"{covered['lines']} %, {covered['branches']} %"
    return table(
        ("what", "figure", "command"),
        [
            ("promises of the pages, each with a test", f"{len(shown)} by {len(tests)}", "`make promises`"),
            ("properties proved", f"{properties} in {len(proved)} proofs", "`make prove`"),
            ("lines, branches that unit tests reach", reached, "`make coverage-firmware`"),
            ("rules of MISRA deviated from, with reasons", len(misra.read_deviations()), "`make lint-misra`"),
            ("fuzzing on record", f"{fuzzed:.1f} h of one core", "`make fuzz FUZZ_KEEP=1`"),
        ],
    )  # fmt: skip


def budgets() -> str:
    """Budget and target of each figure."""
    rows = [r for r in rows_of(ROOT / "tests/check/budgets.csv") if r["build"] == "m7"]
    return table(
        ("what, on a Cortex-M7", "budget", "target", "why"),
        [(r["what"], f"{int(r['budget']):,} {r['unit']}", f"{int(r['target']):,}", r["why"]) for r in rows],
    )  # fmt: skip


def poses() -> str:
    """The most expensive poses."""
    rows = rows_of(ROOT / "tests/device/worst_poses.csv")
    return table(
        ("scene", "work of a tick", "instructions"),
        [
            (
                f"`{r['scene']}`",
                "all" if int(r["lookups"]) > 1000 else r["lookups"],
                f"{int(r['instructions']):,}",
            )
            for r in rows
        ],
    )


def fuzz() -> str:
    """Seconds and runs of each target."""
    seconds: Counter[str] = Counter()
    runs: Counter[str] = Counter()
    for row in rows_of(ROOT / "tests/fuzz/hours.csv"):
        seconds[row["target"]] += int(row["seconds"])
        runs[row["target"]] += int(row["runs"])
    rows = [(f"fuzz_{t}", f"{seconds[t]:,}", f"{runs[t]:,}") for t in sorted(seconds)]
    return table(("target", "seconds", "runs"), rows)


def misra_table() -> str:
    """Rules, how often they are deviated from, where, why."""
    sources = sorted(
        str(p.relative_to(ROOT))
        for room in ("contact", "servo", "couple")
        for p in (FIRMWARE / room).glob("*.c")
    )
    options = ["--std=c11", "-D__GNUC__", "-Ifirmware", "--suppress=missingIncludeSystem"]
    found = Counter(rule for _, _, rule in misra.find(options, sources))
    rows = rows_of(misra.DEVIATIONS)
    return table(
        ("rule", "findings", "files", "reason"),
        [
            (
                r["rule"],
                found[r["rule"]],
                r["files"].replace(";", ", ").replace("*", "all"),
                r["reason"],
            )
            for r in rows
        ],
    )


def made_by(text: str) -> list[str]:
    """Words that make knows, such as `$(ARM)gcc`."""
    return call(["make", "-s", "--eval", f"show: ; @echo {text}", "show"]).split()


def memory_row(name: str, cpu: str, settings: Sequence[str], folder: Path) -> list[str]:
    """One configuration, compiled anew."""
    given = made_by(f"$(CPU_{cpu}) $(CORTEX_FLAGS) $(LEVEL) $(CORTEX_INCLUDES)")
    small = made_by("$(SMALL_C)")
    without = [pair.split("=", 1) for pair in made_by("$(WITHOUT)")]
    rare, rarely = made_by("$(RARE_C)"), made_by("$(RARELY)")
    options = [w if not w.startswith("-I") else f"-I{ROOT / w[2:]}" for w in given]
    defines = [f"-D{setting}" for setting in settings]
    sources = sorted(p for room in ("contact", "servo") for p in (FIRMWARE / room).glob("*.c"))
    for source in sources:
        name_of = str(source.relative_to(ROOT))
        level = ["-Os"] * (name_of in small) + rarely * (name_of in rare)
        level += [flag for file, flag in without if file == name_of]
        call(["arm-none-eabi-gcc", *options, *level, *defines, "-c", source], folder)
    total = call(["arm-none-eabi-size", "-t", *sorted(folder.glob("*.o"))]).splitlines()[-1].split()
    allowed = {
        r["symbol"]: int(r["stack_bytes"]) for r in rows_of(ROOT / "tests/check/undefined.csv")
    }
    graph = read_graph(sorted(folder.glob("*.ci")), allowed)
    beside = interrupted(graph, "cr_servo_search", "cr_servo_tick", never="cr_tick")
    stack = [worst_chain(graph).bytes, sum(chain.bytes for chain in beside)]
    (folder / "sizes.c").write_text(SIZES, "ascii")
    host = [
        "gcc",
        "-std=c11",
        "-O2",
        *defines,
        f"-I{FIRMWARE}",
        "sizes.c",
        *sources,
        "-lm",
        "-o",
        "sizes",
    ]
    call(host, folder)
    states = [int(word) for word in call([folder / "sizes", SCENE]).split()]
    numbers = [int(total[0]), int(total[1]) + int(total[2]), *stack, *states]
    return [name, *(f"{n:,}" for n in numbers)]


def memory() -> str:
    """All configurations."""
    rows = []
    for name, cpu, settings in CONFIGURATIONS:
        with tempfile.TemporaryDirectory(prefix="crease-memory-") as folder:
            rows.append(memory_row(name, cpu, settings, Path(folder)))
    head = (
        "configuration, bytes",
        "code",
        "variables",
        "stack",
        "search and interrupt",
        "world",
        "servo with its world",
        "`cr_output`",
    )
    return table(head, rows)


PAGES = {
    "EVIDENCE.md": {"figures": figures, "budgets": budgets, "poses": poses, "fuzz": fuzz},
    "MISRA.md": {"misra": misra_table},
    "MEMORY.md": {"memory": memory},
}
"""Pages of firmware/, and what is between their marks."""


def fill(text: str, mark: str, content: str) -> str:
    """A page with what is between two marks anew.   Errors: ValueError when they are not there."""
    filled, count = re.subn(
        rf"(<!-- {mark}: begin -->\n).*?(<!-- {mark}: end -->)",
        lambda m: m[1] + content + "\n" + m[2],
        text,
        flags=re.DOTALL,
    )
    if count != 1:
        raise ValueError(f"no marks <!-- {mark}: begin --> and end")
    return filled


def between(text: str, mark: str) -> str:
    """What is between two marks of a page."""
    found = re.search(rf"<!-- {mark}: begin -->\n(.*?)\n?<!-- {mark}: end -->", text, re.DOTALL)
    return found[1] if found else ""


def main(arguments: Sequence[str]) -> int:
    """Command line: see above."""
    parser = argparse.ArgumentParser(description="figures of the pages of evidence")
    parser.add_argument("--quick", action="store_true", help="what takes seconds; writes nothing")
    args = parser.parse_args(arguments)
    pages = (
        {"EVIDENCE.md": {"budgets": budgets, "poses": poses, "fuzz": fuzz}} if args.quick else PAGES
    )
    for name, marks in pages.items():
        text = (FIRMWARE / name).read_text("utf-8")
        for mark, make in marks.items():
            text = fill(text, mark, make())
            print(f"{name}: {mark}", flush=True)
        if not args.quick:
            (FIRMWARE / name).write_text(text, "utf-8")
        elif text != (FIRMWARE / name).read_text("utf-8"):
            print(
                f"error: firmware/{name} is not what its commands say: run make evidence",
                file=sys.stderr,
            )
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
