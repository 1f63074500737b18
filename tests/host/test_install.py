"""`make install`: programs outside the checkout get crease by pkg-config and CMake, and feel what Python feels."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import manuals
import numpy as np
import numpy.typing as npt
import pytest
from crease.base.scene import open_scene
from crease.base.version import VERSION
from crease.replay.replay import run_path
from crease.replay.trajectory import load_trajectory

ROOT = Path(__file__).resolve().parents[2]
MAKE = ["make", "--silent", "-C", str(ROOT)]

PROGRAM = r"""
#include <crease.h>
#include <stdio.h>
#include <stdlib.h>

static void *load(const char *path, size_t *size) {
    FILE *file = fopen(path, "rb");
    if (file == NULL) return NULL;
    fseek(file, 0, SEEK_END);
    *size = (size_t)ftell(file);
    rewind(file);
    void *bytes = aligned_alloc(64, (*size + 63) / 64 * 64);
    if (bytes != NULL && fread(bytes, 1, *size, file) != *size) return NULL;
    fclose(file);
    return bytes;
}

/* SCENE.crs POSES: float32 rows of x y z w i j k; force and torque of each tick as float32 on standard output. */
int main(int argc, char **argv) {
    size_t image_bytes = 0, pose_bytes = 0;
    if (argc != 3 || cr_version() != CR_VERSION) return 2;
    const void *image = load(argv[1], &image_bytes);
    const cr_pose *poses = (const cr_pose *)load(argv[2], &pose_bytes);
    cr_scene scene;
    const cr_config config = cr_config_default();
    cr_world *world;
    cr_err err = cr_scene_open(&scene, image, image_bytes);
    if (err == CR_OK) {
        const size_t size = (cr_world_size(&scene, &config) + 63) / 64 * 64;
        err = cr_world_init(&world, aligned_alloc(64, size), size, &scene, &config);
    }
    if (err != CR_OK) {
        fprintf(stderr, "%s\n", cr_err_text(err));
        return 1;
    }
    for (size_t i = 0; i < pose_bytes / sizeof *poses; i++) {
        static cr_output out;
        cr_tick(world, &poses[i], 1e-3f, &out);
        fwrite(&out.force_world_N, sizeof out.force_world_N, 1, stdout);
        fwrite(&out.torque_world_Nm, sizeof out.torque_world_Nm, 1, stdout);
    }
    return 0;
}
"""

PROJECT = """cmake_minimum_required(VERSION 3.20)
project(outside LANGUAGES C CXX)
find_package(crease {version} REQUIRED)
add_executable(shared main.c)
target_link_libraries(shared PRIVATE crease::crease)
add_executable(static main.c)
target_link_libraries(static PRIVATE crease::static)
add_executable(cpp main.cpp)
target_link_libraries(cpp PRIVATE crease::crease)
"""


def call(*words: object, **more: object) -> str:
    """Output of a command that must do.   Errors: AssertionError with what it said."""
    said = subprocess.run(
        [str(w) for w in words], capture_output=True, text=True, check=False, **more
    )  # type: ignore[call-overload]
    assert said.returncode == 0, f"{words}\n{said.stdout}\n{said.stderr}"
    return str(said.stdout)


@pytest.fixture(scope="module")
def prefix(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where crease was installed to."""
    folder = tmp_path_factory.mktemp("install") / "usr"
    call(*MAKE, "install", f"PREFIX={folder}")
    return folder


@pytest.fixture(scope="module")
def outside(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project that knows nothing of the checkout."""
    folder = tmp_path_factory.mktemp("outside")
    (folder / "main.c").write_text(PROGRAM, encoding="ascii")
    (folder / "main.cpp").write_text(PROGRAM, encoding="ascii")
    version = ".".join(VERSION.split(".")[:2])
    (folder / "CMakeLists.txt").write_text(PROJECT.format(version=version), encoding="ascii")
    return folder


@pytest.fixture(scope="module")
def felt(scene_crs: Path, press_csv: Path) -> npt.NDArray[np.float32]:
    """Force and torque of each tick in Python, (n, 6)."""
    rows = run_path(open_scene(scene_crs), load_trajectory(press_csv))
    assert np.linalg.norm(rows["force_N"], axis=1).max() > 1.0
    return np.hstack([rows["force_N"], rows["torque_Nm"]])


@pytest.fixture(scope="module")
def poses(outside: Path, press_csv: Path) -> Path:
    """The path as the program reads it."""
    file = outside / "poses.bin"
    file.write_bytes(load_trajectory(press_csv).rows[:, 1:].astype("<f4").tobytes())
    return file


def check(program: Path, scene: Path, poses: Path, felt: npt.NDArray[np.float32], library: Path) -> None:  # fmt: skip
    """The program's forces are Python's to the bit. It knows where the shared library is from the environment alone."""
    said = subprocess.run(
        [program, scene, poses], capture_output=True, check=True, env={"LD_LIBRARY_PATH": str(library)}
    )  # fmt: skip
    assert said.stdout == felt.astype("<f4").tobytes()


def pkg_config(prefix: Path, *options: str) -> list[str]:
    """What pkg-config says of crease."""
    path = {"PKG_CONFIG_PATH": str(prefix / "lib/pkgconfig"), "PATH": "/usr/bin:/bin"}
    return call("pkg-config", *options, "crease", env=path).split()


@pytest.mark.slow
@pytest.mark.parametrize("how", ["shared", "static"])
def test_a_program_finds_it_by_pkg_config(
    how: str, prefix: Path, outside: Path, scene_crs: Path, poses: Path, felt: npt.NDArray[np.float32]
) -> None:  # fmt: skip
    assert pkg_config(prefix, "--modversion") == [VERSION]
    flags = pkg_config(prefix, "--cflags", "--libs", *(["--static"] if how == "static" else []))
    if how == "static":
        flags = [prefix / "lib/libcrease.a" if f == "-lcrease" else f for f in flags]  # type: ignore[misc]
    call("gcc", "-Wall", "-Wextra", "-Werror", "main.c", *flags, "-o", how, cwd=outside)
    linked = call("readelf", "-d", outside / how)
    soname = ".".join(VERSION.split(".")[:2]) if VERSION.startswith("0.") else VERSION.split(".")[0]
    assert (f"[libcrease.so.{soname}]" in linked) == (how == "shared")
    check(outside / how, scene_crs, poses, felt, prefix / "lib")


@pytest.fixture(scope="module")
def by_cmake(prefix: Path, outside: Path) -> Path:
    """The project built by CMake, with crease moved to another place after it was installed."""
    moved = prefix.parent / "moved"
    call("cp", "-a", prefix, moved)
    call("cmake", "-S", outside, "-B", outside / "build", f"-DCMAKE_PREFIX_PATH={moved}")
    call("cmake", "--build", outside / "build")
    return outside / "build"


@pytest.mark.slow
@pytest.mark.parametrize("target", ["shared", "static", "cpp"])
def test_a_program_finds_it_by_cmake(
    target: str, by_cmake: Path, prefix: Path, scene_crs: Path, poses: Path, felt: npt.NDArray[np.float32]
) -> None:  # fmt: skip
    check(by_cmake / target, scene_crs, poses, felt, prefix / "lib")


@pytest.mark.parametrize("asked", ["99.0", "0.1"])
def test_cmake_refuses_another_version(asked: str, prefix: Path, tmp_path: Path) -> None:
    (tmp_path / "CMakeLists.txt").write_text(PROJECT.format(version=asked), encoding="ascii")
    command: list[str | Path] = [
        "cmake",
        "-S",
        tmp_path,
        "-B",
        tmp_path / "b",
        f"-DCMAKE_PREFIX_PATH={prefix}",
    ]
    said = subprocess.run(command, capture_output=True, text=True, check=False)
    assert said.returncode != 0
    assert "compatible" in said.stderr


def test_the_library_exports_what_the_headers_declare_and_nothing_else(prefix: Path) -> None:
    headers = (ROOT / "build/install/exports").read_text("ascii").split()
    table = call("nm", "-D", "--defined-only", prefix / "lib/libcrease.so")
    assert re.findall(r" T (\w+)", table) == sorted(headers)
    assert {"cr_tick", "cr_scene_open", "cr_version", "cr_servo_tick"} <= set(headers)
    needed = re.findall(r"NEEDED.*\[(.*)\]", call("readelf", "-d", prefix / "lib/libcrease.so"))
    assert set(needed) <= {"libm.so.6", "libc.so.6"}


def test_destdir_is_only_where_files_are_put(prefix: Path, tmp_path: Path) -> None:
    call(*MAKE, "install", "PREFIX=/opt/crease", f"DESTDIR={tmp_path}")
    packed, there = (
        tmp_path / "opt/crease",
        sorted(p.relative_to(prefix) for p in prefix.rglob("*")),
    )
    assert sorted(p.relative_to(packed) for p in packed.rglob("*")) == there
    texts = [p for p in packed.rglob("*") if p.suffix in (".pc", ".cmake", ".1", ".3", ".8")]
    assert len(texts) == 6
    for text in texts:
        said = text.read_text("utf-8")
        assert str(tmp_path) not in said
        assert "@" not in said.replace("@VERSION_", "")
    assert "prefix=/opt/crease\n" in (packed / "lib/pkgconfig/crease.pc").read_text("utf-8")
    call(*MAKE, "uninstall", "PREFIX=/opt/crease", f"DESTDIR={tmp_path}")
    assert [p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*")] == ["opt"]


def test_uninstall_leaves_the_folders_of_others(tmp_path: Path) -> None:
    for prefix in ("/opt/crease", "/usr/local"):
        call(*MAKE, "install", f"PREFIX={prefix}", f"DESTDIR={tmp_path}")
        (tmp_path / "opt/crease/bin/other").touch()
        call(*MAKE, "uninstall", f"PREFIX={prefix}", f"DESTDIR={tmp_path}")
    assert {p.name for p in (tmp_path / "opt/crease").rglob("*")} == {"bin", "other"}
    assert (tmp_path / "usr/local/bin").is_dir()


def test_a_relative_prefix_is_refused_in_one_line(tmp_path: Path) -> None:
    said = subprocess.run(
        [*MAKE, "install", "PREFIX=here", f"DESTDIR={tmp_path}/"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert said.returncode != 0
    assert said.stderr.splitlines()[0].startswith("error: PREFIX=here: is not an absolute path")
    assert list(tmp_path.iterdir()) == []


def test_the_daemon_says_the_version_of_the_library(prefix: Path) -> None:
    assert call(prefix / "bin/creased", "--version") == f"creased {VERSION}\n"


def test_the_example_is_built_as_it_says_and_pushes(
    prefix: Path, tmp_path: Path, scene_crs: Path
) -> None:
    """The ball of radius 10 mm, its middle at last 8 mm above the block: 2 N upwards at 1000 N/m."""
    source = prefix / "share/crease/example.c"
    flags = pkg_config(prefix, "--cflags", "--libs")
    call("cc", "-Wall", "-Wextra", "-Werror", source, *flags, "-o", "example", cwd=tmp_path)
    found = {"LD_LIBRARY_PATH": str(prefix / "lib")}
    lines = call(tmp_path / "example", scene_crs, 0, 0, 0.008, env=found).splitlines()
    assert lines[0] == " 0 ms: 0.000 0.000 0.000 N, 0 areas"
    assert float(lines[-1].split()[4]) == pytest.approx(2.0, abs=0.05)
    refused = subprocess.run(
        [tmp_path / "example", source, "0", "0", "0"],
        capture_output=True,
        text=True,
        check=False,
        env=found,
    )
    assert refused.returncode == 1
    assert refused.stderr == f"error: {source}: not a crease scene image\n"


def test_manuals_are_what_the_commands_say_of_themselves(prefix: Path, tmp_path: Path) -> None:
    assert manuals.main([str(prefix / "bin/creased"), str(tmp_path)]) == 0
    for name in ("crease.1.in", "creased.8.in"):
        there = (ROOT / "firmware/package/man" / name).read_text("utf-8")
        assert there == (tmp_path / name).read_text("utf-8"), "run `make manuals`"


@pytest.mark.parametrize("page", ["man1/crease.1", "man3/crease.3", "man8/creased.8"])
def test_manuals_can_be_set(page: str, prefix: Path) -> None:
    text = (prefix / "share/man" / page).read_text("utf-8")
    said = subprocess.run(
        ["groff", "-man", "-ww", "-Tutf8"],
        input=text.replace(str(prefix), "/usr/local"),  # lines are as long as there
        capture_output=True,
        text=True,
        check=True,
    )
    assert said.stderr == ""
    assert f"crease {VERSION}" in said.stdout
