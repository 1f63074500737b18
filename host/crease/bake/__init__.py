"""Two meshes into a scene image: `bake` calls surface, shell, voxmap and layout in this order."""

import sys
from inspect import Parameter, Signature, cleandoc, signature
from textwrap import wrap
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
        """The function's text and how it is called: `help` takes this for a package and shows no call by itself.

        Asked for and not set: the function loads much.
        """
        first, rest = cleandoc(_function().__doc__).split("\n\n", 1)
        return f"{first}\n\n{_call()}\n\n{rest}\n\n{_ROOM}"


_ROOM = "The package of this name holds the parts of it; of these no version promises anything."
_WIDTH = 100


def _call() -> str:
    """How it is called, in lines that a terminal holds."""
    shown = signature(_function())
    given = [p.replace(annotation=Parameter.empty) for p in shown.parameters.values()]
    text = f"crease.bake{Signature(given)} -> {shown.return_annotation}"
    return "\n".join(wrap(text, _WIDTH, subsequent_indent=" " * len("crease.bake(")))


def _function() -> Any:
    from crease.bake.call import bake

    return bake


sys.modules[__name__].__class__ = _Room
