"""The wheel: built from its own source archive, installed where no checkout is, the same bits on every processor."""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import sys
import sysconfig
import tarfile
from collections.abc import Callable
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
from crease.base.native import CPU
from crease.base.version import VERSION

ROOT = Path(__file__).resolve().parents[2]
LEVELS = {"x86-64": "_native", "x86-64-v3": "_native_v3"}
pytestmark = pytest.mark.slow

Call = Callable[..., str]


@pytest.fixture(scope="module")
def wheel() -> Path:
    """What `make wheel` makes."""
    said = subprocess.run(["make", "-s", "-C", ROOT, "wheel"], capture_output=True, text=True, check=False)  # fmt: skip
    assert said.returncode == 0, said.stdout + said.stderr
    (made,) = (ROOT / "build/wheels").glob("*.whl")
    return made


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory, wheel: Path) -> Path:
    """An environment of its own with the wheel. What that needs of others is the tests' own, and pip checks it."""
    folder = tmp_path_factory.mktemp("env")
    subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    pip: list[str | Path] = [folder / "bin/python", "-m", "pip", "--disable-pip-version-check"]
    subprocess.run([*pip, "install", "--quiet", "--no-deps", "--no-index", wheel], check=True)
    (site,) = folder.glob("lib/python*/site-packages")
    (site / "others.pth").write_text(sysconfig.get_path("purelib") + "\n", encoding="utf-8")
    subprocess.run([*pip, "check"], check=True, stdout=subprocess.DEVNULL)
    return folder


@pytest.fixture(scope="module")
def call(place: Path, tmp_path_factory: pytest.TempPathFactory) -> Call:
    """A command of the environment, in a folder far from the checkout: call("crease", "info", ...)."""
    folder = tmp_path_factory.mktemp("user")

    def run(name: str, *words: object, level: str = "") -> str:
        env = {
            "PATH": "/usr/bin:/bin",
            "HOME": str(folder),
            **({"CREASE_CPU": level} if level else {}),
        }
        command = [str(place / "bin" / name), *(str(word) for word in words)]
        said = subprocess.run(
            command, capture_output=True, text=True, check=False, cwd=folder, env=env
        )
        assert said.returncode == 0, f"{command}\n{said.stdout}\n{said.stderr}"
        return said.stdout

    return run


def test_it_is_the_wheel_that_runs(place: Path, call: Call) -> None:
    text = "import crease, crease._sim as s, crease.base.native as n; print(crease.__file__, s.__file__, n.lib)"
    assert str(ROOT / "host") not in (said := call("python", "-c", text))
    assert said.startswith(str(place))
    assert call("crease", "--version") == f"crease {VERSION}\n"


def test_two_meshes_are_baked_replayed_plotted_and_viewed(
    call: Call, tmp_path: Path, block_stl: Path, ball_stl: Path, press_csv: Path
) -> None:
    scene, table = tmp_path / "scene.crs", tmp_path / "out.npz"
    call("crease", "bake", block_stl, ball_stl, "-o", scene, "--unit", "mm", "--spacing", "1.5mm")
    digests = set()
    for level in ["", *LEVELS] if CPU in LEVELS else [""]:
        call(
            "crease",
            "replay",
            scene,
            press_csv,
            "-o",
            table,
            "--damping",
            "2",
            "--force",
            level=level,
        )
        with np.load(table) as file:
            columns = {name: file[name] for name in file.files if name != "tick_ns"}
        assert columns["fz_N"].max() > 1.0
        digests.add(hashlib.sha256(b"".join(c.tobytes() for c in columns.values())).hexdigest())
    assert len(digests) == 1
    other = ("-o", tmp_path / "other.npz", "--response", "extent")
    call("crease", "replay", scene, press_csv, *other)
    call("crease", "plot", table, "-o", tmp_path / "out.png")
    call("crease", "view", table, "--scene", scene, "-o", tmp_path / "out.html")
    assert (tmp_path / "out.png").stat().st_size > 10_000
    assert "three" in (tmp_path / "out.html").read_text("utf-8")


def test_a_bake_is_the_same_to_the_bit_on_every_level(
    call: Call, tmp_path: Path, block_stl: Path, ball_stl: Path
) -> None:
    images = set()
    for level in LEVELS if CPU in LEVELS else [""]:
        scene = tmp_path / f"{level}.crs"
        options = ("-o", scene, "--unit", "mm", "--spacing", "2mm")
        call("crease", "bake", block_stl, ball_stl, *options, level=level)
        images.add(scene.read_bytes())
    assert len(images) == 1


def test_the_simulator_brings_its_own_ode(call: Call, place: Path) -> None:
    text = "import crease._sim; print(open('/proc/self/maps').read())"
    loaded = {
        line.split()[-1] for line in call("python", "-c", text).splitlines() if "libode" in line
    }
    assert len(loaded) == 1
    assert loaded.pop().startswith(str(place))


def wide(library: Path) -> int:
    """Instructions of a library that use registers wider than SSE's."""
    said = subprocess.run(["objdump", "-d", library], capture_output=True, text=True, check=True)
    return len(re.findall(r"%[yz]mm", said.stdout))


def test_the_baseline_runs_on_any_processor_and_the_other_is_worth_having(place: Path) -> None:
    (package,) = place.glob("lib/python*/site-packages/crease")
    count = {file.name.split(".")[0]: wide(file) for file in package.glob("*.so")}
    assert count["_native"] == count["_rivals"] == count["_sim"] == 0
    for name in ("_native_v3", "_rivals_v3"):
        assert (name in count) == (sysconfig.get_platform() == "linux-x86_64")
        assert count.get(name, 1001) > 1000


def test_a_level_that_is_not_there_is_said_in_one_line(place: Path) -> None:
    env = {**os.environ, "CREASE_CPU": "i386"}
    said = subprocess.run(
        [place / "bin/crease", "--version"], capture_output=True, text=True, check=False, env=env
    )
    assert (said.returncode, said.stdout) == (1, "")
    assert said.stderr.startswith("error: CREASE_CPU=i386: this machine and build have x86-64")
    assert said.stderr.count("\n") == 1


def test_it_says_whose_it_is(wheel: Path) -> None:
    with ZipFile(wheel) as packed:
        names = packed.namelist()
        (meta,) = (name for name in names if name.endswith(".dist-info/METADATA"))
        text = packed.read(meta).decode()
    wanted = [f"Version: {VERSION}", "License-Expression: MIT", "Author: the crease authors"]
    wanted += [f"License-File: {name}" for name in ("LICENSE", "THIRD_PARTY.md")]
    assert set(wanted) <= set(text.splitlines())
    assert "crease/py.typed" in names
    assert "manylinux" in wheel.name or sysconfig.get_platform() != "linux-x86_64"
    assert not [name for name in names if name.startswith(("tests/", "firmware/", "backend/"))]


def test_the_source_archive_names_nothing_outside(wheel: Path) -> None:
    (archive,) = wheel.parent.glob("*.tar.gz")
    with tarfile.open(archive) as packed:
        project = packed.extractfile(f"crease-{VERSION}/pyproject.toml")
        assert project is not None
        text = project.read().decode()
        names = packed.getnames()
    build = text.split("[tool.ruff]")[0]
    assert "../" not in build
    assert all(name.startswith(f"crease-{VERSION}/") for name in names)
    assert f"crease-{VERSION}/firmware/crease.h" in names
