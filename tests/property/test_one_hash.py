"""A replay has one hash: for both compilers, every optimisation, this machine's own vector width, and any skipping."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import trimesh
from crease.bake.bake import BakeOptions, bake_scene
from crease.base.native import COVERAGES, RESPONSES
from crease.mesh.mesh import make_mesh
from jobs import COUPLE_C, FIRMWARE_C, ROOT, path_job

FLAGS = ["-std=c11", "-D_POSIX_C_SOURCE=200809L", "-ffp-contract=off", "-fno-math-errno"]
WITH_RIVALS = "-DCR_RIVALS"
SOFT = COVERAGES["soft"]
CORE = ((RESPONSES["way_out"], SOFT),)
"""Response and coverage of what ships."""
RIVALS = (
    *((RESPONSES[name], coverage) for name in ("extent", "fixed45") for coverage in COVERAGES.values()),
    *((number, SOFT) for name, number in RESPONSES.items() if name not in ("way_out", "extent", "fixed45")),
)  # fmt: skip
"""Most rivals count samples themselves, the same way under both coverages: one is enough."""
BUILDS = [
    *(f"{cc} {level}" for cc in ("gcc", "clang") for level in ("-O0", "-O1", "-O2", "-O3")),
    "gcc -O3 -march=native -fno-trapping-math",
    "clang -O3 -march=native",
    "gcc -O2 -DCR_SCALAR=1",
    "gcc -O2 -DCR_ASSERTS=1",
]
"""Of what ships; the last one stops where something inside does not hold."""
RIVAL_BUILDS = [
    f"{build} {WITH_RIVALS}"
    for build in ("gcc -O3 -march=native", "clang -O2", "gcc -O2 -DCR_SCALAR=1 -DCR_ASSERTS=1")
]
REFERENCE, RIVAL_REFERENCE = "gcc -O0 -g", f"gcc -O0 {WITH_RIVALS}"

Inputs = tuple[bytes, npt.NDArray[np.float32]]
"""A scene image and rows of a path."""
RIVALS_C = list((ROOT / "firmware/rivals").glob("*.c"))
ASSERT_FAILED_C = ROOT / "firmware/port/linux/assert_failed.c"


def build(folder: Path, options: str) -> Path:
    """The hash program, built with these options."""
    compiler, *levels = options.split()
    program = folder / options.replace(" ", "_")
    sources = [
        *(ROOT / f"tests/check/{part}.c" for part in ("replay_hash", "job", "blob")),
        *FIRMWARE_C,
        *COUPLE_C,
        *(RIVALS_C if WITH_RIVALS in levels else ()),
        *([ASSERT_FAILED_C] if "-DCR_ASSERTS=1" in levels else ()),
    ]
    includes = [f"-I{ROOT / 'firmware'}", f"-I{ROOT / 'tests/check'}"]
    subprocess.run(
        [compiler, *FLAGS, *levels, *includes, *sources, "-lm", "-o", program], check=True
    )
    return program


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("hash")


@pytest.fixture(scope="module")
def inputs() -> Inputs:
    """A stepped block, a turning cube over all its edges: smooth, convex and concave contact, and free space."""
    low = trimesh.creation.box(bounds=[[-40, -40, -30], [40, 40, 0]])
    high = trimesh.creation.box(bounds=[[-40, -40, -10], [0, 40, 15]])
    both = trimesh.util.concatenate([low, high])
    static = make_mesh(both.vertices, both.faces, 1e-3)
    cube = trimesh.creation.box(extents=[20, 20, 20])
    tool = make_mesh(cube.vertices, cube.faces, 1e-3)
    options = BakeOptions(voxel_m=2e-3, spacing_m=1.5e-3)
    image = bake_scene(static, tool, options, lambda _label, _part: None).image
    rng = np.random.default_rng(5)
    s = np.linspace(0.0, 1.0, 1500)
    knots = rng.uniform([-0.045, -0.045, 0.003], [0.045, 0.045, 0.03], (12, 3))
    position = np.stack([np.interp(s, np.linspace(0, 1, 12), knots[:, k]) for k in range(3)], 1)
    turn = np.stack([np.ones_like(s), np.sin(5 * s), np.cos(3 * s), np.sin(2 * s)], 1)
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    period_s = np.full((1500, 1), 1e-3)
    return bytes(image), np.hstack([position, turn, period_s]).astype("<f4")


def run(program: Path, inputs: Inputs, response: int, coverage: int, skip: int) -> str:
    """Hash of all answers, without the work they took."""
    job = program.parent / "one.job"
    block = path_job(*inputs, response=response, coverage=coverage, skip=skip, damping_Ns_m=2.0)
    job.write_bytes(block)
    said = subprocess.run([program, job], capture_output=True, text=True, check=True).stdout.split()
    return said[said.index("answers") + 1]


Hashes = dict[tuple[int, int], str]
"""By response and coverage."""


@pytest.fixture(scope="module")
def reference(folder: Path, inputs: Inputs) -> Hashes:
    """Of what ships: without optimisation and with all skipping."""
    program = build(folder, REFERENCE)
    return {kind: run(program, inputs, *kind, 7) for kind in CORE}


@pytest.fixture(scope="module")
def rival_reference(folder: Path, inputs: Inputs) -> Hashes:
    """The same of the rivals, in the build that has them."""
    program = build(folder, RIVAL_REFERENCE)
    return {kind: run(program, inputs, *kind, 7) for kind in RIVALS}


@pytest.mark.slow
def test_settings_have_hashes_of_their_own(reference: Hashes, rival_reference: Hashes) -> None:
    both = reference | rival_reference
    assert len(set(both.values())) == len(both) == len(RESPONSES) + 2


@pytest.mark.slow
@pytest.mark.parametrize("options", BUILDS)
def test_every_build_has_the_same_hash(
    folder: Path, inputs: Inputs, reference: Hashes, options: str
) -> None:
    program = build(folder, options)
    for (response, coverage), expected in reference.items():
        assert run(program, inputs, response, coverage, 7) == expected


@pytest.mark.slow
@pytest.mark.parametrize("options", RIVAL_BUILDS)
def test_every_build_with_rivals_has_the_same_hash(
    folder: Path, inputs: Inputs, reference: Hashes, rival_reference: Hashes, options: str
) -> None:
    """Also of what ships: that rivals are compiled in changes nothing there."""
    program = build(folder, options)
    for (response, coverage), expected in (reference | rival_reference).items():
        assert run(program, inputs, response, coverage, 7) == expected


@pytest.mark.slow
@pytest.mark.parametrize("skip", range(7))
def test_skipping_changes_no_bit(
    folder: Path, inputs: Inputs, reference: Hashes, skip: int
) -> None:
    program = folder / REFERENCE.replace(" ", "_")
    for (response, coverage), expected in reference.items():
        assert run(program, inputs, response, coverage, skip) == expected


@pytest.mark.slow
def test_skipping_changes_no_bit_of_a_rival(
    folder: Path, inputs: Inputs, rival_reference: Hashes
) -> None:
    """They see the same contact: one subset shows it."""
    program = folder / RIVAL_REFERENCE.replace(" ", "_")
    for (response, coverage), expected in rival_reference.items():
        assert run(program, inputs, response, coverage, 0) == expected
