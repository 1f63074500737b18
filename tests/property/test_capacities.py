"""Far too small capacities: every overflow is counted, and the answers stay finite, limited and inside their memory."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
from crease.base.native import RESPONSES
from property_scenes import NAMES, ROOT, SEED, as_path, pair, poses_near
from study.program import CORE, RIVALS, WITH_RIVALS

FLAGS = [  # not optimised: it is built ten times, and runs for a second
    *("-std=c11", "-D_POSIX_C_SOURCE=200809L", "-ffp-contract=off", "-O0", "-g"),
    *("-fsanitize=address,undefined", "-fno-sanitize-recover=all"),
]
SHIPPED = {
    "default": (),
    "clusters": ("-DCR_CLUSTERS_MAX=16",),
    "lookups": ("-DCR_LOOKUPS_MAX=32",),
    "areas": ("-DCR_AREAS_MAX=1",),
    "zones": ("-DCR_ZONES_MAX=3",),
    "all": (
        *("-DCR_CLUSTERS_MAX=16", "-DCR_LOOKUPS_MAX=32"),
        *("-DCR_AREAS_MAX=1", "-DCR_ZONES_MAX=3"),
    ),
}
TOUCHES = "-DCR_TOUCHES_MAX=16"
OF_RIVALS = {
    **{name: (WITH_RIVALS, *SHIPPED[name]) for name in ("areas", "zones")},
    "touches": (WITH_RIVALS, TOUCHES),
    "all": (WITH_RIVALS, TOUCHES, *SHIPPED["all"]),
}
"""What they fill themselves, and all: clusters and lookups are filled by what finds contact, which is the same."""
BUILDS = SHIPPED | {f"{name}, rivals": small for name, small in OF_RIVALS.items()}
OVERFLOWS = {"clusters", "lookups", "all"}
"""Builds that must overflow in the scenes below; the others may."""
POSES = 80
WAY_OUT, EXTENT = RESPONSES["way_out"], RESPONSES["extent"]
SETTINGS = ((WAY_OUT, 0, 0), (WAY_OUT, 0, 7))
SETTINGS_OF_RIVALS = ((EXTENT, 0, 7), (EXTENT, 1, 7))
"""Response, coverage, skips."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("capacities")


def build(folder: Path, name: str) -> Path:
    """The program with these capacities, under sanitizers."""
    program = folder / name
    stages = [*CORE, *(RIVALS if name not in SHIPPED else ())]
    checks = [ROOT / f"tests/check/{name}.c" for name in ("capacities", "blob")]
    sources = [*checks, ROOT / "host/native/replay.c", *stages]
    includes = [f"-I{ROOT / 'firmware'}", f"-I{ROOT / 'host/native'}"]
    command = [
        str(part)
        for part in ("gcc", *FLAGS, *BUILDS[name], *includes, *sources, "-lm", "-o", program)
    ]
    subprocess.run(command, check=True)
    return program


@pytest.mark.slow
@pytest.mark.parametrize("name", BUILDS)
def test_overflow_is_counted_and_harmless(folder: Path, name: str) -> None:
    program, overflows = build(folder, name), 0
    for scene_name in NAMES:
        of = pair(scene_name)
        image, path = folder / f"{scene_name}.crs", folder / f"{scene_name}.bin"
        image.write_bytes(of.scene.image.tobytes())
        poses = poses_near(np.random.default_rng(SEED), of, POSES, 5e-3, 0.0)
        as_path(poses).rows.astype("<f8").tofile(path)
        for settings in SETTINGS if name in SHIPPED else SETTINGS_OF_RIVALS:
            command = [str(part) for part in (program, image, path, *settings)]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr
            ticks, touching, over, _ = done.stdout.split()
            assert int(ticks) == POSES
            assert int(touching) > POSES // 3
            overflows += int(over)
    assert overflows > 0 or name.removesuffix(", rivals") not in OVERFLOWS
