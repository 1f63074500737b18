"""Two meshes into a scene image: `bake` calls surface, shell, voxmap and layout in this order."""

import sys
from inspect import Signature, signature
from types import ModuleType
from typing import Any


class _Room(ModuleType):
    # A room that can be called. Importing it makes it `crease.bake`, which users call: crease.bake(static, tool).

    def __call__(self, *args: Any, **options: Any) -> Any:
        return _function()(*args, **options)

    @property
    def __signature__(self) -> Signature:
        """What `inspect.signature` and `help` show."""
        return signature(_function())

    @property
    def __doc__(self) -> str | None:  # type: ignore[override]
        """The function's text, asked for and not set: the function loads much."""
        text: str | None = _function().__doc__
        return text


def _function() -> Any:
    from crease.bake.call import bake

    return bake


sys.modules[__name__].__class__ = _Room
