"""What the self-checks of the references share."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import manifold3d as mf
import numpy as np
import overlap

ROOT = Path(__file__).resolve().parents[3]
SCENES: dict[str, dict[str, Any]] = tomllib.loads((ROOT / "meshes" / "scenes.toml").read_text())
LEVEL = np.eye(3)


def solid(body: mf.Manifold) -> overlap.Solid:
    """A body as the references take it."""
    mesh = body.to_mesh64()
    points = np.array(mesh.vert_properties[:, :3], float, order="C")
    return overlap.make_solid(points, np.array(mesh.tri_verts, np.int64, order="C"))


def slab(lo: list[float], hi: list[float]) -> mf.Manifold:
    """A box from corner to corner, mm."""
    size = [h - low for low, h in zip(lo, hi, strict=True)]
    return mf.Manifold.cube(size).translate(lo)
