"""How long a bake takes, foreseen from a few of its bricks: units of work of every stage, and what one of each weighs.

The weights are seconds, measured over the meshes that tests/bench/bake_estimate.py does not call unseen: its `--stages`
prints what every stage took, to measure them anew. Only their ratios matter once a bake runs: its own pace takes over.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from crease.bake.grid import Grid, make_grid
from crease.bake.limits import shell_counts
from crease.bake.refine import Coarse, chosen
from crease.bake.surface import Surface
from crease.bake.voxmap import (
    BASE_LEVEL,
    CellSorter,
    base_samples,
    choose_levels,
    near_bricks,
)
from crease.base.progress import Forecast
from crease.mesh.mesh import Mesh

TRIANGLE_S = 3e-6
"""Creases, patches and search tree of a mesh, a triangle."""
SAMPLE_S, POINT_S, PATCH_S = 70e-6, 1.2e-6, 8e-3
"""A shell: a sample, a fine point that it is gathered from, and a patch of the tool."""
QUERY_S = 0.2e-6
"""An exact distance at least, on two threads; what more it takes is measured on the bricks looked at beforehand."""
BRICK_S, PACK_S = 0.2e-3, 0.02e-3
"""Planes of a brick near the surface; records of a brick or a fine voxel."""
CELL_S = 15e-6
"""Kind of a crease cell at least; what it takes is measured on the bricks looked at beforehand."""
CHECK_S, CHECK_QUERIES = 1e-3, 2200
"""Whether a brick has to be refined, and distances that it takes."""
FINE_S = 0.05e-3
"""Samples of a fine voxel, beside their distances."""
MEASURE_S, MEASURE_QUERIES = 0.1, 200_000
"""The errors of the finished image; distances that take as long as its own, which lie anywhere."""
WRITE_S = 1e-6
"""Both meshes beside the image, a triangle."""
SURVEY_S = 0.1
"""This estimate, beside its distances."""
SURVEYED, CHECKED, PROBED = 48, 16, 16
"""Bricks that are looked at beforehand; those of them that are checked as for refining, and whose crease cells are
probed, as the bake does."""


def foresee_features(work: Forecast, static: Mesh, tool: Mesh) -> None:
    """What there is to do with two meshes whatever they are: stages "features" and "writing"."""
    triangles = len(static.triangles) + len(tool.triangles)
    work.foresee("features", triangles, TRIANGLE_S)
    work.foresee("writing", triangles, WRITE_S)


def foresee_shell(work: Forecast, surface: Surface, spacing_m: float) -> None:
    """The stage "shell", of a tool."""
    samples, points = shell_counts(surface.mesh, spacing_m)
    all_s = SAMPLE_S * samples + POINT_S * points + PATCH_S * surface.counts["patches"]
    work.foresee("shell", samples, all_s / samples)


def foresee_voxmap(
    work: Forecast, surface: Surface, voxel_m: float, near_m: float, tolerance_m: float
) -> None:
    """The stages of a voxmap and of its errors, from some of its bricks. near_m as for make_voxmap."""
    work.foresee("surveying", 1, SURVEY_S)
    work.begin("surveying")
    grid = make_grid(surface, voxel_m, near_m)
    where = np.argwhere(near_bricks(surface, grid))[:, ::-1]
    some = where[np.unique(np.linspace(0, len(where) - 1, SURVEYED).astype(np.int64))]
    scale = len(where) / len(some)
    spent_s = -work.clock()
    phi, facet = base_samples(surface, grid, some, lambda _part: None)
    spent_s += work.clock()
    query_s = max(QUERY_S, spent_s / work.pace() / phi.size)
    open_ = np.flatnonzero(choose_levels(phi, tolerance_m) == BASE_LEVEL)
    checked = open_[:: max(1, len(open_) // CHECKED)]
    work.foresee("surveying", phi.size + CHECK_QUERIES * len(checked), query_s)
    work.begin("surveying")

    def distance(at: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return surface.signed_distance(at)[0]

    cells, probed, missed, cell_s = _crease_cells(
        work, surface, grid, some, phi, facet, tolerance_m
    )
    bricks, row = np.unique(probed[:, 0], return_inverse=True)
    probing_s = cell_s * len(probed) + len(bricks) * (CHECK_S + CHECK_QUERIES * query_s)
    work.foresee("surveying", len(probed), probing_s / max(1, len(probed)))
    work.begin("surveying")
    judged = np.ones((len(some), *(n - 1 for n in phi.shape[1:])), bool)
    judged[tuple(cells.T)] = False
    judged[tuple(probed.T)] = missed
    coarse = Coarse(grid, some, phi, judged, checked)
    fine = 0.0
    if len(probed):
        marked = chosen(coarse, bricks, distance, tolerance_m)[row, *probed[:, 1:].T]
        fine += np.mean(marked) * len(cells)
    judged[tuple(probed.T)] = False
    if len(checked):
        marked = chosen(coarse, checked, distance, tolerance_m)
        fine += np.count_nonzero(marked) * len(open_) / len(checked)
    work.foresee("distances", len(where), phi[0].size * query_s)
    work.foresee("creases", scale * len(cells), cell_s)
    work.foresee("planes", len(where), BRICK_S)
    work.foresee("checking", scale * len(open_), CHECK_S + CHECK_QUERIES * query_s)
    work.foresee("refining", scale * fine, FINE_S + 125 * query_s)
    work.foresee("packing", len(where) + scale * fine, PACK_S)
    work.foresee("measuring", 1, MEASURE_S + MEASURE_QUERIES * query_s)


def _crease_cells(
    work: Forecast,
    surface: Surface,
    grid: Grid,
    where: npt.NDArray[np.int64],
    phi: npt.NDArray[np.float64],
    facet: npt.NDArray[np.int32],
    tolerance_m: float,
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.bool_], float]:
    """Cells of bricks whose kinds take probes; those probed here; which of these no planes describe; seconds for one.

    Shapes: where (n, 3); cells (m, 4: brick, z, y, x).
    """
    sorter = CellSorter(surface, grid, tolerance_m)
    _, hard = sorter.sort_plain(where, phi, facet)
    bricks = np.unique(hard[:, 0])
    probed = hard[np.isin(hard[:, 0], bricks[:: max(1, len(bricks) // PROBED)])]
    if len(probed) == 0:
        return hard, probed, np.zeros(0, bool), CELL_S
    pace, spent_s = work.pace(), -work.clock()
    missed = sorter.missed_by_planes(where, probed)
    spent_s += work.clock()
    return hard, probed, missed, max(CELL_S, spent_s / pace / len(probed))
