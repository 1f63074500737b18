"""Force direction round corners: figure 10 of the paper, for three edges and a corner of three faces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crease.draw.corner import CornerCase, draw_corner, section_xz
from crease.draw.plot import COLOURS, STYLE, new_figure
from crease.lab.exact import exact_path, make_solids
from crease.lab.setup import (
    F64,
    MM,
    Result,
    Setup,
    Table,
    make_path,
    poses_of,
    text_rows,
    upright,
)
from crease.replay.measures import angle_deg
from crease.replay.replay import ReplayOptions, run_path

RADIUS_MM, DEPTH_MM, STEP_MM, FLAT_MM = 50.0, 10.0, 0.1, 55.0
"""The paper's sphere and depth; one step a tick is 100 mm/s; how far the path goes on along each face."""

STIFFNESS_N_M = 1000.0
NAMES = {"way_out": "way out", "extent": "extent", "fixed45": "fixed 45 degrees"}
WEDGES = {60: "wedge60", 90: "block45k", 120: "wedge120"}
INPUTS = (
    *("corner3_sphere.csv", "corner.stl", "ball15.stl", "sphere50.stl"),
    *(f"{static}.stl" for static in WEDGES.values()),
)
"""Files of the folder of meshes."""
EXACT_EVERY = 8
"""Every n-th pose has its exact direction computed: a boolean with a ball of 20,480 triangles costs 8 ms."""


@dataclass(frozen=True)
class Case:
    """One corner: name, static mesh, tool mesh, voxel and spacing in mm, poses (n, 7)."""

    name: str
    static: str
    tool: str
    voxel_mm: float
    spacing_mm: float
    poses: F64


def wedge_path(angle_deg_: float, lean_deg: float) -> F64:
    """Poses of the ball along one face, round the edge (the y axis), down the other; lean of the bisector from -z."""
    half = np.radians(90.0 - angle_deg_ / 2.0)
    reach = RADIUS_MM - DEPTH_MM
    turn = np.linspace(-half, half, round(2.0 * half * reach / STEP_MM))
    arc = reach * np.stack([np.sin(turn), np.cos(turn)], axis=1)
    way = np.arange(FLAT_MM, 0.0, -STEP_MM)[:, None]
    into = np.array([np.cos(half), np.sin(half)])
    out = np.array([np.cos(half), -np.sin(half)])
    flat = np.vstack([arc[0] - way * into, arc, arc[-1] + way[::-1] * out])
    lean = np.radians(lean_deg)
    x = np.cos(lean) * flat[:, 0] + np.sin(lean) * flat[:, 1]
    z = -np.sin(lean) * flat[:, 0] + np.cos(lean) * flat[:, 1]
    return upright(MM * np.column_stack([x, np.zeros_like(x), z]))


def cases(setup: Setup) -> list[Case]:
    """The corners. The block's edge lies turned by 45 degrees against the wedges."""
    found = [
        Case(f"{angle} degrees", static, "sphere50", 2.0, 3.9,
             setup.thinned(wedge_path(angle, 45.0 if angle == 90 else 0.0)))
        for angle, static in WEDGES.items()
    ]  # fmt: skip
    found.append(
        Case("three faces", "corner", "ball15", 1.0, 1.2, poses_of(setup.path("corner3_sphere")))
    )
    return found


def turns_deg(force: F64) -> F64:
    """Turn from each tick to the next, 0 where either has no force."""
    both = (np.linalg.norm(force[1:], axis=1) > 1e-3) & (np.linalg.norm(force[:-1], axis=1) > 1e-3)
    return np.where(both, angle_deg(force[:-1], force[1:]), 0.0)


def felt_radius_mm(force: F64, poses: F64) -> float:
    """Radius of the corner that turns the force as this one does, at its sharpest: least way per turn.

    Taken over windows of 2 mm of way, so that the noise of single ticks does not enter: where the force turns at
    once, 2 mm over that turn.
    """
    turn = np.r_[0.0, np.cumsum(np.radians(turns_deg(force)))]
    way = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1))] / MM
    ends = np.searchsorted(way, way + 2.0).clip(max=len(way) - 1)
    turned, gone = turn[ends] - turn, way[ends] - way
    full = (gone > 1.9) & (turned > 1e-4)
    return float((gone[full] / turned[full]).min(initial=np.inf))


def run(setup: Setup) -> Result:
    """Force arrows, turn per tick and felt radius of every corner, with each response."""
    result = Result(
        "direction",
        "Direction of the force round a corner",
        f"A sphere of R {RADIUS_MM:g} mm is drawn {DEPTH_MM:g} mm deep along one face, round the "
        "edge and along the other, at 100 mm/s; "
        "a ball of R 15 mm over a corner of three faces. Fixed 45 degrees: every zone at the "
        "edge counts the same. Felt radius: the "
        "way of the tool over the turn of the force where it turns fastest, over 2 mm of way; a "
        "right-angled jump has almost none. Exact: against the gradient of the overlap volume, which extent and fixed "
        "45 degrees stand for; the way out turns with the depth of the overlap and not with its surface.",
    )
    rows: list[tuple[object, ...]] = []
    turns: dict[str, dict[str, tuple[F64, F64]]] = {}
    for case in cases(setup):
        rows += _run_case(setup, result, case, turns)
    heads = (
        "corner",
        "response",
        "turn in one tick, max deg",
        "error against exact, max deg",
        "felt radius, mm",
    )
    result.tables.append(Table("Round the corners", heads, text_rows(rows)))
    _draw_turns(setup, result, turns)
    worst = {n: max(float(t[n][1].max()) for t in turns.values()) for n in NAMES}
    result.found.append(
        f"Fixed 45 degrees turns the force by up to {worst['fixed45']:.0f} degrees in one tick, "
        f"the way out by at most {worst['way_out']:.2f}."
    )
    return result


def _run_case(
    setup: Setup, result: Result, case: Case, turns: dict[str, dict[str, tuple[F64, F64]]]
) -> list[tuple[object, ...]]:
    scene = setup.scene(case.static, case.tool, case.voxel_mm, case.spacing_mm)
    path = make_path(case.poses)
    tool, static = setup.mesh(case.tool), setup.mesh(case.static)
    chosen = np.arange(0, len(path), EXACT_EVERY)
    exact = exact_path(make_solids(static, tool), case.poses[chosen])[0]
    deep = np.linalg.norm(exact, axis=1) > 0.2 * MM
    way_mm = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(case.poses[:, :3], axis=0), axis=1))] / MM
    columns = {
        "way_mm": way_mm,
        **dict(zip(("x_m", "y_m", "z_m"), case.poses[:, :3].T, strict=True)),
    }
    rows: list[tuple[object, ...]] = []
    corners = []
    for response, label in NAMES.items():
        options = ReplayOptions(stiffness_N_m=STIFFNESS_N_M, response=response)
        force = run_path(scene, path, options)["force_N"].astype(np.float64)
        turn, error = turns_deg(force), angle_deg(force[chosen], exact)[deep]
        turns.setdefault(case.name, {})[response] = (way_mm[1:], turn)
        columns |= {f"{response}_f{a}_N": f for a, f in zip("xyz", force.T, strict=True)}
        rows.append((case.name, label, float(turn.max()),
                     "" if response == "way_out" else float(error.max(initial=0.0)),
                     f"{felt_radius_mm(force, case.poses):.1f}"))  # fmt: skip
        corners.append(CornerCase(label, case.poses[:, :3], force))
    rows.append((case.name, "exact", "", "", f"{felt_radius_mm(exact, case.poses[chosen]):.1f}"))
    name = case.name.replace(" ", "_")
    setup.write_csv(result, f"direction_{name}.csv", columns)
    if case.name != "three faces":
        figure = draw_corner(corners, section_xz(static), RADIUS_MM * MM)
        setup.write_figure(
            result, f"direction_{name}.png", figure, f"Force arrows along an edge of {case.name}."
        )
    return rows


def _draw_turns(setup: Setup, result: Result, turns: dict[str, dict[str, tuple[F64, F64]]]) -> None:
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        figure = new_figure(10.0, 5.2)
        axes = figure.subplots(2, 2, sharey=True).ravel()
        for axis, (name, found) in zip(axes, turns.items(), strict=True):
            for (response, (way, turn)), colour in zip(
                found.items(), COLOURS[: len(found)], strict=True
            ):
                axis.plot(way, turn, color=colour, label=NAMES[response])
            axis.axhline(18.0, color="#888888", lw=0.8, ls=":")
            axis.set_yscale("symlog", linthresh=0.1)
            axis.set_ylim(0.0, 100.0)
            axis.set_yticks([0.0, 0.1, 1.0, 10.0, 100.0], ["0", "0.1", "1", "10", "100"])
            axis.set_title(name)
            axis.set_xlabel("way of the tool, mm")
        axes[0].legend(loc="center", bbox_to_anchor=(0.5, 0.62))
        axes[0].annotate("noticeable: 18 deg", (0.8, 16.0), xycoords=("axes fraction", "data"),
                         ha="right", va="top", fontsize=7.5, color="#666666")  # fmt: skip
        for axis in axes[::2]:
            axis.set_ylabel("turn in one tick, deg")
        setup.write_figure(
            result, "direction_turns.png", figure, "Turn of the force from tick to tick."
        )
