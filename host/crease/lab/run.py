"""Which experiments there are, and how one is run: `crease experiment` is the command.

Each writes CSV, figures and a short table.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module

from crease.lab.setup import Result, Setup

NAMES = ("penetration", "timing", "direction", "slender", "zones", "thin-and-deep", "six")
"""In the order of the paper; the last two are what it leaves for later."""


def run_experiment(name: str, setup: Setup) -> Result:
    """Run one of NAMES; its files are in setup.out.   Errors: CreaseError."""
    module = import_module(f"crease.lab.{name.replace('-', '_')}")
    run: Callable[[Setup], Result] = module.run
    return run(setup)
