"""`crease bake` before and round the work: memory, units of bare numbers, tolerances, two at once, noise."""

from __future__ import annotations

import errno
import fcntl
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pytest
import trimesh
from crease.bake.bake import BakeOptions, bake_scene
from crease.bake.kinds import Kinds
from crease.bake.layout import read_sections
from crease.bake.planes import BrickPlanes
from crease.bake.surface import make_surface
from crease.bake.voxmap import _merged
from crease.base.native import lib
from crease.base.scene import open_image, open_scene
from crease.base.units import parse_length, parse_size
from crease.lab.setup import make_path, upright
from crease.mesh.mesh import make_mesh
from crease.replay.replay import run_path
from host_tools import Run


def bake_args(folder: Path, block: Path, ball: Path) -> list[object]:
    return ["bake", block, ball, "-o", folder / "out.crs", "--unit", "mm"]


@pytest.mark.quiet
@pytest.mark.parametrize(
    "option", [("--spacing", "0.01mm"), ("--voxel", "0.02mm"), ("--voxel", "1um")]
)
def test_too_much_memory_is_refused_at_once_with_the_numbers(
    tmp_path: Path,
    block_stl: Path,
    ball_stl: Path,
    crease: Run,
    option: tuple[str, str],
) -> None:
    start_s = time.monotonic()
    said = crease(*bake_args(tmp_path, block_stl, ball_stl), *option, "--memory-max", "2GiB")
    assert time.monotonic() - start_s < 20.0
    assert said.status == 1
    assert said.err.count("\n") == 1
    assert option[0] in said.err
    assert "more than --memory-max 2GiB; use " in said.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("option", "body"), [("--spacing", "tool"), ("--voxel", "mock-up")])
def test_a_length_larger_than_what_it_divides_is_refused_at_once(
    tmp_path: Path, block_stl: Path, ball_stl: Path, crease: Run, option: str, body: str
) -> None:
    """A voxel of a thousand kilometres was baked for 18 s, into an image that could not be read."""
    said = crease(*bake_args(tmp_path, block_stl, ball_stl), option, "1e9")
    assert said.status == 1
    assert f"error: {option} 1e+06m is larger than the {body} (" in said.err
    assert list(tmp_path.iterdir()) == []


def test_a_default_voxel_that_is_too_large_is_not_recommended(
    tmp_path: Path, block_stl: Path, ball_stl: Path, crease: Run
) -> None:
    """`--voxel 670mm is larger than the mock-up (100 mm): use a smaller one, such as 670 mm, the default`."""
    said = crease(*bake_args(tmp_path, block_stl, ball_stl), "--tool-unit", "m")
    assert said.status == 1
    (line,) = [line for line in said.err.splitlines() if line.startswith("error: ")]
    assert " is larger than the mock-up (" in line
    assert "the default" not in line
    ((most, such),) = re.findall(r"\((\S+) mm\): use a smaller one, such as (\S+) mm", line)
    assert float(such) < float(most)


def test_a_sheet_thicker_than_the_mesh_is_large_is_refused(
    tmp_path: Path, ball_stl: Path, crease: Run
) -> None:
    sheet = tmp_path / "sheet.stl"
    square = [[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]]
    trimesh.Trimesh(square, [[0, 1, 2], [0, 2, 3]]).export(sheet)
    line = [*bake_args(tmp_path, sheet, ball_stl)[:-1], "m", "--tool-unit", "mm", "--sheet", "1m"]
    said = crease(*line)
    assert said.status == 1
    assert said.err == (
        f"error: {sheet}: --sheet 1m is larger than the mesh (100 mm): use a smaller one\n"
    )
    assert list(tmp_path.iterdir()) == [sheet]


@pytest.mark.parametrize("option", [("--spacing", "2mm"), ("--spacing", "9mm")])
def test_memory_that_no_bake_fits_into_is_not_laid_on_the_spacing(
    tmp_path: Path,
    block_stl: Path,
    ball_stl: Path,
    crease: Run,
    option: tuple[str, str],
) -> None:
    said = crease(*bake_args(tmp_path, block_stl, ball_stl), *option, "--memory-max", "1MB")
    assert said.status == 1
    assert "; any bake takes over 286 MiB" in said.err
    assert " or more" not in said.err


@pytest.mark.slow
def test_the_size_that_a_refusal_names_fits(
    tmp_path: Path, block_stl: Path, ball_stl: Path, crease: Run
) -> None:
    args = [*bake_args(tmp_path, block_stl, ball_stl), "--memory-max", "340MB"]
    said = crease(*args, "--spacing", "0.2mm")
    named = said.err.split("; use ")[1].removesuffix(" or more\n")
    assert crease(*args, "--spacing", named, "--voxel", "5mm").status == 0
    coarse = [*args, "--spacing", "2mm", "--force"]
    for voxel in ("1um", "0.2mm"):  # the whole grid, and its bricks near the surface
        said = crease(*coarse, "--voxel", voxel)
        assert f"--voxel {voxel.replace('0.2mm', '200um')} makes " in said.err
        named = said.err.split("; use ")[1].removesuffix(" or more\n")
        said = crease(*coarse, "--voxel", named)
        assert said.status == 0, said.err
    for option, value in (("--spacing", "1m"), ("--voxel", "1m")):
        said = crease(*coarse, option, value)
        named = said.err.split("such as ")[1].removesuffix(", the default\n")
        assert crease(*coarse, option, named, "--memory-max", "2GiB").status == 0
    small = [*coarse[:-3], "--image-max", "60KiB", "--force", "--memory-max", "2GiB"]
    said = crease(*small)
    assert "the shell of the tool alone takes " in said.err
    named = said.err.split("such as ")[1].removesuffix("\n")
    assert crease(*small, "--spacing", named).status == 0


@pytest.mark.slow
def test_a_bare_number_is_in_the_unit_of_the_file(
    tmp_path: Path, block_stl: Path, ball_stl: Path, crease: Run
) -> None:
    args = [*bake_args(tmp_path, block_stl, ball_stl), "--json", "--force"]
    with_unit = crease(*args, "--voxel", "2mm", "--spacing", "1.5mm").json
    bare = crease(*args, "--voxel", "2", "--spacing", "1.5").json
    assert bare["bake"]["voxel_m"] == with_unit["bake"]["voxel_m"] == pytest.approx(2e-3, rel=1e-6)
    assert bare["bake"]["spacing_m"] == with_unit["bake"]["spacing_m"]
    assert parse_length("2", 1e-3) == pytest.approx(2e-3)
    assert parse_length("2in", 1e-3) == pytest.approx(0.0508)


@pytest.mark.parametrize("option", ["voxel", "spacing", "sheet", "tolerance", "depth-max", "chord"])
def test_a_bare_number_is_refused_where_the_meshes_have_two_units(
    option: str, tmp_path: Path, block_stl: Path, ball_stl: Path, crease: Run
) -> None:
    args = [*bake_args(tmp_path, block_stl, ball_stl), "--tool-unit", "in", f"--{option}"]
    said = crease(*args, "1.2")
    assert (said.status, said.out) == (2, "")
    assert said.err.startswith(
        f"error: --{option} 1.2: the two meshes have different units; write 1.2mm or 1.2in"
    )
    assert said.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_chord_is_of_step_files(
    tmp_path: Path, block_stl: Path, ball_stl: Path, crease: Run
) -> None:
    said = crease(*bake_args(tmp_path, block_stl, ball_stl), "--chord", "0.1mm")
    assert (said.status, said.out) == (2, "")
    assert said.err == (
        "error: --chord is of STEP files, and neither mesh is one; leave it out; see `crease bake --help`\n"
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "size"),
    [("4GiB", 4 * 2**30), ("500MB", 500_000_000), ("1.9 MiB", 1992294)],
)
def test_sizes_are_bytes(text: str, size: int) -> None:
    assert parse_size(text) == size


@pytest.mark.slow
def test_a_tolerance_that_is_missed_is_said_and_strictly_refused(
    tmp_path: Path, block_stl: Path, ball_stl: Path, crease: Run
) -> None:
    args = [
        *bake_args(tmp_path, ball_stl, ball_stl),
        "--voxel",
        "4mm",
        "--spacing",
        "2mm",
    ]
    said = crease(*args, "--tolerance", "1nm", "--json")
    assert said.status == 0
    missed = [w for w in said.json["warnings"] if "more than the tolerance of" in w]
    assert len(missed) == 1
    strict = crease(*args, "--tolerance", "1nm", "--strict", "--force")
    assert strict.status == 1
    assert "--strict" in strict.err
    assert strict.err.count("more than the tolerance of") == 1
    reached = crease(*args, "--tolerance", "1mm", "--force", "--json")
    assert reached.json["bake"]["error_max_m"] <= 1e-3
    assert not any("tolerance" in w for w in reached.json["warnings"])


def test_an_output_that_another_writes_is_refused_and_nothing_is_lost(
    tmp_path: Path, block_stl: Path, ball_stl: Path, crease: Run
) -> None:
    """The other bake is played by this process: it holds the lock that `bake` takes."""
    args = [
        *bake_args(tmp_path, block_stl, ball_stl),
        "--voxel",
        "4mm",
        "--spacing",
        "3mm",
    ]
    held = os.open(tmp_path / ".out.crs.lock", os.O_CREAT | os.O_RDWR)
    fcntl.flock(held, fcntl.LOCK_EX)
    said = crease(*args)
    assert said.status == 1
    assert "is being written by another" in said.err
    assert not (tmp_path / "out.crs").exists()
    os.close(held)
    assert crease(*args).status == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out.crs", "out.crs.glb"]


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_bake_that_is_interrupted_leaves_nothing(
    tmp_path: Path, ball_stl: Path, number: signal.Signals
) -> None:
    """SIGTERM left the lock of the output, and libraries swallowed SIGINT while they were imported."""
    command = [
        Path(sys.executable).parent / "crease",
        *bake_args(tmp_path, ball_stl, ball_stl),
    ]
    # A job in the background of a script has SIGINT ignored, and so had this child.
    kept = signal.signal(signal.SIGINT, signal.SIG_DFL)
    child = subprocess.Popen(
        [str(word) for word in (*command, "--spacing", "0.15mm")], stderr=subprocess.PIPE
    )
    signal.signal(signal.SIGINT, kept)
    while child.poll() is None and not (tmp_path / ".out.crs.lock").exists():
        time.sleep(0.01)
    time.sleep(1.0)  # amid a bake
    child.send_signal(number)
    said = child.communicate(timeout=120)[1]
    assert (child.returncode, said) == (-number, b"error: interrupted\n")
    assert list(tmp_path.iterdir()) == []


def test_an_image_that_cannot_be_written_leaves_what_was_there(
    tmp_path: Path, block_stl: Path, ball_stl: Path, crease: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on a full disk: the meshes beside the image are not replaced either."""

    def full(data: bytes) -> Callable[[BinaryIO], None]:
        def write(file: BinaryIO) -> None:
            if not data.startswith(b"glTF"):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            file.write(data)

        return write

    monkeypatch.setattr("crease.verbs.bake.bytes_writer", full)
    args = [*bake_args(tmp_path, block_stl, ball_stl), "--voxel", "4mm", "--spacing", "3mm"]
    said = crease(*args)
    assert (said.status, said.err) == (
        1,
        f"error: {tmp_path / 'out.crs'}: cannot be written: No space left on device\n",
    )
    assert list(tmp_path.iterdir()) == []
    for name in ("out.crs", "out.crs.glb"):
        (tmp_path / name).write_text("old")
    assert crease(*args, "--force").status == 1
    assert [p.read_text() for p in tmp_path.iterdir()] == ["old", "old"]


@pytest.mark.slow
def test_the_same_bytes_with_any_number_of_workers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ball = trimesh.creation.icosphere(4, radius=20.0)
    other = ball.copy().apply_translation([9.0, 4.0, 2.0])
    both = trimesh.util.concatenate([ball, other])
    images = set()
    for threads in (1, 2, 5):
        for module in ("bake.surface", "bake.gather", "mesh.arrange"):
            monkeypatch.setattr(f"crease.{module}.THREADS", threads)
        static, tool = (make_mesh(m.vertices, m.faces, 1e-3, source="m") for m in (both, ball))
        images.add(bake_scene(static, tool, BakeOptions(voxel_m=4e-3, spacing_m=2e-3)).image)
    assert len(images) == 1


def test_a_truncated_stl_says_what_it_holds(
    tmp_path: Path, block_stl: Path, ball_stl: Path, crease: Run
) -> None:
    cut = tmp_path / "cut.stl"
    cut.write_bytes(ball_stl.read_bytes()[: 84 + 50 * 100 + 7])
    said = crease("bake", block_stl, cut, "-o", tmp_path / "out.crs", "--unit", "mm")
    assert said.status == 1
    assert f"{cut}: is cut off: it holds 100 of 5,120 triangles" in said.err


@pytest.mark.slow
def test_noise_that_makes_creases_is_said_once() -> None:
    ball = trimesh.creation.icosphere(4, radius=20.0)
    shake = np.random.default_rng(3).normal(0.0, 0.35, ball.vertices.shape)
    tool = trimesh.creation.box(extents=(10.0, 10.0, 10.0))
    cube = make_mesh(tool.vertices, tool.faces, 1e-3, source="cube")
    options = BakeOptions(voxel_m=4e-3, spacing_m=3e-3)
    noisy = make_mesh(ball.vertices + shake, ball.faces, 1e-3, source="noisy")
    said = [w for w in bake_scene(noisy, cube, options).warnings if "noise" in w]
    assert len(said) == 1
    assert "crease_angle_deg=90 leaves" in said[0]
    clean = make_mesh(ball.vertices, ball.faces, 1e-3, source="clean")
    assert not any("noise" in w for w in bake_scene(clean, cube, options).warnings)


@pytest.mark.slow
def test_a_mesh_far_from_its_origin_is_warned_of(
    tmp_path: Path, block_stl: Path, ball_stl: Path, crease: Run
) -> None:
    far = tmp_path / "far.stl"
    block = trimesh.load(block_stl)
    block.apply_translation([0, 0, 100_000])
    block.export(far)
    said = "far.stl: lies up to 100 m from the origin, where positions are off by up to 5.96 um"
    args = ("--unit", "mm", "--voxel", "2mm")
    answer = crease(*bake_args(tmp_path, far, ball_stl), "--spacing", "2mm", "--voxel", "2mm")
    assert answer.status == 0
    assert said in answer.err
    assert "over 1/1000 of a voxel of 2 mm" in answer.err
    assert "lies up to 100 m from the origin" in crease("check", far, *args).out
    assert "from the origin" not in crease("check", block_stl, *args).out

    down_m = np.linspace(
        [0.0, 0.0, 100.0085], [0.0, 0.0, 100.008], 2000
    )  # in steps of a quarter micrometre
    scene = open_scene(tmp_path / "out.crs")
    depth_m = run_path(scene, make_path(upright(down_m)))["depth_m"].astype(np.float64)
    assert 50 < len(np.unique(depth_m)) < 100  # the stairs that it warns of


def test_an_image_gets_no_larger_than_wished() -> None:
    ball = trimesh.creation.icosphere(4, radius=20.0)
    mesh = make_mesh(ball.vertices, ball.faces, 1e-3, source="ball")
    free = bake_scene(mesh, mesh, BakeOptions(voxel_m=1e-3, spacing_m=3e-3))
    room = len(free.image) // 2
    fitted = bake_scene(mesh, mesh, BakeOptions(voxel_m=1e-3, spacing_m=3e-3, image_max_bytes=room))
    assert len(fitted.image) <= room
    assert any("image_max_bytes=" in note for note in fitted.warnings)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shape", "most_bytes", "off_max_N"),
    [("block", 290_000, 0.01), ("cylinder", 590_000, 2.0)],
)
def test_above_the_depth_of_the_tool_the_force_is_the_same_to_the_bit(
    shape: str, most_bytes: int, off_max_N: float
) -> None:
    """A ball goes 18 mm in, where 3 were said: the image is smaller, and deeper the force does not turn round.

    362,112 bytes are 260,032 with the block, 583,872 are 562,624 with the cylinder.
    """
    solid = (
        trimesh.creation.box(extents=(60.0, 60.0, 40.0))
        if shape == "block"
        else trimesh.creation.cylinder(20.0, 40.0, sections=96)
    )
    tool = trimesh.creation.icosphere(3, radius=8.0)
    static, ball = (make_mesh(m.vertices, m.faces, 1e-3, source="m") for m in (solid, tool))
    depth_m = np.linspace(-1e-3, 18e-3, 191)
    place_m = np.zeros((len(depth_m), 3))
    if shape == "block":
        place_m[:, 2] = 20e-3 + 8e-3 - depth_m
    else:
        place_m[:, 0] = 20e-3 + 8e-3 - depth_m
    path = make_path(upright(place_m))
    options = BakeOptions(voxel_m=1e-3, spacing_m=1.5e-3)
    whole = bake_scene(static, ball, options)
    less = bake_scene(static, ball, replace(options, depth_max_m=3e-3))
    assert len(less.image) < min(most_bytes, len(whole.image))
    force_N, forces_N = (
        run_path(open_image(made.image, shape), path)["force_N"].astype(float)
        for made in (whole, less)
    )
    above = depth_m <= 3e-3
    assert np.abs(force_N[above]).max() > 2.0
    assert (forces_N[above] == force_N[above]).all()
    off_N = np.linalg.norm(forces_N - force_N, axis=1)
    print(
        f"{shape}: {len(whole.image)} -> {len(less.image)} bytes, off by {off_N.max():.3g} N deeper"
    )
    assert off_N.max() < off_max_N


def test_creases_of_a_machined_part_are_not_noise() -> None:
    part = trimesh.creation.box(extents=(20.0, 20.0, 20.0)).subdivide().subdivide().subdivide()
    from crease.bake.bake import noise_warning

    mesh = make_mesh(part.vertices, part.faces, 1e-3, source="part")
    assert noise_warning(make_surface(mesh, 30.0), 30.0) == []


@pytest.mark.slow
@pytest.mark.parametrize("most", [400, 60])
def test_kinds_of_cells_are_merged_until_they_fit(
    monkeypatch: pytest.MonkeyPatch, most: int
) -> None:
    """A noisy ball has thousands of kinds. Distances come from the samples and stay what they are."""
    ball = trimesh.creation.icosphere(4, radius=20.0)
    shake = np.random.default_rng(3).normal(0.0, 0.25, ball.vertices.shape)
    mesh = make_mesh(ball.vertices + shake, ball.faces, 1e-3, source="noisy")
    options = BakeOptions(voxel_m=4e-3, spacing_m=1e-3)
    free = bake_scene(mesh, mesh, options)
    for module in ("kinds", "voxmap"):
        monkeypatch.setattr(f"crease.bake.{module}.KINDS_MAX", most)
    merged = bake_scene(mesh, mesh, options)
    sections = read_sections(np.frombuffer(merged.image, np.uint8))
    kinds, cells = sections[int(lib.CR_SEC_KINDS)], sections[int(lib.CR_SEC_CELLS)]
    assert len(read_sections(np.frombuffer(free.image, np.uint8))[int(lib.CR_SEC_KINDS)]) > most
    assert len(kinds) <= most
    assert cells.view(np.uint16).max() < len(kinds)
    open_image(merged.image, "merged")
    assert merged.report["error_max_m"] == pytest.approx(free.report["error_max_m"], rel=0.5)


def test_a_brick_that_loses_planes_to_merging_has_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Those of its own facets and those of its neighbours' go together, or the image is none."""
    ball = trimesh.creation.icosphere(1, radius=20.0)
    kinds = Kinds(make_surface(make_mesh(ball.vertices, ball.faces, 1e-3, source="ball"), 30.0))
    flat = kinds.index(int(lib.CR_KIND_PLANAR), (kinds.planar(0),))
    bent = kinds.index(int(lib.CR_KIND_CURVED), (kinds.curved(0),))
    edge = kinds.index(int(lib.CR_KIND_CONVEX), (kinds.planar(0), kinds.planar(1)))
    monkeypatch.setattr(kinds, "merged", lambda _voxel_m: np.array([0, bent, bent, edge], np.int32))
    planes = BrickPlanes(
        np.array([flat, edge, flat], np.int32), np.array([edge, edge, 0], np.int32)
    )
    cells, left = _merged(kinds, np.array([flat, edge], np.int32), planes, 1e-3)
    assert cells.tolist() == [bent, edge]
    assert left.least.tolist() == [0, edge, 0]
    assert left.most.tolist() == [0, edge, 0]
