"""What `crease bench pareto` sweeps: the paths, what is baked for each, and which rivals fit its tool."""

from __future__ import annotations

from dataclasses import dataclass

from crease.base.native import RESPONSES


@dataclass(frozen=True)
class Sweep:
    """A path, its two meshes, the sizes it is baked with by default, and what is swept."""

    path: str
    about: str
    static: str
    tool: str
    base_mm: tuple[float, float]
    spacings_mm: tuple[float, ...]
    voxels_mm: tuple[float, ...] = ()
    tessellations: tuple[str, ...] = ()
    is_round: bool = False
    is_point: bool = False

    @property
    def rivals(self) -> list[str]:
        """Responses made for such a tool: a point for god_object, also a ball for sphere_proxy, any for the rest."""
        fits = {
            "way_out": False,
            "extent": False,
            "god_object": self.is_point,
            "sphere_proxy": self.is_round or self.is_point,
        }
        return [name for name in RESPONSES if fits.get(name, True)]


SWEEPS = (
    Sweep("edge90_cube", "cube over a convex edge", "block45k", "cube60_2700", (2.0, 2.0), (1.0, 4.0, 8.0),
          (1.0, 4.0, 8.0), ("cube60_50", "cube60_350")),
    Sweep("edge90_sphere", "ball over a convex edge", "block45k", "sphere50", (2.0, 3.9), (2.0, 8.0), (8.0,),
          is_round=True),
    Sweep("corner3_sphere", "ball over a three-face corner", "corner", "ball15", (1.0, 1.2), (2.4,), is_round=True),
    Sweep("groove_block", "block in a groove", "groove", "groove_tool", (1.0, 2.0), (4.0,)),
    Sweep("part_spanner", "spanner over a machined part", "featuretype", "spanner", (1.0, 1.2), (2.4,)),
    Sweep("groove_stylus", "tip of a stylus in a groove", "groove", "stylus", (1.0, 0.5), (1.0,), is_point=True),
)  # fmt: skip

MAIN = 2
"""The first ones make the figure, the others one of their own."""
