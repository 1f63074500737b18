"""The C code as Python sees it, and the one table of names for its enumerations.

The extension is built for two levels of x86-64 processors; the better one that this machine runs is taken, or the one
that the environment variable CREASE_CPU names. The answers are the same to the bit on all of them.
"""

from __future__ import annotations

import os
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from crease._native import lib as _baseline
from crease.base.errors import CreaseError

__all__ = ["COVERAGES", "CPU", "RESPONSES", "error_text", "ffi", "lib", "skip_mask", "skip_words"]

_LEVELS = {"x86-64-v3": (3, "crease._native_v3"), "x86-64": (1, "crease._native")}
"""By name: the level a processor must have, and the extension that was built for it. Best first."""


def _runnable() -> list[str]:
    """Names of the levels that are built and that this machine runs, best first."""
    have = int(_baseline.cr_cpu_level())
    return [
        name
        for name, (level, module) in _LEVELS.items()
        if level <= have and find_spec(module) is not None
    ]


def _choose(wish: str | None) -> str:
    """Name of the level to take.   Errors: CreaseError for a wish that is no level, or beyond the machine."""
    names = _runnable()
    if wish and wish not in names:
        raise CreaseError(f"CREASE_CPU={wish}: this machine and build have {', '.join(names)}")
    return wish or names[0]


CPU: str = _choose(os.environ.get("CREASE_CPU"))
"""The level of the extension that runs: `x86-64-v3`, or `x86-64`, which stands for any other machine too."""

_chosen: Any = import_module(_LEVELS[CPU][1])
ffi: Any = _chosen.ffi
lib: Any = _chosen.lib


def _names(prefix: str, exclude: frozenset[str] = frozenset()) -> dict[str, int]:
    """Lower-case names of the constants of the extension that start with `prefix`, with their values."""
    found = {
        name[len(prefix) :].lower(): int(getattr(lib, name))
        for name in dir(lib)
        if name.startswith(prefix) and name not in exclude
    }
    return dict(sorted(found.items(), key=lambda item: item[1]))


RESPONSES: dict[str, int] = _names("CR_RESPONSE_", frozenset({"CR_RESPONSE_COUNT"}))
"""How contact turns into force: `way_out`, `extent`, `fixed45`, ... as the firmware's `cr_response` has them."""

COVERAGES: dict[str, int] = _names("CR_COVERAGE_", frozenset({"CR_COVERAGE_COUNT"}))
"""How a sample near the surface counts: `soft`, `hard`, as in `cr_coverage`; other than `soft` is for rivals."""

SKIPS: dict[str, int] = _names("CR_SKIP_")
"""What detection may skip, as bits: `top`, `tree`, `coherence`, `all`."""


def skip_mask(names: list[str]) -> int:
    """The bits of `CR_SKIP_*` for names such as `top` and `tree`; an empty list skips nothing."""
    mask = 0
    for name in names:
        mask |= SKIPS[name]
    return mask


def skip_words(mask: int) -> str:
    """The names of the bits of `CR_SKIP_*`, comma-separated: what `crease replay --skips` takes; `none` for 0."""
    names = [name for name, bit in SKIPS.items() if name != "all" and mask & bit]
    return ",".join(names) or "none"


def error_text(code: int) -> str:
    """One line of English for a `cr_err`."""
    text: Any = ffi.string(lib.cr_err_text(code))
    return str(text.decode("ascii"))
