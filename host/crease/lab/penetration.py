"""Penetration and the tessellation of the tool: figures 7 and 8 of the paper."""

from __future__ import annotations

from typing import Any

import numpy as np

from crease.base.scene import Scene
from crease.draw.plot import COLOURS, STYLE, new_figure
from crease.lab.exact import exact_path, make_solids, world_from_tool
from crease.lab.setup import F64, Result, Setup, Table, make_path, poses_of, text_rows
from crease.replay.replay import ReplayOptions, World, run_path

TRIANGLES = (50, 100, 350, 800, 2700)
FRAMES = 120
"""The recorded trajectory is played at so many frames, as a device at some 60 Hz would have recorded it."""

DETAIL = (40, 80)
METHODS = ("as published", "ours")


def run(setup: Setup) -> Result:
    """Depth per frame of every tessellation, by both methods, beside the exact curve."""
    result = Result(
        "penetration",
        "Penetration measured with different tessellations of the tool",
        "A 60 mm cube turns over the convex edge of a block of 45,000 triangles: one recorded "
        "trajectory, played with the "
        "cube tessellated by 50 to 2,700 triangles. As published: area normal and contact plane "
        "from samples inside or outside, depth from the vertices of the tool's mesh in the "
        "zones' spheres. Ours: samples of its "
        "surface, weighed by how much of each is inside. Exact: the extent of the overlap along the exact normal.",
    )
    whole = poses_of(setup.path("edge90_cube"))
    poses = whole[np.linspace(0, len(whole) - 1, min(FRAMES, len(whole))).round().astype(int)]
    exact = 1e3 * exact_path(make_solids(setup.mesh("block45k"), setup.mesh("cube60_50")), poses)[1]
    scenes = {count: setup.scene("block45k", f"cube60_{count}", 2.0, 2.0) for count in TRIANGLES}
    depths = {
        ("as published", count): published_mm(
            scene, setup.mesh(f"cube60_{count}").vertices_m, poses
        )
        for count, scene in scenes.items()
    }
    for count, scene in scenes.items():
        depths["ours", count] = 1e3 * run_path(scene, make_path(poses))["depth_m"].astype(
            np.float64
        )
    columns = {"frame": np.arange(len(poses)), "exact_mm": exact}
    for (method, count), depth in depths.items():
        columns[f"{method.replace(' ', '_')}_{count}_mm"] = depth
    setup.write_csv(result, "penetration.csv", columns)
    _draw(setup, result, depths, exact)
    result.tables.append(_table(depths, exact))
    worst = {m: max(float(np.abs(depths[m, n] - exact).max()) for n in TRIANGLES) for m in METHODS}
    result.found.append(
        f"As published, the depth is up to {worst['as published']:.2f} mm wrong and jumps as vertices enter; "
        f"ours stays within {worst['ours']:.3f} mm of the exact curve with every tessellation."
    )
    return result


def published_mm(scene: Scene, vertices_m: F64, poses: F64) -> F64:
    """Depth as the paper measures it, mm, (n,).

    Zones, area normal and contact plane of the tick with samples in or out, then the most remote of the mesh's own
    vertices in the inner half of a zone's sphere. The point shell has no samples at vertices of flat faces; the paper's
    tool has nothing else.
    """
    world = World(scene, ReplayOptions(coverage="hard"))
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


def _table(depths: dict[tuple[str, int], F64], exact: F64) -> Table:
    step = float(np.abs(np.diff(exact)).max())
    rows = [
        (m, f"{n:,}", float(np.sqrt(np.mean((d - exact) ** 2))), float(np.abs(d - exact).max()),
         float(np.abs(np.diff(d)).max()), step)
        for (m, n), d in depths.items()
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


def _draw(setup: Setup, result: Result, depths: dict[tuple[str, int], F64], exact: F64) -> None:
    import matplotlib as mpl

    frames = np.arange(len(exact))
    for name, window in (
        ("penetration.png", (0, len(exact) - 1)),
        ("penetration_detail.png", DETAIL),
    ):
        with mpl.rc_context(STYLE):
            figure = new_figure(10.0, 4.2)
            axes = figure.subplots(1, 2, sharey=True)
            for axis, method in zip(axes, METHODS, strict=True):
                for count, colour in zip(TRIANGLES, COLOURS, strict=False):
                    axis.plot(
                        frames, depths[method, count], color=colour, label=f"{count:,} triangles"
                    )
                axis.plot(frames, exact, color="black", ls=(0, (4, 2)), lw=1.4, label="exact")
                axis.set_xlim(*window)
                shown = exact[slice(window[0], window[1] + 1)]
                axis.set_ylim(0.0, 1.35 * float(shown.max(initial=1e-3)))
                axis.set_title(method)
                axis.set_xlabel("frame")
            axes[0].set_ylabel("penetration, mm")
            axes[1].legend(loc="upper right", ncols=2)
            caption = (
                "Penetration over the trajectory."
                if window[0] == 0
                else "Detail of frames 40 to 80."
            )
            setup.write_figure(result, name, figure, caption)
