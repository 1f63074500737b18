"""Writes THIRD_PARTY.md: what of other authors comes with crease, is linked or is needed, and under which licence.

    python host/backend/third_party.py [--check]

Licences of what a wheel or source archive carries are collected in full from the packages themselves; what is only
needed is named. --check writes nothing and fails when the file is not what would be written; words that other
versions of installed packages have for their licences do not count there.
"""

from __future__ import annotations

import importlib.metadata
import json
import re
import sys
import tomllib
from pathlib import Path
from typing import Any

HOST = Path(__file__).resolve().parent.parent
ROOT = HOST.parent
OUT = HOST / "THIRD_PARTY.md"
NPM = ROOT / "build/npm/node_modules"
GROUPS = ("step", "dask", "mcap", "parquet")
"""Optional groups that users install; the others are for those who test."""
EXPRESSIONS = {
    "OSI Approved :: MIT License": "MIT",
    "OSI Approved :: BSD License": "BSD",
    "OSI Approved :: Apache Software License": "Apache-2.0",
    "OSI Approved :: Python Software Foundation License": "PSF",
}
BUNDLED = (("libode8", "Open Dynamics Engine"), ("libccd2", "libccd, which it uses"))
"""Debian's packages of what the simulator links and `make wheel` puts into the wheel."""
DOC = Path("/usr/share/doc")


def page_libraries() -> list[tuple[str, str, str]]:
    """Name with version, licence and full text of each library that the page carries.

    Errors: SystemExit when `make setup` has not fetched them.
    """
    found = []
    for name in sorted(json.loads((HOST / "package.json").read_text("utf-8"))["dependencies"]):
        folder = NPM / name
        if not folder.is_dir():
            raise SystemExit(f"error: {folder}: is missing; run `make setup`")
        about = json.loads((folder / "package.json").read_text("utf-8"))
        text = (folder / "LICENSE").read_text("utf-8").strip()
        found.append((f"{name} {about['version']}", str(about["license"]), text))
    return found


def bundled() -> list[tuple[str, str, str]]:
    """Package, what it is, and Debian's account of its licences.   Errors: SystemExit when it is not installed."""
    found = []
    for package, about in BUNDLED:
        file = DOC / package / "copyright"
        if not file.exists():
            raise SystemExit(f"error: {file}: is missing; run `make setup`")
        found.append((package, about, file.read_text("utf-8").strip()))
    return found


def meshes() -> list[tuple[str, str, str]]:
    """File, licence and origin of each mesh of others, as meshes/SOURCES.md has them."""
    rows = (ROOT / "meshes/SOURCES.md").read_text("utf-8").splitlines()
    cells = [[c.strip() for c in row.strip("|").split("|")] for row in rows if row.count("|") == 9]
    head = cells[0]
    file, origin, licence = (head.index(name) for name in ("file", "origin", "licence"))
    found, last = [], ""
    for row in cells[2:]:
        last = last if row[origin] == "same" else row[origin]
        found.append((f"meshes/{row[file]}", row[licence], last))
    return found


def licence_of(package: str) -> str:
    """SPDX expression or classifier of a package.   Errors: SystemExit when it is not installed or silent."""
    try:
        about: Any = importlib.metadata.metadata(package)
    except importlib.metadata.PackageNotFoundError as error:
        raise SystemExit(f"error: {package}: is not installed; run `make setup-develop`") from error
    if expression := about.get("License-Expression"):
        return str(expression)
    for line in about.get_all("Classifier") or []:
        kind = line.removeprefix("License :: ")
        if kind in EXPRESSIONS:
            return EXPRESSIONS[kind]
    text = str(about.get("License") or "").strip()
    if text.startswith("The MIT License"):
        return "MIT"
    if not text or "\n" in text or len(text) > 60:
        raise SystemExit(f"error: {package}: does not say its licence; look, and add it here")
    return text


def needed() -> list[str]:
    """Packages that pip installs along, by name."""
    project = tomllib.loads((HOST / "pyproject.toml").read_text("utf-8"))["project"]
    groups = [project["dependencies"], *(project["optional-dependencies"][g] for g in GROUPS)]
    return sorted({re.split(r"[<>=;\[ ]", line)[0] for group in groups for line in group})


def table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """A table of Markdown."""
    lines = [head, tuple("---" for _ in head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def page() -> str:
    """The whole file."""
    libraries, linked = page_libraries(), bundled()
    shipped = [
        (name, licence, "share/crease/page; each page of `crease view`")
        for name, licence, _ in libraries
    ]
    shipped += [
        (f"{name}: {about}", "BSD-3-Clause", "crease.libs; linked by `crease._sim`")
        for name, about, _ in linked
    ]
    parts = [
        "# Of other authors",
        "Written by `make licences`; crease itself is under the MIT licence.",
        "## In the wheel",
        "The source archive has the first two alone. The accounts of the others are Debian's, of their whole source.",
        table(("what", "licence", "where"), list(shipped)),
        "## In the repository",
        table(("what", "licence", "from"), list(meshes())),
        "## Needed, installed by pip",
        table(("package", "licence"), [(name, licence_of(name)) for name in needed()]),
        "python-can is used unchanged, through its interface.",
        *(f"## Licence of {name}\n\n```\n{text}\n```" for name, _, text in [*libraries, *linked]),
    ]  # fmt: skip
    return "\n\n".join(parts) + "\n"


def comparable(text: str) -> str:
    """The page without what differs between machines: words of other versions of what pip and Debian install."""
    text = re.sub(rf"^(\| (?:{'|'.join(needed())}) \|).*$", r"\1", text, flags=re.MULTILINE)
    return text.split(f"## Licence of {BUNDLED[0][0]}\n")[0]


def main(arguments: list[str]) -> int:
    """Command line: see above."""
    text = page()
    if arguments == ["--check"]:
        there = OUT.read_text("utf-8") if OUT.exists() else ""
        same = comparable(there) == comparable(text)
        print(
            f"third_party: {OUT.name} is {'as it should be' if same else 'out of date: run `make licences`'}"
        )
        return 0 if same else 1
    OUT.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
