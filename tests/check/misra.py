"""MISRA C:2012 by cppcheck's addon, against the deviations of misra.csv.

    misra.py CPPCHECK-OPTION... -- FILE.c...

Fails on a finding that no row allows, and on a row that allows nothing any more.
"""

from __future__ import annotations

import csv
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

DEVIATIONS = Path(__file__).with_suffix(".csv")
FINDING = re.compile(r"^(\S+?):(\d+): misra-c2012-([\d.]+)$", re.MULTILINE)


def read_deviations() -> dict[str, set[str]]:
    """Files in which a rule is not kept, by rule; "*" for all of them."""
    with DEVIATIONS.open(newline="", encoding="ascii") as file:
        rows = list(csv.DictReader(file))
    if missing := [row["rule"] for row in rows if len(row["reason"] or "") < 10]:
        sys.exit(f"{DEVIATIONS}: rule {missing[0]} is given no reason")
    return {row["rule"]: set(row["files"].split(";")) for row in rows}


def find(options: list[str], sources: list[str]) -> list[tuple[str, int, str]]:
    """What the addon finds: file, line, rule."""
    command = ["cppcheck", "--quiet", "--addon=misra", "--enable=style", "--inline-suppr"]
    command += ["--template={file}:{line}: {id}", *options, *sources]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    found = [(name, int(line), rule) for name, line, rule in FINDING.findall(result.stderr)]
    if result.returncode != 0 or not found:
        sys.exit(f"cppcheck did not check MISRA rules:\n{result.stdout}{result.stderr}")
    return found


def main(arguments: list[str]) -> int:
    """Command line: see above."""
    at = arguments.index("--")
    allowed = read_deviations()
    found = find(arguments[:at], arguments[at + 1 :])
    used: Counter[tuple[str, str]] = Counter()
    breaches = []
    for name, line, rule in found:
        files = allowed.get(rule, set())
        file = "*" if "*" in files else Path(name).name
        if file in files:
            used[rule, file] += 1
        else:
            breaches.append(f"{name}:{line}: MISRA C:2012 rule {rule}")
    for rule, files in allowed.items():
        breaches += [
            f"{DEVIATIONS.name}: rule {rule}: no finding in {file} any more"
            for file in sorted(files)
            if not used[rule, file]
        ]
    summary = f"misra: {len(found)} findings, {len(allowed)} rules deviated from with reasons"
    print("\n".join(breaches) if breaches else summary)
    return 1 if breaches else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
