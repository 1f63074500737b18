"""Rules on the shape of the sources that no compiler warning covers: fails on the first list of breaches.

Firmware: no recursion, over all files together; no call through a pointer; no array of variable length; no function
pointer. Every room, tests too: no file of more than 600 lines.

    structure.py COMPILER OPTION... -- FILE.c...
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

LINES_MAX = 600
ROOMS = ("firmware", "host", "meshes", "sim", "tests")
SUFFIXES = {".c", ".cpp", ".css", ".h", ".html", ".js", ".py"}

INDIRECT = "__indirect_call"
STACKS_ALLOWED = {"static", "dynamic,bounded"}
"""bounded: the compiler made room for arguments of a call."""

NODE = re.compile(r'node: \{ title: "([^"]+)" label: "[^"]*\(([a-z,]+)\)" \}')
EDGE = re.compile(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"')
POINTER = re.compile(r"\(\s*\*\s*(?:const\s+)?(\w+)\s*(?:\[[^\]]*\])?\s*\)\s*\(")


def read_graph(files: Iterable[Path]) -> tuple[dict[str, set[str]], dict[str, str]]:
    """Who calls whom, and how each function's stack grows, over all files."""
    calls: dict[str, set[str]] = {}
    stacks: dict[str, str] = {}
    for file in files:
        text = file.read_text()
        for name, stack in NODE.findall(text):
            calls.setdefault(name, set())
            stacks[name] = stack
        for source, target in EDGE.findall(text):
            calls.setdefault(source, set()).add(target)
    return calls, stacks


def find_cycle(calls: dict[str, set[str]]) -> list[str]:
    """A chain of calls that comes back to where it began; empty when there is none."""
    done: set[str] = set()
    for start in sorted(calls):
        path: list[str] = []
        work = [(start, False)]
        while work:
            name, leaving = work.pop()
            if leaving:
                done.add(path.pop())
            elif name in path:
                return [*path[path.index(name) :], name]
            elif name not in done:
                path.append(name)
                work.append((name, True))
                work += [(callee, False) for callee in sorted(calls.get(name, ()))]
    return []


def find_pointers(file: Path) -> set[tuple[str, str]]:
    """Function pointers that a file declares, by name."""
    text = re.sub(r"/\*.*?\*/|//[^\n]*", "", file.read_text(), flags=re.DOTALL)
    return {(str(file), name) for name in POINTER.findall(text)}


def find_breaches(compiler: list[str], sources: list[Path]) -> list[str]:
    """One line for each breach."""
    breaches: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        for source in sources:
            # Without optimisation every call is still there.
            made = Path(folder) / source.with_suffix(".o").name
            options = ["-O0", "-Wvla", "-Werror=vla", "-fcallgraph-info=su", "-c", str(source)]
            subprocess.run([*compiler, *options, "-o", str(made)], check=True)
        graphs = sorted(Path(folder).glob("*.ci"))
        calls, stacks = read_graph(graphs)
    if len(graphs) != len(sources) or len(calls) < len(sources):
        return ["no call graph: the compiler has no -fcallgraph-info"]
    if cycle := find_cycle(calls):
        breaches.append("recursion: " + " -> ".join(cycle))
    breaches += [
        f"{name}: calls through a pointer"
        for name, targets in sorted(calls.items())
        if INDIRECT in targets
    ]
    breaches += [
        f"{name}: its stack is {stack}"
        for name, stack in sorted(stacks.items())
        if stack not in STACKS_ALLOWED
    ]
    folders = {folder for source in sources for folder in source.parents[:2]}
    headers = {header for folder in folders for header in folder.glob("*.h")}
    found = set().union(*(find_pointers(file) for file in {*sources, *headers}))
    breaches += [f"{file}: function pointer {name}" for file, name in sorted(found)]
    return breaches


def find_long(root: Path) -> list[str]:
    """One line for each source file under `root` that is too long."""
    breaches = []
    for room in ROOMS:
        for file in sorted((root / room).rglob("*")):
            if file.suffix in SUFFIXES and file.is_file():
                lines = file.read_bytes().count(b"\n")
                if lines > LINES_MAX:
                    breaches.append(
                        f"{file}: {lines} lines, more than {LINES_MAX}: split it by subject"
                    )
    return breaches


def main(arguments: list[str]) -> int:
    """Command line: see above."""
    at = arguments.index("--")
    breaches = find_breaches(arguments[:at], [Path(name) for name in arguments[at + 1 :]])
    breaches += find_long(Path())
    print("\n".join(breaches) if breaches else "structure: sound")
    return 1 if breaches else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
