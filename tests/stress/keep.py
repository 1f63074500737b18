"""A violation as files: the scene, the fewest poses that show it, the command that replays it."""

from __future__ import annotations

import json
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
from crease.bake.bodies import write_bodies
from crease.base.native import skip_words
from crease.base.table import write_bytes, write_table
from crease.replay.replay import ReplayOptions
from crease.replay.trajectory import COLUMNS

from stress.cases import Place
from stress.checks import PERIOD_S, Violation, path_of
from stress.pool import Placed, to_frame

F64 = npt.NDArray[np.float64]


def _write_placed(folder: Path, name: str, placed: Placed, poses: F64) -> None:
    image = folder / f"{name}.crs"
    write_bytes(image, placed.scene.image.tobytes())
    write_bodies(image, placed.static, placed.tool)
    rows = path_of(to_frame(placed.frame, poses), PERIOD_S).rows
    write_table(
        folder / f"{name}.csv", dict(zip(COLUMNS, np.ascontiguousarray(rows.T), strict=True))
    )


def command(name: str, o: ReplayOptions) -> str:
    """The `crease replay` of a scene with these settings."""
    out = f"{name}-out.csv" if o.skip is None else f"{name}-skips-out.csv"
    words = ["crease", "replay", f"{name}.crs", f"{name}.csv", "-o", out, "--force"]
    words += ["--stiffness", f"{o.stiffness_N_m:g}", "--damping", f"{o.damping_Ns_m:g}"]
    words += ["--response", o.response, "--coverage", o.coverage]
    if o.force_max_N is not None:
        words += ["--force-max", f"{o.force_max_N:g}"]
    if o.skip is not None:
        words += ["--skips", skip_words(o.skip)]
    return shlex.join(words)


def keep(
    folder: Path, seed: tuple[int, ...], kind: str, place: Place, violation: Violation
) -> Path:
    """Write a reproducer into a folder of its own below `folder`.   Output: that folder.   Errors: CreaseError."""
    own = folder / f"{violation.check.split()[0]}-{'-'.join(map(str, seed))}"
    own.mkdir(parents=True, exist_ok=True)
    names = ["scene"]
    _write_placed(own, "scene", place.placed, violation.poses)
    if violation.check == "frame":
        other = place.pair.there if place.placed is place.pair.here else place.pair.here
        names.append("turned")
        _write_placed(own, "turned", other, violation.poses)
    settings = [violation.options]
    if violation.check == "skipping":
        settings.append(replace(violation.options, skip=None))
    report = {
        "case": list(seed),
        "kind": kind,
        "scene": place.pair.name,
        "check": violation.check,
        "found": violation.text,
        "value": violation.value,
        "bound": violation.bound,
        "scale": place.placed.frame.scale,
        "replay": [command(name, o) for name in names for o in settings],
    }
    write_bytes(own / "case.json", (json.dumps(report, indent=1) + "\n").encode())
    return own
