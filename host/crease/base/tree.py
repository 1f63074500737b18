"""What lives with the tests: benchmarks and campaigns, whose verbs need the source tree and are not installed."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from crease.base.errors import CreaseError

TESTS = Path(__file__).resolve().parents[3] / "tests"
FOLDERS = {"study": TESTS / "bench", "stress": TESTS}
"""Where Python finds these two packages."""


def from_tree(verb: str, module: str) -> Any:
    """A module of these packages, such as "stress.campaign".   Errors: CreaseError without the source tree."""
    package = module.split(".", maxsplit=1)[0]
    if not (FOLDERS[package] / package).is_dir():
        raise CreaseError(
            f"crease {verb}: needs the source tree, and {TESTS} is not there; run it from a checkout"
        )
    sys.path[:0] = [str(at) for at in FOLDERS.values() if str(at) not in sys.path]
    return import_module(module)


def call_in_tree(module: str, function: str, *arguments: Any) -> Any:
    """A function of these packages, in a process that may not have them on its path yet."""
    return getattr(from_tree(module.split(".", maxsplit=1)[0], module), function)(*arguments)
