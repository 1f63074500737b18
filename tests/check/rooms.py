"""The rooms and their arrows: which room includes or imports which, drawn; fails on an arrow that is not in the table.

    rooms.py [ROOT]

A row of the table names a room and the rooms it uses, all of which stand above it: a room never uses its caller's. An
arrow of the table that nothing uses any more is a breach too, so that the drawing is the truth.
"""

from __future__ import annotations

import ast
import re
import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path

Rooms = Mapping[str, tuple[str, ...]]
Arrows = Counter[tuple[str, str]]

C_ROOMS: Rooms = {
    "sim": (),
    "sim/port/linux": ("sim",),
    "firmware": (),
    "firmware/contact": ("firmware",),
    "firmware/servo": ("firmware", "firmware/contact"),
    "firmware/couple": ("firmware", "firmware/contact"),
    "firmware/rivals": ("firmware/contact",),
    "firmware/port/linux": ("firmware", "firmware/servo"),
    "firmware/port/cortex-m7": ("firmware", "firmware/contact"),
    "host/native": ("sim", "firmware", "firmware/contact", "firmware/couple"),
    "host/native/surface": ("host/native",),
    "host/native/arrange": ("host/native",),
}
"""`firmware` and `host/native` themselves hold the headers of what lies below."""

PYTHON_ROOMS: Rooms = {
    "_native": (),
    "_sim": (),
    "base": ("_native",),
    "mesh": ("base",),
    "bake": ("_native", "base", "mesh"),
    "replay": ("base", "bake"),
    "bus": ("_sim", "base"),
    "loop": ("_sim", "base", "mesh", "bake", "replay", "bus"),
    "crease": ("base", "mesh", "bake", "replay", "loop"),
    "draw": ("base", "mesh", "bake", "replay"),
    "live": ("base", "bake", "replay", "loop", "draw"),
    "lab": ("base", "mesh", "bake", "replay", "draw"),
    "verbs": ("_sim", "base", "mesh", "bake", "replay", "bus", "loop", "draw", "live", "lab"),
    "cli": ("base", "verbs"),
}
"""`_native` and `_sim` are the C extensions, `crease` the package's page of names, `cli` the files beside it."""

INCLUDE = re.compile(r'^\s*#\s*include\s+"([^"]+)"', re.MULTILINE)
INCLUDE_FROM = [room for room in C_ROOMS if room.count("/") != 1 or room == "host/native"]
"""Rooms whose headers are named alone; those of contact, servo, couple and rivals are named with their room."""


def c_arrows(root: Path) -> Iterator[tuple[Path, str, str]]:
    """File, its room, and the room of each header of ours that it includes.   Errors: KeyError for no such header."""
    for top in ("sim", "firmware", "host/native"):
        for file in sorted((root / top).rglob("*.[ch]")):
            room = file.parent.relative_to(root).as_posix()
            for name in INCLUDE.findall(file.read_text(encoding="utf-8")):
                folders = (file.parent, *(root / folder for folder in INCLUDE_FROM))
                found = [folder / name for folder in folders if (folder / name).exists()]
                if not found:
                    raise KeyError(f"{file}: {name} is in no room")
                yield file, room, found[0].parent.relative_to(root).as_posix()


def room_of_module(package: Path, module: str) -> str:
    """Room of a dotted name under `crease`."""
    first = module.split(".")[1] if "." in module else "crease"
    if first.startswith("_") and first != "__main__":
        return first
    return first if (package / first).is_dir() else "crease" if first == "crease" else "cli"


def imports(package: Path, file: Path) -> Iterator[str]:
    """Modules of `crease` that a file imports, wherever in the file."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (a.name for a in node.names if a.name.split(".")[0] == "crease")
        elif isinstance(node, ast.ImportFrom) and node.module == "crease":
            for a in node.names:
                is_module = (package / a.name).is_dir() or (package / f"{a.name}.py").exists()
                yield f"crease.{a.name}" if is_module or a.name in PYTHON_ROOMS else "crease"
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("crease."):
            yield str(node.module)
        elif isinstance(node, ast.JoinedStr) and isinstance(node.values[0], ast.Constant):
            first = str(node.values[0].value)
            if first.startswith("crease.") and first.endswith("."):  # f"crease.room.{name}"
                yield first.removesuffix(".")


def python_arrows(root: Path) -> Iterator[tuple[Path, str, str]]:
    """File, its room, and the room of each module of ours that it imports."""
    package = root / "host/crease"
    for file in sorted(package.rglob("*.py")):
        inside = file.relative_to(package)
        room = inside.parts[0] if len(inside.parts) > 1 else "cli"
        room = "crease" if inside.name == "__init__.py" and len(inside.parts) == 1 else room
        yield from ((file, room, room_of_module(package, name)) for name in imports(package, file))


def find_breaches(
    rooms: Rooms, arrows: Iterator[tuple[Path, str, str]]
) -> tuple[list[str], Arrows]:
    """One line for each breach, and how many files' lines make each arrow."""
    order = list(rooms)
    breaches = [
        f"table: {room} uses {used}, which does not stand above it"
        for room, uses in rooms.items()
        for used in uses
        if used not in order[: order.index(room)]
    ]
    count: Arrows = Counter()
    for file, room, used in arrows:
        if used == room:
            continue
        count[room, used] += 1
        if used not in rooms.get(room, ()):
            back = {room, used} <= set(order) and order.index(used) > order.index(room)
            how = "back" if back else "out of the table"
            breaches.append(f"{file}: the arrow {room} -> {used} runs {how}")
    breaches += [
        f"table: no file of {room} uses {used} any more"
        for room, uses in rooms.items()
        for used in uses
        if not count[room, used]
    ]
    return breaches, count


def draw(rooms: Rooms, count: Arrows) -> str:
    """A row for each room: what it uses, and how often."""
    wide = max(map(len, rooms))
    rows = []
    for room in rooms:
        uses = ", ".join(f"{used} {n}" for (of, used), n in sorted(count.items()) if of == room)
        rows.append(f"  {room:{wide}}  -> {uses}" if uses else f"  {room}")
    return "\n".join(rows)


def main(arguments: list[str]) -> int:
    """Command line: see above."""
    root = Path(arguments[0]) if arguments else Path()
    failed = 0
    for title, rooms, arrows in (
        ("C, lines that include", C_ROOMS, c_arrows(root)),
        ("Python, lines that import", PYTHON_ROOMS, python_arrows(root)),
    ):
        breaches, count = find_breaches(rooms, arrows)
        print(f"rooms: {title}\n{draw(rooms, count)}")
        print("\n".join(breaches), end="\n" if breaches else "")
        failed += len(breaches)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
