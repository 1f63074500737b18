"""The build backend: scikit-build-core, and source archives with the C code, which in a checkout lies beside host/.

A source archive builds anywhere: firmware/ and sim/ lie in it beside pyproject.toml, with the libraries of the page.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path
from typing import Any

from scikit_build_core import build as scikit
from scikit_build_core.build import (
    build_editable,
    build_wheel,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    get_requires_for_build_wheel,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)

__all__ = [
    "build_editable",
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_editable",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
    "prepare_metadata_for_build_editable",
    "prepare_metadata_for_build_wheel",
]

HOST = Path(__file__).resolve().parents[1]
ROOT = HOST.parent
OWN = (
    "pyproject.toml",
    "CMakeLists.txt",
    "LICENSE",
    "THIRD_PARTY.md",
    "README.md",
    "crease",
    "native",
    "backend",
)
BESIDE = ("firmware", "sim")
"""Folders of which the C code is taken."""
NPM = ROOT / "build/npm/node_modules"
PAGE = (
    *(f"three/{name}" for name in ("build/three.min.js", "package.json", "LICENSE")),
    *(
        f"uplot/{name}"
        for name in ("dist/uPlot.iife.min.js", "dist/uPlot.min.css", "package.json", "LICENSE")
    ),
)
"""What CMakeLists.txt installs for the page of `crease view`, when `make setup` has fetched it."""
MOVED = {"../firmware/": "firmware/", "../build/": "build/"}
"""Paths of pyproject.toml, in a checkout and in an archive."""


def stage(folder: Path) -> None:
    """Lay out the tree of a source archive.   Errors: OSError; FileNotFoundError outside a checkout."""
    unwanted = shutil.ignore_patterns("__pycache__", "*.pyc")
    for name in OWN:
        source = HOST / name
        if source.is_dir():
            shutil.copytree(source, folder / name, ignore=unwanted)
        else:
            shutil.copy(source, folder / name)
    for top in BESIDE:
        for file in sorted((ROOT / top).rglob("*.[ch]")):
            at = folder / file.relative_to(ROOT)
            at.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(file, at)
    for name in PAGE if NPM.is_dir() else ():
        at = folder / "page" / name
        at.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(NPM / name, at)
    text = (HOST / "pyproject.toml").read_text("utf-8")
    for there, here in MOVED.items():
        text = text.replace(f'"{there}', f'"{here}')
    (folder / "pyproject.toml").write_text(text, encoding="utf-8")


def build_sdist(sdist_directory: str, config_settings: Any = None) -> str:
    """The hook of PEP 517. From an unpacked archive it packs the same archive again."""
    target, before = Path(sdist_directory).resolve(), Path.cwd()
    if (HOST / "firmware").is_dir():
        return str(scikit.build_sdist(str(target), config_settings))
    with tempfile.TemporaryDirectory() as folder:
        stage(Path(folder))
        os.chdir(folder)
        try:
            return str(scikit.build_sdist(str(target), config_settings))
        finally:
            os.chdir(before)
