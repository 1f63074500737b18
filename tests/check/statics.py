"""No variable outlives a call: fails on every writable static or global of the sources, thread-local ones too.

The host calls this code from several threads at once, and the firmware has all its memory from the caller. Tables of
constants are fine.

    statics.py COMPILER OPTION... -- FILE.c...
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

WRITABLE = frozenset("bBcCdDsS")
"""Letters of nm for symbols of data that can be written: zeroed, common, initialised, small."""


def find_statics(compiler: list[str], sources: list[Path]) -> list[str]:
    """One line for each variable.   Errors: CalledProcessError when a source does not compile."""
    found: list[str] = []
    for source in sources:
        with tempfile.TemporaryDirectory() as folder:
            made = Path(folder) / "made.o"
            # Without optimisation none is folded away; in a shared library constant tables of pointers would count.
            options = ["-O0", "-fno-pic", "-fno-pie", "-c", str(source), "-o", str(made)]
            subprocess.run([*compiler, *options], check=True)
            listed = subprocess.run(["nm", made], check=True, capture_output=True, text=True).stdout
        symbols = [line.split()[-2:] for line in listed.splitlines()]
        found += [f"{source}: static {name}" for letter, name in symbols if letter in WRITABLE]
    return found


def main(arguments: list[str]) -> int:
    """Command line: see above."""
    at = arguments.index("--")
    found = find_statics(arguments[:at], [Path(name) for name in arguments[at + 1 :]])
    print("\n".join(found) if found else "statics: none")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
