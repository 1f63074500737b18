"""The C code as Python sees it, and the one table of names for its enumerations.

The extension is built for two levels of x86-64 processors; the better one that this machine runs is taken, or the one
that the environment variable CREASE_CPU names. The answers are the same to the bit on all of them.

What is built so is what ships. The responses of firmware/rivals are in a second extension, of the same level, which is
loaded when one of them is asked for: `lib_of` chooses. What has a state (`cr_world`, `cr_servo`) differs between the
two; each is of its own type to cffi, which refuses to hand one extension's to the other. Plain structs are the same.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from crease._native import lib as _baseline
from crease.base.errors import CreaseError

__all__ = [
    "COVERAGES",
    "CPU",
    "RESPONSES",
    "Extension",
    "error_text",
    "ffi",
    "lib",
    "lib_of",
    "skip_mask",
    "skip_words",
]

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


_RIVALS = (
    *("extent", "fixed45", "voxmap", "distance_field", "deepest_group", "overlap"),
    *("normal_groups", "god_object", "sphere_proxy"),
)
"""In the order of `cr_response` with CR_RIVALS: what ships does not know their names."""

RESPONSES: dict[str, int] = _names("CR_RESPONSE_", frozenset({"CR_RESPONSE_COUNT"}))
"""How contact turns into force: `way_out`, which ships, then those to compare it with, `extent`, `fixed45`, ..."""
RESPONSES.update((name, number) for number, name in enumerate(_RIVALS, len(RESPONSES)))

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


@dataclass(frozen=True)
class Extension:
    """One of the extensions: its C functions and constants, and its types."""

    lib: Any
    ffi: Any

    def own(self, kind: str, value: Any) -> Any:
        """`value`, a pointer to a plain struct of what ships, as this extension takes it: a copy for another one.

        Errors: TypeError when it points to something else, ValueError when the two disagree about its size.
        """
        if self.ffi is ffi:
            return value
        copy = self.ffi.new(f"{kind} *")
        self.ffi.buffer(copy)[:] = ffi.buffer(ffi.new(f"{kind} *", value[0]))
        return copy


_SHIPPED = Extension(lib, ffi)


@cache
def _rivals() -> Extension | None:
    """The extension with firmware/rivals, of the level that runs; None where it is not installed."""
    name = _LEVELS[CPU][1].replace("_native", "_rivals")
    if find_spec(name) is None:
        return None
    module: Any = import_module(name)
    return Extension(module.lib, module.ffi)


def lib_of(response: int) -> Extension:
    """The extension that answers with a response, a value of RESPONSES: what holds a world or a servo is made by it.

    That is what ships for its own response, and for numbers that nobody knows, which it refuses.
    Errors: CreaseError where the rivals are not installed.
    """
    name = next((name for name in _RIVALS if RESPONSES[name] == response), None)
    if name is None:
        return _SHIPPED
    found = _rivals()
    if found is None:
        raise CreaseError(
            f"response {name}: this build has no crease._rivals; run `make build`, or use way_out"
        )
    return found


def error_text(code: int) -> str:
    """One line of English for a `cr_err`."""
    text: Any = ffi.string(lib.cr_err_text(code))
    return str(text.decode("ascii"))
