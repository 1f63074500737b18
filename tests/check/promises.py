"""`make promises`: what README.md and the specifications promise, and the tests that show it; fails on a gap.

    promises.py [--count]

promises.toml has a row for each promise: words of a page, and what shows them: `FILE::test`, of pytest or of cmocka, or
`make TARGET` that continuous integration runs. A gap is a row whose words no page has any more, that nothing shows, or
that names a test which is not there; and a paragraph, table or point of README.md that no row speaks of.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ROWS = Path(__file__).with_suffix(".toml")
README = "README.md"
WORDS_MIN = 9
"""Shorter blocks are headings and captions."""


@dataclass(frozen=True)
class Promise:
    """Words of a page and what shows them; `told`: why there is nothing to show."""

    page: str
    says: str
    by: tuple[str, ...]
    told: str = ""


def flat(text: str) -> str:
    """On one line, without what a table or a list puts between words."""
    return " ".join(text.split())


def read_promises(file: Path = ROWS) -> list[Promise]:
    """The rows.   Errors: ValueError for an unknown word in one."""
    found = []
    for row in tomllib.loads(file.read_text("utf-8"))["promise"]:
        if unknown := row.keys() - {"page", "says", "by", "told"}:
            raise ValueError(f"{file.name}: {sorted(unknown)[0]} is no word of a promise")
        found.append(
            Promise(
                row.get("page", README),
                flat(row["says"]),
                tuple(row.get("by", ())),
                row.get("told", ""),
            )
        )
    return found


def blocks(text: str) -> list[str]:
    """Paragraphs, tables and points of a list that say something; code is shown by being run."""
    bare = re.sub(r"```.*?```|<!--.*?-->", "", text, flags=re.DOTALL)
    found: list[str] = []
    for block in re.split(r"\n\s*\n", bare):
        if block.lstrip().startswith(("#", "![")) or block.startswith("    "):
            continue
        points = re.split(r"\n(?=- )", block.strip())
        found += [flat(point) for point in points if len(point.split()) >= WORDS_MIN]
    return found


def run_targets() -> set[str]:
    """Targets that continuous integration runs, as they are or in their quick forms."""
    show = ["make", "-s", "-C", str(ROOT), "--eval", "show: ; @echo $(CI_TARGETS) $(QUICK_TARGETS)"]
    said = subprocess.run([*show, "show"], capture_output=True, text=True, check=True)
    return set(said.stdout.split())


def missing(what: str, targets: set[str]) -> str | None:
    """Why `what` shows nothing; null when it does."""
    if what.startswith("make "):
        return None if what[5:] in targets else "continuous integration runs no such target"
    name, _, test = what.partition("::")
    file = ROOT / name
    if not file.is_file():
        return "there is no such file"
    text = file.read_text("utf-8")
    if file.suffix == ".c":
        return None if f"cmocka_unit_test({test}" in text else "cmocka runs no such test there"
    return None if re.search(rf"^def {re.escape(test)}\(", text, re.M) else "there is no such test"


def gaps(promises: Sequence[Promise], root: Path = ROOT) -> list[str]:
    """One line for each."""
    targets, found = run_targets(), []
    pages = {p.page: flat((root / p.page).read_text("utf-8")) for p in promises}
    for promise in promises:
        where = f"{promise.page}: {promise.says[:60]!r}"
        if promise.says not in pages[promise.page]:
            found.append(f"{where}: the page does not say so any more")
        if not promise.by and not promise.told:
            found.append(f"{where}: no test shows it")
        absent = [(what, missing(what, targets)) for what in promise.by]
        found += [f"{where}: {what}: {why}" for what, why in absent if why]
    said = [p.says for p in promises if p.page == README]
    unsaid = [
        b for b in blocks((root / README).read_text("utf-8")) if not any(w in b for w in said)
    ]
    found += [f"{README}: {b[:60]!r}: no row of {ROWS.name} speaks of it" for b in unsaid]
    return found


def main(arguments: Sequence[str]) -> int:
    """Command line: see above."""
    parser = argparse.ArgumentParser(description="promises and the tests that show them")
    parser.add_argument("--count", action="store_true", help="no table, the count only")
    args = parser.parse_args(arguments)
    promises = read_promises()
    if not args.count:
        print("| page | promise | shown by |\n|---|---|---|")
        for p in promises:
            print(f"| {p.page} | {p.says.replace('|', '/')} | {'<br>'.join(p.by) or p.told} |")
    found = gaps(promises)
    for line in found:
        print(f"gap: {line}", file=sys.stderr)
    shown = {what for p in promises for what in p.by}
    print(
        f"promises: {sum(bool(p.by) for p in promises)} shown by {len(shown)} tests and targets, {len(found)} gaps"
    )
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
