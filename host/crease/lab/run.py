"""Which experiments there are, and how one is run: `crease experiment` is the command.

Each writes CSV, figures and a short table.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from crease.lab.setup import Result, Setup

NAMES = ("penetration", "timing", "direction", "slender", "zones", "thin-and-deep", "six")
"""In the order of the paper; the last two are what it leaves for later."""


def missing_inputs(names: Sequence[str], meshes: Path) -> list[Path]:
    """Files of the folder `meshes` that these experiments read and that are not there."""
    inputs = dict.fromkeys(path for name in names for path in _module(name).INPUTS)
    return [meshes / path for path in inputs if not (meshes / path).is_file()]


def run_experiment(name: str, setup: Setup) -> Result:
    """Run one of NAMES; its files are in setup.out.   Errors: CreaseError."""
    run: Callable[[Setup], Result] = _module(name).run
    return run(setup)


def _module(name: str) -> Any:
    return import_module(f"crease.lab.{name.replace('-', '_')}")
