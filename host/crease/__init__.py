"""crease: stable haptic contact between a rigid tool and a rigid mock-up.

Rooms, each using only those before it: `base` (errors, units, tables, scene images), `mesh`, `bake` (two meshes into a
scene image), `replay` (the firmware's own C code along a path), `bus`, `loop` (the closed loop), `draw`, `lab` (the
paper's experiments), `verbs`. `cli` is the command `crease`.
"""

__version__ = "0.1.0"
