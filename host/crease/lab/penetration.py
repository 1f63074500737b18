"""Penetration and the tessellation of the tool: figures 7 and 8 of the paper."""

from __future__ import annotations

from typing import Any

import numpy as np

from crease.base.scene import Scene
from crease.draw.plot import COLOURS, STYLE, new_figure
from crease.lab.exact import convex_planes, exact_exit_m, exact_path, make_solids, world_from_tool
from crease.lab.setup import F64, Result, Setup, Table, make_path, poses_of, text_rows
from crease.replay.replay import ReplayOptions, World, run_path

TRIANGLES = (50, 100, 350, 800, 2700)
FRAMES = 120
"""The recorded trajectory is played at so many frames, as a device at some 60 Hz would have recorded it."""

DETAIL = (40, 80)
METHODS = ("as published", "extent", "way out")


INPUTS = ("edge90_cube.csv", "block45k.stl", *(f"cube60_{n}.stl" for n in TRIANGLES))
"""Files of the folder of meshes."""


def run(setup: Setup) -> Result:
    """Depth per frame of every tessellation, by each method, beside its exact curve."""
    result = Result(
        "penetration",
        "Penetration measured with different tessellations of the tool",
        "A 60 mm cube turns over the convex edge of a block of 45,000 triangles: one recorded "
        "trajectory, played with the "
        "cube tessellated by 50 to 2,700 triangles. As published: area normal and contact plane "
        "from samples inside or outside, depth from the vertices of the tool's mesh in the "
        "zones' spheres. Extent: samples of its "
        "surface, weighed by how much of each is inside. Exact for both: the extent of the overlap along the exact "
        "normal. Way out: crease; exact is how far the cube has to go along the force to leave the block.",
    )
    whole = poses_of(setup.path("edge90_cube"))
    poses = whole[np.linspace(0, len(whole) - 1, min(FRAMES, len(whole))).round().astype(int)]
    extent = (
        1e3 * exact_path(make_solids(setup.mesh("block45k"), setup.mesh("cube60_50")), poses)[1]
    )
    scenes = {count: setup.scene("block45k", f"cube60_{count}", 2.0, 2.0) for count in TRIANGLES}
    depths = {
        ("as published", count): published_mm(
            scene, setup.mesh(f"cube60_{count}").vertices_m, poses
        )
        for count, scene in scenes.items()
    }
    exact = dict.fromkeys(depths, extent)
    block, cube = convex_planes(setup.mesh("block45k")), convex_planes(setup.mesh("cube60_50"))
    for count, scene in scenes.items():
        options = ReplayOptions(response="extent")
        found = run_path(scene, make_path(poses), options)["depth_m"]
        depths["extent", count] = 1e3 * found.astype(np.float64)
        exact["extent", count] = extent
        felt = run_path(scene, make_path(poses))
        depths["way out", count] = 1e3 * felt["depth_m"].astype(np.float64)
        exact["way out", count] = 1e3 * exits_m(block, cube, poses, felt["force_N"])
    columns = {"frame": np.arange(len(poses)), "exact_extent_mm": extent}
    for (method, count), depth in depths.items():
        columns[f"{method.replace(' ', '_')}_{count}_mm"] = depth
        if method == "way out":
            columns[f"exact_way_out_{count}_mm"] = exact[method, count]
    setup.write_csv(result, "penetration.csv", columns)
    _draw(setup, result, depths, exact)
    result.tables.append(_table(depths, exact))
    worst = {
        m: max(float(np.abs(depths[m, n] - exact[m, n]).max()) for n in TRIANGLES) for m in METHODS
    }
    result.found.append(
        f"As published, the depth is up to {worst['as published']:.2f} mm wrong and jumps as vertices enter; "
        f"the way out stays within {worst['way out']:.3f} mm of the exact curve with every tessellation, the extent "
        f"within {worst['extent']:.3f} mm."
    )
    return result


def exits_m(static: F64, tool: F64, poses: F64, force_N: F64) -> F64:
    """Exact way out of two convex bodies along each force, m, (n,); without a force along nothing, 0."""
    size = np.linalg.norm(force_N.astype(np.float64), axis=1)
    return np.array(
        [
            exact_exit_m(static, tool, pose, force / norm) if norm > 0.0 else 0.0
            for pose, force, norm in zip(poses, force_N.astype(np.float64), size, strict=True)
        ]
    )


def published_mm(scene: Scene, vertices_m: F64, poses: F64) -> F64:
    """Depth as the paper measures it, mm, (n,).

    Zones, area normal and contact plane of the tick with samples in or out, then the most remote of the mesh's own
    vertices in the inner half of a zone's sphere. The point shell has no samples at vertices of flat faces; the paper's
    tool has nothing else.
    """
    world = World(scene, ReplayOptions(response="extent", coverage="hard"))
    found = np.zeros(len(poses))
    for i, pose in enumerate(poses):
        out = world.tick(pose)
        placed = world_from_tool(pose)
        points = vertices_m @ placed[:, :3].T + placed[:, 3]
        for k in range(out.area_count):
            area = out.areas[k]
            internal = np.zeros(len(points), dtype=bool)
            for z in range(area.zone_count):
                zone = area.zones[z]
                away = points - _vector(zone.centre_world_m)
                near = np.einsum("nx,nx->n", away, away) <= float(zone.radius_m) ** 2
                internal |= near & (away @ _vector(zone.normal_world) < 0.0)
            heights = points[internal] @ _vector(area.normal_world)
            found[i] = max(found[i], float(area.offset_m) - float(heights.min(initial=np.inf)))
    return 1e3 * found.clip(0.0)


def _vector(v: Any) -> F64:
    return np.array([v.x, v.y, v.z])


def _table(depths: dict[tuple[str, int], F64], exact: dict[tuple[str, int], F64]) -> Table:
    rows = [
        (m, f"{n:,}", float(np.sqrt(np.mean((d - e) ** 2))), float(np.abs(d - e).max()),
         float(np.abs(np.diff(d)).max()), float(np.abs(np.diff(e)).max()))
        for (m, n), d in depths.items() for e in (exact[m, n],)
    ]  # fmt: skip
    heads = (
        "method",
        "triangles of the tool",
        "RMS error, mm",
        "max error, mm",
        "largest change in a frame, mm",
        "exact, mm",
    )
    return Table("Depth against the exact depth over the whole trajectory", heads, text_rows(rows))


def _draw(
    setup: Setup,
    result: Result,
    depths: dict[tuple[str, int], F64],
    exact: dict[tuple[str, int], F64],
) -> None:
    import matplotlib as mpl

    last = TRIANGLES[-1]
    frames = np.arange(len(exact[METHODS[0], last]))
    most = np.maximum.reduce([exact[method, last] for method in METHODS])
    for name, window in (
        ("penetration.png", (0, len(frames) - 1)),
        ("penetration_detail.png", DETAIL),
    ):
        with mpl.rc_context(STYLE):
            figure = new_figure(13.0, 4.2)
            axes = figure.subplots(1, 3, sharey=True)
            for axis, method in zip(axes, METHODS, strict=True):
                for count, colour in zip(TRIANGLES, COLOURS, strict=False):
                    axis.plot(
                        frames, depths[method, count], color=colour, label=f"{count:,} triangles"
                    )
                axis.plot(
                    frames,
                    exact[method, last],
                    color="black",
                    ls=(0, (4, 2)),
                    lw=1.4,
                    label="exact",
                )
                axis.set_xlim(*window)
                shown = most[slice(window[0], window[1] + 1)]
                axis.set_ylim(0.0, 1.35 * float(shown.max(initial=1e-3)))
                axis.set_title(method)
                axis.set_xlabel("frame")
            axes[0].set_ylabel("penetration, mm")
            axes[2].legend(loc="upper right", ncols=2)
            caption = (
                "Penetration over the trajectory."
                if window[0] == 0
                else "Detail of frames 40 to 80."
            )
            setup.write_figure(result, name, figure, caption)
