"""Areas and zones in colour: figure 2 of the paper, from the contact-zone method and the exact collided surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from crease.draw.plot import COLOURS, STYLE, new_figure
from crease.lab.exact import Piece, make_solids, overlap
from crease.lab.setup import F64, MM, Result, Setup, Table, text_rows
from crease.replay.replay import ReplayOptions, World

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STIFFNESS_N_M = 1000.0
NORMAL_MM, FORCE_MM = 9.0, 22.0
"""Lengths of the arrows of a zone's normal and of the largest force."""


@dataclass(frozen=True)
class Case:
    """One contact to draw: static and tool mesh, voxel and spacing in mm, pose (7,), what of it to show in mm."""

    name: str
    static: str
    tool: str
    sizes_mm: tuple[float, float]
    pose: F64
    window_mm: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]


def _pose(
    position_mm: tuple[float, float, float], axis: tuple[float, float, float], deg: float
) -> F64:
    half = np.radians(deg) / 2.0
    turn = np.sin(half) * np.array(axis) / np.linalg.norm(axis)
    pose: F64 = np.r_[MM * np.array(position_mm), np.cos(half), turn]
    return pose


CASES = (
    Case("one area, one zone", "block45k", "cube60_2700", (2.0, 2.0), _pose((-60.0, 0.0, 34.0), (1.0, 0.6, 0.0), 16.0),
         ((-115.0, 0.0), (-55.0, 55.0), (-30.0, 70.0))),
    Case("one area, two zones", "block45k", "cube60_2700", (2.0, 2.0), _pose((15.0, 0.0, 17.0), (0.2, 1.0, 0.1), 38.0),
         ((-60.0, 50.0), (-55.0, 55.0), (-50.0, 60.0))),
    Case("two areas, one zone each", "block45k", "u_tool", (2.0, 2.0), _pose((-60.0, 0.0, 17.0), (0.3, 1.0, 0.0), 2.0),
         ((-115.0, -5.0), (-45.0, 45.0), (-25.0, 60.0))),
)  # fmt: skip


INPUTS = tuple(f"{mesh}.stl" for case in CASES for mesh in (case.static, case.tool))
"""Files of the folder of meshes."""


def run(setup: Setup) -> Result:
    """A picture of each case, and what the tick says of each zone."""
    result = Result(
        "zones",
        "Contact areas and contact zones",
        "The collided surface of the static object, cut out exactly, coloured by the zone that "
        "the contact-zone method (response extent) has there; a thin arrow at each "
        "zone's centre is its normal, the thick one the force of its area. The tool is drawn as its edges.",
    )
    rows: list[tuple[object, ...]] = []
    columns: dict[str, list[float]] = {}
    for number, case in enumerate(CASES):
        scene = setup.scene(case.static, case.tool, *case.sizes_mm)
        out = World(scene, ReplayOptions(STIFFNESS_N_M, response="extent")).tick(case.pose)
        pieces = overlap(make_solids(setup.mesh(case.static), setup.mesh(case.tool)), case.pose)
        for a, area in enumerate(_areas(out)):
            for z, zone in enumerate(area["zones"]):
                rows.append((case.name, a + 1, z + 1, f"{zone['area_mm2']:.0f}", f"{zone['weight_mm2']:.0f}",
                             _triple(zone["normal"]), f"{area['depth_mm']:.2f}", _triple(area["normal"])))  # fmt: skip
                values = (
                    number,
                    a,
                    z,
                    zone["area_mm2"],
                    zone["weight_mm2"],
                    *zone["normal"],
                    area["depth_mm"],
                )
                names = (
                    "case",
                    "area",
                    "zone",
                    "area_mm2",
                    "weight_mm2",
                    "nx",
                    "ny",
                    "nz",
                    "depth_mm",
                )
                for name, value in zip(names, values, strict=True):
                    columns.setdefault(name, []).append(float(value))
        figure = _draw(setup, case, _areas(out), pieces)
        setup.write_figure(result, f"zones_{number + 1}.png", figure, case.name.capitalize() + ".")
    heads = (
        "contact",
        "area",
        "zone",
        "touched, mm^2",
        "inside the tool, mm^2",
        "zone normal",
        "depth, mm",
        "area normal",
    )
    result.tables.append(Table("What the tick says", heads, text_rows(rows)))
    setup.write_csv(result, "zones.csv", {k: np.array(v) for k, v in columns.items()})
    return result


def _triple(v: F64) -> str:
    return " ".join(f"{x:.2f}" for x in v)


def _vector(v: Any) -> F64:
    return np.array([v.x, v.y, v.z])


def _areas(out: Any) -> list[dict[str, Any]]:
    """Areas of an output with their zones, lengths in mm."""
    found = []
    for i in range(out.area_count):
        area = out.areas[i]
        zones = [
            {
                "normal": _vector(area.zones[z].normal_world),
                "centre_mm": 1e3 * _vector(area.zones[z].centre_world_m),
                "offset_mm": 1e3 * float(area.zones[z].offset_m),
                "area_mm2": 1e6 * float(area.zones[z].area_m2),
                "weight_mm2": 1e6 * float(area.zones[z].weight_m2),
            }
            for z in range(area.zone_count)
        ]
        found.append(
            {
                "zones": zones,
                "depth_mm": 1e3 * float(area.depth_m),
                "normal": _vector(area.normal_world),
                "point_mm": 1e3 * _vector(area.point_world_m),
                "force_N": _vector(area.force_world_N),
            }
        )
    return found


def _zone_of(corners_mm: F64, zones: list[dict[str, Any]]) -> int:
    """The zone that a triangle of the collided surface is of: by plane and normal; in one plane the nearest."""
    normal = np.cross(corners_mm[1] - corners_mm[0], corners_mm[2] - corners_mm[0])
    normal /= max(float(np.linalg.norm(normal)), 1e-12)
    middle = corners_mm.mean(axis=0)
    cost = [
        abs(float(z["normal"] @ middle) - z["offset_mm"])
        + 10.0 * (1.0 - float(z["normal"] @ normal))
        + 0.01 * float(np.linalg.norm(z["centre_mm"] - middle))
        for z in zones
    ]
    return int(np.argmin(cost))


def _draw(setup: Setup, case: Case, areas: list[dict[str, Any]], pieces: list[Piece]) -> Figure:
    import matplotlib as mpl
    from mpl_toolkits.mplot3d.art3d import (  # type: ignore[import-untyped]
        Line3DCollection,
        Poly3DCollection,
    )

    zones = [zone for area in areas for zone in area["zones"]]
    with mpl.rc_context(STYLE):
        figure = new_figure(6.4, 5.0)
        axes: Any = figure.add_subplot(projection="3d", computed_zorder=False)
        static = _clipped(setup, case)
        axes.add_collection3d(
            Poly3DCollection(static, facecolor="#dfe7ef", edgecolor="none", alpha=0.5, zorder=1)
        )
        for z in range(len(zones)):
            shown = [
                t
                for piece in pieces
                for t in 1e3 * piece.corners_m[piece.from_static]
                if _zone_of(t, zones) == z
            ]
            axes.add_collection3d(
                Poly3DCollection(
                    shown, facecolor=COLOURS[z], edgecolor=COLOURS[z], lw=0.4, alpha=0.85, zorder=2
                )
            )
        edges = _outline(setup, case)
        axes.add_collection3d(Line3DCollection(edges, color="#333333", lw=0.9, zorder=3))
        for z, zone in enumerate(zones):
            _arrow(axes, zone["centre_mm"], NORMAL_MM * zone["normal"], COLOURS[z], 1.6)
        most = max(float(np.linalg.norm(a["force_N"])) for a in areas)
        for area in areas:
            _arrow(axes, area["point_mm"], FORCE_MM / most * area["force_N"], "#c23b22", 3.0)
        for set_limits, (low, high) in zip(
            (axes.set_xlim, axes.set_ylim, axes.set_zlim), case.window_mm, strict=True
        ):
            set_limits(low, high)
        axes.set_box_aspect([high - low for low, high in case.window_mm], zoom=1.25)
        axes.view_init(elev=24.0, azim=-58.0)
        axes.set_axis_off()
        axes.set_title(f"{case.name}: depth {max(a['depth_mm'] for a in areas):.1f} mm")
    return figure


def _arrow(axes: Any, start: F64, way: F64, colour: str, width: float) -> None:
    axes.quiver(*start, *way, color=colour, lw=width, arrow_length_ratio=0.28, zorder=5)


def _clipped(setup: Setup, case: Case) -> F64:
    """Triangles of the static mesh within the window, (n, 3, 3) mm."""
    from crease.mesh.mend import to_manifold

    mesh = setup.mesh(case.static)
    low, high = np.array(case.window_mm).T
    box = _box_manifold(low, high)
    solid = to_manifold(1e3 * mesh.vertices_m, mesh.triangles).as_original().simplify(2e-5) ^ box
    out = solid.to_mesh64()
    triangles: F64 = np.asarray(out.vert_properties)[:, :3][np.asarray(out.tri_verts)]
    return triangles


def _box_manifold(low: F64, high: F64) -> Any:
    from manifold3d import Manifold

    return Manifold.cube((high - low).tolist()).translate(low.tolist())


def _outline(setup: Setup, case: Case) -> F64:
    """Sharp edges of the tool in the world, (n, 2, 3) mm."""
    import trimesh

    from crease.lab.exact import world_from_tool

    mesh = setup.mesh(case.tool)
    found = trimesh.Trimesh(mesh.vertices_m, mesh.triangles, process=False)
    sharp = found.face_adjacency_edges[found.face_adjacency_angles > np.radians(30.0)]
    pose = world_from_tool(case.pose)
    return np.asarray(1e3 * (mesh.vertices_m[sharp] @ pose[:, :3].T + pose[:, 3]))
