"""Two meshes into a scene image: `bake` calls surface, shell, voxmap and layout in this order."""

import sys
from types import ModuleType
from typing import Any


class _Room(ModuleType):
    """A room that can be called. Importing it makes it `crease.bake`, which users call: crease.bake(static, tool)."""

    def __call__(self, *args: Any, **options: Any) -> Any:
        """See crease.bake.call.bake."""
        from crease.bake.call import bake

        return bake(*args, **options)


sys.modules[__name__].__class__ = _Room
