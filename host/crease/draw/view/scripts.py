"""three.js and uPlot, out of their own npm packages, which `make setup` lays down; README.md says why so."""

from __future__ import annotations

import json
import sysconfig
from dataclasses import dataclass
from pathlib import Path

from crease.base.errors import CreaseError

FOLDER = Path(sysconfig.get_path("data")) / "share/crease/page"
"""Where the installed package keeps what host/package-lock.json names."""


@dataclass(frozen=True)
class Scripts:
    """Source texts of the libraries of the page; notice: their names, releases and licences, one line."""

    three: str
    uplot: str
    uplot_css: str
    notice: str


def _notice(folder: Path) -> str:
    about = json.loads((folder / "package.json").read_text(encoding="utf-8"))
    owner = next(
        line.strip()
        for line in (folder / "LICENSE").read_text(encoding="utf-8").splitlines()
        if "copyright" in line.lower()
    )
    return f"{about['name']} {about['version']} ({about['license']}, {owner})"


def load_scripts() -> Scripts:
    """The libraries.   Errors: CreaseError when they are not installed."""
    three, uplot = FOLDER / "three", FOLDER / "uplot"
    try:
        return Scripts(
            three=(three / "three.min.js").read_text(encoding="utf-8"),
            uplot=(uplot / "uPlot.iife.min.js").read_text(encoding="utf-8"),
            uplot_css=(uplot / "uPlot.min.css").read_text(encoding="utf-8"),
            notice="; ".join(_notice(folder) for folder in (three, uplot)),
        )
    except (OSError, ValueError, KeyError, StopIteration) as error:
        raise CreaseError(
            f"{FOLDER}: three.js and uPlot are not there; run `make setup build` with npm installed"
        ) from error
