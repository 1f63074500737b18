"""The page: data of all replays, our scripts and the libraries, in one file that needs nothing else."""

from __future__ import annotations

import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.bake.bodies import Body, read_bodies, reduce_body
from crease.base.attitude import to_matrix
from crease.base.errors import SceneError, TableError
from crease.base.scene import Scene
from crease.draw.plot import forces_N, torques_Nm, turn_deg
from crease.draw.view.felt import (
    Answered,
    amplifications,
    areas_of,
    jumps,
    moved_m,
    start_s,
    stiffness_N_m,
    who_answered,
)
from crease.draw.view.pack import Packer
from crease.draw.view.scripts import load_scripts
from crease.replay.contacts import (
    NO_PATCH,
    Contacts,
    find_contacts,
    find_held,
    parted_as,
    tool_samples_m,
)
from crease.replay.replay import COLUMNS, RUNS, ReplayOptions
from crease.replay.trajectory import COLUMNS as PATH_COLUMNS
from crease.replay.trajectory import Trajectory, check_rows

REPLAYS_MAX = 4
"""More stand too small beside each other."""

TRIANGLES_MAX = 120_000
"""A body of more triangles is drawn coarser: the page would grow over 8 MB."""

TICKS_MAX = 1_000_000
"""Longest replay that a browser holds with ease."""

OURS = ("decode.js", "scene.js", "plots.js", "list.js", "player.js")
"""Our scripts, in the order in which they are run."""

FOLDER = Path(__file__).parent
VIEW_SPAN = 1.1
"""Half the height of the first picture, in lengths from its middle to the far side of the tool."""

_POSITION_M, _ANGLE, _FORCE_N, _DEPTH_M, _TIME_S, _TURN_DEG = 1e-6, 1e-6, 1e-4, 1e-7, 1e-6, 1e-3
_TORQUE_NM, _SHARE, _POINT_M = 1e-6, 1e-3, 1e-5
"""Resolutions: well below what a picture shows."""


@dataclass(frozen=True)
class Replay:
    """One table of ticks under a name. Shapes: table has the columns of `crease.replay.replay.COLUMNS`, all (n,)."""

    name: str
    table: Mapping[str, npt.NDArray[Any]]
    preview: bool = False
    """The table answers with the default settings to a path that nobody has replayed yet."""


@dataclass(frozen=True)
class Page:
    """The page and what making it found."""

    text: str
    warnings: tuple[str, ...]
    report: dict[str, object]


@dataclass
class _Made:
    """What is collected on the way: replays of one path share its contacts."""

    scene: Scene
    packer: Packer = field(default_factory=Packer)
    warnings: list[str] = field(default_factory=list)
    contacts: list[tuple[Trajectory, ReplayOptions, Contacts]] = field(default_factory=list)


def path_of(replay: Replay) -> Trajectory:
    """The path of a table.   Errors: TableError when columns are missing or unequal; TrajectoryError for a bad pose."""
    missing = [name for name in COLUMNS if name not in replay.table]
    if missing:
        if "energy_J" in replay.table and "states_us" in replay.table:
            raise TableError(
                f"{replay.name}: is of a loop (`crease hil`, or a recording that ran again), which a page does not "
                "show; draw it with `crease plot`"
            )
        more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
        raise TableError(
            f"{replay.name}: no column {missing[0]}{more}: not a table of a replayed path; replay it"
        )
    if "couple_late" in replay.table:
        raise TableError(
            f"{replay.name}: is of a loop with a held tool, whose contacts a page cannot find again; draw it with "
            "`crease plot`, or its path with `crease replay --couple` and then `crease view`"
        )
    columns = [np.asarray(replay.table[name]) for name in COLUMNS]
    if any(column.ndim != 1 or len(column) != len(columns[0]) for column in columns):
        raise TableError(f"{replay.name}: the columns are not of one length; replay it again")
    if len(columns[0]) > TICKS_MAX:
        raise TableError(f"{replay.name}: has over {TICKS_MAX:,} ticks; cut it")
    for name, column in zip(COLUMNS, columns, strict=True):
        if not (np.issubdtype(column.dtype, np.number) and np.isfinite(column).all()):
            raise TableError(
                f"{replay.name}: column {name} has an entry that is not a finite number; replay it again"
            )
    rows = np.stack([replay.table[name] for name in PATH_COLUMNS], axis=1).astype(np.float64)
    return check_rows(rows, replay.name)


def _check_scene(made: _Made, replay: Replay, contacts: Contacts, differ: int) -> None:
    """Errors: SceneError when the table is of another scene. A few ticks that differ are worth a warning."""
    touching = (contacts.ticks["areas"] > 0) | (np.asarray(replay.table["areas"]) > 0)
    if differ == 0:
        return
    if 2 * differ > np.count_nonzero(touching):
        raise SceneError(
            f"{made.scene.source}: does not give the contacts of {replay.name}; name the scene that was replayed"
        )
    made.warnings.append(
        f"{replay.name}: {differ:,} of {len(contacts.ticks):,} ticks touch something else when run again; "
        "replay it again"
    )


def _contacts_of(made: _Made, replay: Replay, path: Trajectory, answered: Answered) -> int:
    """Index into made.contacts.   Errors: SceneError when the table is of another scene."""
    held = answered.options.couple is not None
    parted = answered.options if held else parted_as(answered.options)
    for i, (other, kind, _) in enumerate(made.contacts):
        if kind == parted and np.array_equal(other.rows, path.rows):
            at = i
            break
    else:
        at = len(made.contacts)
        found = (
            find_held(made.scene, path, parted)[0]
            if held
            else find_contacts(made.scene, path, parted)
        )
        made.contacts.append((path, parted, found))
    _check_scene(made, replay, made.contacts[at][2], answered.differ)
    return at


def _add_replay(
    made: _Made, key: str, replay: Replay, path: Trajectory, options: ReplayOptions
) -> dict[str, Any]:
    """What the header says of a replay: its stiffness, its jumps, and the settings of one made for the page alone."""
    packer, table = made.packer, replay.table
    held = options.couple is not None
    force_N = forces_N(table)
    stiffness = options.stiffness_N_m if held else stiffness_N_m(table)
    shift_m = np.stack([table[f"d{axis}_m"] for axis in "xyz"], axis=1) - path.position_m
    amplification = amplifications(force_N, stiffness, moved_m(made.scene, path))
    areas = areas_of(made.scene, path, options, table)
    packer.add_numbers(f"{key}.t_s", path.t_s - path.t_s[0], _TIME_S)
    packer.add_numbers(f"{key}.position_m", path.position_m, _POSITION_M)
    packer.add_numbers(f"{key}.quaternion", path.rows[:, 4:], _ANGLE)
    packer.add_numbers(f"{key}.shift_m", shift_m, _POSITION_M)
    if held:
        turned = np.stack([table[f"dq{part}"] for part in "wxyz"], axis=1)
        packer.add_numbers(f"{key}.held_quaternion", turned, _ANGLE)
    packer.add_numbers(f"{key}.force_N", force_N, _FORCE_N)
    packer.add_numbers(f"{key}.torque_Nm", torques_Nm(table), _TORQUE_NM)
    packer.add_numbers(f"{key}.depth_m", table["depth_m"], _DEPTH_M)
    packer.add_numbers(f"{key}.turn_deg", np.nan_to_num(turn_deg(force_N), nan=-1.0), _TURN_DEG)
    packer.add_numbers(f"{key}.amplification", amplification, _SHARE)
    for name in ("tick_ns", "areas", "zones", "contacts"):
        packer.add_integers(f"{key}.{name}", np.minimum(table[name], 1 << 29))
    packer.add_integers(f"{key}.area_count", areas.counts)
    packer.add_numbers(f"{key}.area_point_m", areas.areas["point_m"], _POINT_M)
    packer.add_numbers(f"{key}.area_force_N", areas.areas["force_N"], 10 * _FORCE_N)
    packer.add_numbers(
        f"{key}.area_depth_m", areas.areas["depth_m"], (0.1 if held else 10) * _DEPTH_M
    )
    return {
        "stiffness_N_m": stiffness,
        "held": held,
        "settings": f"{options.response}, {options.stiffness_N_m:g} N/m",
        "jumps": jumps(force_N, amplification).tolist(),
        "runs": int(table[RUNS][0]) if RUNS in table else None,
    }


def _add_contacts(made: _Made, key: str, contacts: Contacts, patches: list[int]) -> None:
    """Changes name their state: 0 is no contact, else 1 + index into `key.states` of (area label, zone)."""
    packer, changes, zones = made.packer, contacts.changes, contacts.zones
    colour = {patch: index for index, patch in enumerate(patches)}
    zone_of = np.array([colour.get(int(p), -1) for p in changes["patch"]], np.int64)
    pairs = np.stack([changes["area"].astype(np.int64) - 1, zone_of], axis=1)
    states, index = np.unique(pairs[changes["area"] > 0], axis=0, return_inverse=True)
    state = np.zeros(len(changes), np.int64)
    state[changes["area"] > 0] = 1 + index.reshape(-1)
    packer.add_integers(f"{key}.states", states.reshape(-1, 2))
    packer.add_integers(f"{key}.changes", contacts.ticks["changes"])
    packer.add_integers(f"{key}.sample", changes["sample"])
    packer.add_integers(f"{key}.state", state)
    packer.add_numbers(f"{key}.point_m", contacts.ticks["point_m"], _POSITION_M)
    packer.add_integers(f"{key}.zone_count", contacts.ticks["zones_stored"])
    packer.add_integers(f"{key}.zone", [colour.get(int(p), -1) for p in zones["patch"]])
    packer.add_numbers(f"{key}.zone_centre_m", zones["centre_m"], 1e-5)
    packer.add_numbers(f"{key}.zone_normal", zones["normal"], 1e-3)
    packer.add_numbers(f"{key}.zone_radius_m", np.sqrt(zones["area_m2"] / np.pi), 1e-5)
    packer.add_numbers(f"{key}.zone_share", zones["share"], 1e-2)


def _patches(made: _Made, used: Sequence[int]) -> list[int]:
    """Patches that are touched, the longest touched first."""
    zones = np.concatenate([made.contacts[i][2].zones["patch"] for i in used])
    patches, counts = np.unique(zones[zones != NO_PATCH], return_counts=True)
    return [int(p) for p in patches[np.argsort(-counts, kind="stable")]]


def add_body(packer: Packer, key: str, body: Body) -> None:
    """A body under `key`, to a picture's precision."""
    size_m = float(np.abs(body.vertices_m).max())
    packer.add_numbers(f"{key}.vertices_m", body.vertices_m, size_m / 65536)
    packer.add_integers(f"{key}.triangles", body.triangles)


def _unit(v: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """v at length 1, or zero."""
    length = float(np.linalg.norm(v))
    return v / length if length > 0.0 else np.zeros_like(v)


def _camera(scene: Scene, path: Trajectory, contacts: Contacts) -> dict[str, object]:
    """Where to look from: the middle of the path, across its plane and from outside, wide enough for the tool."""
    meta = scene.meta
    centre = np.array([float(v) for v in meta.root_centre_m])
    middle_m = to_matrix(path.rows[:, 4:]) @ centre + path.position_m
    zones = contacts.zones
    outward = _unit(zones["normal"].astype(np.float64).sum(axis=0)) if len(zones) else np.zeros(3)
    outward = outward if outward.any() else np.array([0.0, 0.0, 1.0])
    touching = contacts.ticks["areas"] > 0
    points_m = contacts.ticks["point_m"].astype(np.float64)
    halfway_m = 0.5 * (points_m + middle_m)[touching] if touching.any() else middle_m
    target_m = halfway_m.mean(axis=0)
    _, axes = np.linalg.eigh(np.cov(middle_m.T, ddof=0))
    least, most = axes[:, 0], axes[:, 2]
    across = least - (least @ outward) * outward
    if np.linalg.norm(across) < 0.3:
        across = np.cross(most, outward)
    across = _unit(across) if np.linalg.norm(across) > 1e-6 else np.array([0.0, -1.0, 0.0])
    across = across if across @ np.array([0.3, -1.0, 0.2]) >= 0.0 else -across
    away_m = float(np.percentile(np.linalg.norm(middle_m - target_m, axis=1), 75))
    radius_m = float(meta.root_radius_m)
    return {
        "target_m": target_m.tolist(),
        "direction": _unit(outward + across).tolist(),
        "span_m": VIEW_SPAN * (radius_m + min(away_m, 2.0 * radius_m)),
    }


def fill(template: str, parts: Mapping[str, str]) -> str:
    """A template with everything in its place: `parts`, and the libraries.   Errors: CreaseError without those."""
    scripts = load_scripts()
    whole = {
        "THREE": scripts.three,
        "UPLOT": scripts.uplot,
        "NOTICE": html.escape(scripts.notice),
        **parts,
        "STYLE": scripts.uplot_css + parts["STYLE"],
    }
    pieces = template.split("@@")
    return "".join(whole[p] if i % 2 else p for i, p in enumerate(pieces))


def _fill(title: str, header: dict[str, object], data: str) -> str:
    """The page of replays."""
    return fill(
        (FOLDER / "page.html").read_text(encoding="utf-8"),
        {
            "TITLE": html.escape(title),
            "STYLE": (FOLDER / "page.css").read_text(encoding="utf-8"),
            "OURS": "\n".join((FOLDER / name).read_text(encoding="utf-8") for name in OURS),
            "HEADER": json.dumps(header, allow_nan=False).replace("<", "\\u003c"),
            "DATA": data,
        },
    )


def make_page(replays: Sequence[Replay], scene: Scene, title: str) -> Page:
    """One page for replays of one scene.

    Errors: CreaseError for tables that do not fit the scene, too many of them, or libraries that are not installed.
    Cost: about 2 s and 1.3 MB for 2 x 3,000 ticks.
    """
    if len(replays) > REPLAYS_MAX:
        raise TableError(
            f"{len(replays)} replays do not fit beside each other; give {REPLAYS_MAX} at most"
        )
    static, tool = read_bodies(scene)
    made = _Made(scene)
    paths = [path_of(replay) for replay in replays]
    answered = [
        who_answered(scene, path, replay.table) for replay, path in zip(replays, paths, strict=True)
    ]
    index = [_contacts_of(made, *each) for each in zip(replays, paths, answered, strict=True)]
    used = sorted(set(index))
    patches = _patches(made, used)
    found = [
        _add_replay(made, f"replay{i}", replay, path, answered[i].options)
        for i, (replay, path) in enumerate(zip(replays, paths, strict=True))
    ]
    for i in used:
        _add_contacts(made, f"contacts{i}", made.contacts[i][2], patches)
    drawn = {"static": reduce_body(static, TRIANGLES_MAX), "tool": reduce_body(tool, TRIANGLES_MAX)}
    for name, body in drawn.items():
        add_body(made.packer, name, body)
    made.packer.add_numbers("samples_m", tool_samples_m(scene), _POSITION_M)
    header: dict[str, object] = {
        "title": title,
        "replays": [
            {"name": r.name, "contacts": f"contacts{i}", "preview": r.preview, **more}
            for r, i, more in zip(replays, index, found, strict=True)
        ],
        "patches": patches,
        "start_s": start_s(
            [replay.table for replay in replays], [np.array(m["jumps"], np.int64) for m in found]
        ),
        "arrays": made.packer.header,
        "camera": _camera(scene, paths[0], made.contacts[index[0]][2]),
        "tool_radius_m": float(scene.meta.root_radius_m),
        "spacing_m": float(scene.meta.spacing_m),
        "crease_angle_rad": float(scene.meta.crease_angle_rad),
    }
    text = _fill(title, header, made.packer.encode())
    report: dict[str, object] = {
        "replays": len(replays),
        "ticks": max(len(path) for path in paths),
        "page_bytes": len(text.encode("utf-8")),
        "triangles": {name: len(body.triangles) for name, body in drawn.items()},
        "triangles_baked": {"static": len(static.triangles), "tool": len(tool.triangles)},
    }
    return Page(text, tuple(made.warnings), report)
