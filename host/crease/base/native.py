"""The C code as Python sees it, and the one table of names for its enumerations."""

from __future__ import annotations

from typing import Any

from crease._native import ffi, lib

__all__ = ["COVERAGES", "RESPONSES", "error_text", "ffi", "lib", "skip_mask", "skip_words"]


def _names(prefix: str, exclude: frozenset[str] = frozenset()) -> dict[str, int]:
    """Lower-case names of the constants of the extension that start with `prefix`, with their values."""
    found = {
        name[len(prefix) :].lower(): int(getattr(lib, name))
        for name in dir(lib)
        if name.startswith(prefix) and name not in exclude
    }
    return dict(sorted(found.items(), key=lambda item: item[1]))


RESPONSES: dict[str, int] = _names("CR_RESPONSE_", frozenset({"CR_RESPONSE_COUNT"}))
"""How a contact area turns into a force: `zones`, `fixed45`, ... as the firmware's `cr_response` has them."""

COVERAGES: dict[str, int] = _names("CR_COVERAGE_", frozenset({"CR_COVERAGE_COUNT"}))
"""How a sample near the surface counts: `soft`, `hard`, as in `cr_coverage`."""

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
