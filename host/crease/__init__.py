"""crease: stable haptic contact between a rigid tool and a rigid mock-up.

Rooms, each using only those before it: `base` (errors, units, tables, scene images), `mesh`, `bake` (two meshes into a
scene image), `replay` (the firmware's own C code along a path), `bus`, `loop` (the closed loop), `draw`, `lab` (the
paper's experiments), `verbs`. `cli` is the command `crease`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from crease.base.version import VERSION as __version__  # noqa: N811

__all__ = ["__version__"]

_PLACES = {"__version__": ("crease.base.version", "VERSION")}
"""Where each public name stands. It is imported when it is first asked for: `import crease` alone loads nothing."""


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'crease' has no attribute '{name}'")
    module, inside = _PLACES[name]
    value = getattr(import_module(module), inside)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
