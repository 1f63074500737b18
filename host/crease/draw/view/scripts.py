"""three.js and uPlot, out of the Python packages that carry them. README.md of this folder says why from there."""

from __future__ import annotations

import importlib.util
import io
import zipfile
from dataclasses import dataclass
from pathlib import Path

from crease.base.errors import CreaseError

THREE_START = "/**\n * @license\n * Copyright 2010-"
THREE_END = "\n(function(){"
"""In the page that trimesh carries, three.js is followed by its add-ons, which we leave."""


@dataclass(frozen=True)
class Scripts:
    """Source texts of the libraries of the page."""

    three: str
    uplot: str
    uplot_css: str


def _folder(package: str) -> Path:
    """Where a package lies, without running it."""
    spec = importlib.util.find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        raise CreaseError(
            f"the Python package {package} is missing: install it with pip install {package}"
        )
    return Path(next(iter(spec.submodule_search_locations)))


def load_scripts() -> Scripts:
    """The libraries.   Errors: CreaseError when a package is missing or does not carry them any more."""
    viewer = _folder("trimesh") / "resources" / "templates" / "viewer.zip"
    uplot = _folder("youplot") / "vendor"
    try:
        with zipfile.ZipFile(io.BytesIO(viewer.read_bytes())) as archive:
            page = archive.read("viewer.html.template").decode("utf-8")
        start = page.index(THREE_START)
        return Scripts(
            three=page[start : page.index(THREE_END, start)],
            uplot=(uplot / "uplot.iife.min.js").read_text(encoding="utf-8"),
            uplot_css=(uplot / "uplot.min.css").read_text(encoding="utf-8"),
        )
    except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
        raise CreaseError(
            f"three.js and uPlot are not where trimesh 5.2 and youplot 1.0 have them ({error}); install these versions"
        ) from error
