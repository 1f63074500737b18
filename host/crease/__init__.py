"""crease: stable haptic contact between a rigid tool and a rigid mock-up.

`mesh` and `bake` turn two meshes into a scene image; `scene` opens one; `replay` drives the firmware's own C code
along a `trajectory`; `table` keeps what came out; `plot` and `figures` draw it. `cli` is the command `crease`.
"""

__version__ = "0.1.0"
