"""The library as a Zephyr module, a PlatformIO library and a CMSIS-Pack: one list of sources, small projects outside.

Each project gets crease only through its manifest, and feels what Python feels, to the bit. Not to be had here are the
Zephyr tree and the platforms of PlatformIO: functions of Zephyr's CMake interface are stood in for below.
"""

from __future__ import annotations

import json
import re
import subprocess
import tarfile
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path

import cmsis_pack
import kconfiglib
import numpy as np
import numpy.typing as npt
import pytest
import yaml
from crease.base.version import VERSION
from crease.replay.trajectory import load_trajectory
from platformio import fs
from platformio.package.manifest.parser import ManifestParserFactory
from platformio.package.manifest.schema import ManifestSchema
from platformio.package.pack import PackagePacker
from test_install import PROGRAM, ROOT, call

FIRMWARE = ROOT / "firmware"
WARNINGS = ["-Wall", "-Wextra", "-Werror"]
FAST = ["-ffast-math", "-O2"]
"""What a careless project sets for all: the library's own flags come after it."""

# The functions of Zephyr's cmake/modules/extensions.cmake that the module calls, as they are documented.
STAND_IN = """cmake_minimum_required(VERSION 3.20)
project(outside LANGUAGES C)
include(config.cmake)
add_library(zephyr_interface INTERFACE)
function(zephyr_include_directories)
  target_include_directories(zephyr_interface INTERFACE ${ARGV})
endfunction()
function(zephyr_compile_definitions)
  target_compile_definitions(zephyr_interface INTERFACE ${ARGV})
endfunction()
macro(zephyr_library_named name)
  set(ZEPHYR_CURRENT_LIBRARY ${name})
  add_library(${name} STATIC "")
  target_link_libraries(${name} PUBLIC zephyr_interface)
endmacro()
function(zephyr_library_sources)
  target_sources(${ZEPHYR_CURRENT_LIBRARY} PRIVATE ${ARGV})
endfunction()
function(zephyr_library_sources_ifdef feature)
  if(${feature})
    zephyr_library_sources(${ARGN})
  endif()
endfunction()
function(zephyr_library_compile_options)
  target_compile_options(${ZEPHYR_CURRENT_LIBRARY} PRIVATE ${ARGV})
endfunction()
add_compile_options(-Wall -Wextra -Werror)
add_subdirectory(${MODULE_CMAKE} crease)
add_executable(app main.c)
target_link_libraries(app PRIVATE crease zephyr_interface m)
"""

# What Zephyr's own Kconfig tree would have around the module's file.
KCONFIG = """config CPU_HAS_FPU
	bool
	default y

config FPU
	bool

source "{kconfig}"
"""


@pytest.fixture(scope="module")
def felt(scene_crs: Path, press_csv: Path) -> bytes:
    """Force and torque of each tick in Python, (n, 6) float32 as the program writes them."""
    from crease.base.scene import open_scene
    from crease.replay.replay import run_path

    rows = run_path(open_scene(scene_crs), load_trajectory(press_csv))
    both: npt.NDArray[np.float32] = np.hstack([rows["force_N"], rows["torque_Nm"]])
    assert np.abs(both).max() > 1.0
    return both.astype("<f4").tobytes()


@pytest.fixture(scope="module")
def poses(tmp_path_factory: pytest.TempPathFactory, press_csv: Path) -> Path:
    """The path as the program reads it."""
    file = tmp_path_factory.mktemp("poses") / "poses.bin"
    file.write_bytes(load_trajectory(press_csv).rows[:, 1:].astype("<f4").tobytes())
    return file


def check(program: Path, scene: Path, poses: Path, felt: bytes) -> None:
    """The program feels what Python feels."""
    said = subprocess.run([program, scene, poses], capture_output=True, check=True)
    assert said.stdout == felt


def needed_flags() -> set[str]:
    """Options that keep the bits, as `make` has them."""
    show = ["make", "-s", "-C", str(ROOT), "--eval", "show: ; @echo $(C_STD)", "show"]
    return {flag for flag in call(*show).split() if flag.startswith("-f")}


def library() -> set[str]:
    """Sources of the library as `make` has them."""
    show = ["make", "-s", "-C", str(ROOT), "--eval", "show: ; @echo $(FIRMWARE_C)", "show"]
    return {name.removeprefix("firmware/") for name in call(*show).split()}


# ---------------------------------------------------------------------------------------------------------- Zephyr


def zephyr_settings(folder: Path, conf: str) -> dict[str, str]:
    """CONFIG_* of a project's prj.conf, by the Kconfig reader that Zephyr uses; config.cmake as Zephyr imports it."""
    module = yaml.safe_load((FIRMWARE / "zephyr/module.yml").read_text("utf-8"))
    (folder / "Kconfig").write_text(KCONFIG.format(kconfig=FIRMWARE / module["build"]["kconfig"]))
    (folder / "prj.conf").write_text(conf, encoding="ascii")
    kconf = kconfiglib.Kconfig(str(folder / "Kconfig"), warn_to_stderr=False)
    kconf.load_config(str(folder / "prj.conf"))
    assert kconf.warnings == []
    values = {
        f"CONFIG_{symbol.name}": symbol.str_value
        for symbol in kconf.unique_defined_syms
        if symbol.str_value not in ("n", "")
    }
    lines = [f"set({name} {value})" for name, value in values.items()]
    (folder / "config.cmake").write_text("\n".join(lines) + "\n", encoding="ascii")
    return values


def build_zephyr(folder: Path, conf: str, program: str = PROGRAM) -> Path:
    """A Zephyr-like application that knows crease as a module only: its program."""
    zephyr_settings(folder, conf)
    module = yaml.safe_load((FIRMWARE / "zephyr/module.yml").read_text("utf-8"))
    (folder / "CMakeLists.txt").write_text(STAND_IN, encoding="ascii")
    (folder / "main.c").write_text(program, encoding="ascii")
    call(
        "cmake",
        "-S",
        folder,
        "-B",
        folder / "b",
        "-DCMAKE_C_FLAGS=-ffast-math -O2",
        f"-DMODULE_CMAKE={FIRMWARE / module['build']['cmake']}",
        "-DCMAKE_EXPORT_COMPILE_COMMANDS=1",
    )
    call("cmake", "--build", folder / "b")
    return folder / "b/app"


@pytest.mark.slow
def test_a_zephyr_application_feels_what_python_feels(
    tmp_path: Path, scene_crs: Path, poses: Path, felt: bytes
) -> None:
    """Even where the application asks for fast mathematics."""
    check(build_zephyr(tmp_path, "CONFIG_CREASE=y\n"), scene_crs, poses, felt)
    commands = json.loads((tmp_path / "b/compile_commands.json").read_text("utf-8"))
    built = {
        str(Path(c["file"]).resolve().relative_to(FIRMWARE))
        for c in commands
        if "/firmware/" in c["file"]
    }
    assert built == library()


@pytest.mark.slow
def test_settings_of_zephyr_reach_library_and_application(tmp_path: Path) -> None:
    checked = '_Static_assert(CR_AREAS_MAX == 4 && CR_CLUSTERS_MAX == 64, "");\nint main'
    conf = "CONFIG_CREASE=y\n# CONFIG_CREASE_SERVO is not set\n# CONFIG_CREASE_COUPLE is not set\n"
    conf += "CONFIG_CREASE_AREAS_MAX=4\nCONFIG_CREASE_CLUSTERS_MAX=64\n"
    build_zephyr(tmp_path, conf, PROGRAM.replace("int main", checked))
    commands = (tmp_path / "b/compile_commands.json").read_text("utf-8")
    assert "/servo/" not in commands
    assert "couple/descend.c" not in commands
    assert commands.count("CR_AREAS_MAX=4") == commands.count('"command"')


def test_settings_of_zephyr_have_the_defaults_of_the_header(tmp_path: Path) -> None:
    values = zephyr_settings(tmp_path, "CONFIG_CREASE=y\n")
    text = (FIRMWARE / "config.h").read_text("utf-8")
    kconfig = (FIRMWARE / "zephyr/Kconfig").read_text("utf-8")
    names = re.findall(r"^config CREASE_(\w+_MAX)$", kconfig, re.MULTILINE)
    assert len(names) == 4
    for name in names:
        said = re.search(rf"#define CR_{name} (\d+)", text)
        least = re.search(rf"#if CR_{name} < (\d+) \|\| CR_{name} > (\d+)", text)
        assert said is not None
        assert least is not None
        assert values[f"CONFIG_CREASE_{name}"] == said[1]
        assert f"range {least[1]} {least[2]}" in kconfig.split(f"config CREASE_{name}\n")[1][:120]


# ------------------------------------------------------------------------------------------------------ PlatformIO


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The library as PlatformIO's own packer packs it, unpacked. Its list of licences is on the net: ours is MIT."""
    folder = tmp_path_factory.mktemp("platformio")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            ManifestSchema,
            "load_spdx_licenses",
            staticmethod(lambda: {"licenses": [{"licenseId": "MIT"}]}),
        )
        made = PackagePacker(str(FIRMWARE)).pack(str(folder / "crease.tar.gz"))
    with tarfile.open(made) as tar:
        tar.extractall(folder / "crease", filter="data")
    return folder / "crease"


@pytest.mark.slow
def test_a_platformio_project_feels_what_python_feels(
    unpacked: Path, tmp_path: Path, scene_crs: Path, poses: Path, felt: bytes
) -> None:
    """Compiled as the manifest says: its filter, its flags after the project's, its folder of headers."""
    manifest = ManifestParserFactory.new_from_file(str(unpacked / "library.json")).as_dict()
    build = manifest["build"]
    sources = fs.match_src_files(str(unpacked / build["srcDir"]), build["srcFilter"])
    assert set(sources) == library()
    (tmp_path / "main.c").write_text(PROGRAM, encoding="ascii")
    include = f"-I{unpacked / build['includeDir']}"
    for name in sources:
        made = tmp_path / (Path(name).stem + ".o")
        call("gcc", *WARNINGS, *FAST, *build["flags"], include, "-c", unpacked / name, "-o", made)
    call(
        "gcc",
        *WARNINGS,
        include,
        "main.c",
        *tmp_path.glob("*.o"),
        "-lm",
        "-o",
        "main",
        cwd=tmp_path,
    )
    check(tmp_path / "main", scene_crs, poses, felt)


def test_the_manifest_of_platformio_has_the_version_of_the_header(unpacked: Path) -> None:
    manifest = json.loads((unpacked / "library.json").read_text("utf-8"))
    assert manifest["version"] == VERSION
    assert all((unpacked / name).is_file() for name in manifest["headers"])


# ------------------------------------------------------------------------------------------------------ CMSIS-Pack


@pytest.fixture(scope="module")
def pack(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The unpacked pack."""
    folder = tmp_path_factory.mktemp("pack")
    assert cmsis_pack.main([str(folder)]) == 0
    with zipfile.ZipFile(folder / f"crease.crease.{VERSION}.pack") as file:
        file.extractall(folder / "pack")
    return folder / "pack"


def component_files(pack: Path, category: str) -> list[str]:
    """What the components of the pack list under a category."""
    tree = ET.parse(pack / "crease.crease.pdsc")
    return [f.attrib["name"] for f in tree.iterfind(f".//file[@category='{category}']")]


@pytest.mark.slow
def test_a_project_with_the_pack_feels_what_python_feels(
    pack: Path, tmp_path: Path, scene_crs: Path, poses: Path, felt: bytes
) -> None:
    (tmp_path / "main.c").write_text(PROGRAM, encoding="ascii")
    includes = [f"-I{pack / name}" for name in component_files(pack, "include")]
    sources = [pack / name for name in component_files(pack, "source")]
    flags = ["-std=c11", "-O2", "-ffp-contract=off", "-fno-math-errno"]
    call(
        "gcc",
        *WARNINGS,
        *flags,
        *includes,
        tmp_path / "main.c",
        *sources,
        "-lm",
        "-o",
        tmp_path / "main",
    )
    check(tmp_path / "main", scene_crs, poses, felt)


def test_the_pack_lists_all_sources_and_has_all_that_it_lists(pack: Path) -> None:
    sources = component_files(pack, "source")
    assert {name.removeprefix("firmware/") for name in sources} == library()
    assert len(sources) == len(set(sources))
    for category in ("source", "header", "include", "doc"):
        named = component_files(pack, category)
        assert named
        assert [name for name in named if not (pack / name).exists()] == []
    assert (pack / "LICENSE").read_bytes() == (ROOT / "LICENSE").read_bytes()


def test_the_description_of_the_pack_is_whole(pack: Path) -> None:
    """The elements that PACK.xsd asks for, in its order; conditions that are there. The schema is not here."""
    root = ET.parse(pack / "crease.crease.pdsc").getroot()
    order = [child.tag for child in root]
    assert order == [
        "vendor",
        "name",
        "description",
        "url",
        "license",
        "releases",
        "keywords",
        "conditions",
        "components",
    ]
    assert root.find("releases/release").attrib["version"] == VERSION  # type: ignore[union-attr]
    assert (pack / (root.findtext("license") or "-")).is_file()
    conditions = {c.attrib["id"] for c in root.iterfind("conditions/condition")}
    components = list(root.iterfind("components/component"))
    assert {c.attrib["condition"] for c in components} <= conditions
    assert [c.attrib["Csub"] for c in components] == ["Contact", "Servo", "Couple"]
    assert all(c.attrib["Cversion"] == VERSION for c in components)


def test_every_build_system_sets_the_options_that_keep_the_bits_or_asks_for_them(
    pack: Path,
) -> None:
    """A pack cannot carry options: it tells the project, wherever a component is chosen."""
    needed = needed_flags()
    assert needed == {"-ffp-contract=off", "-fno-math-errno"}
    for place in ("zephyr/CMakeLists.txt", "library.json"):
        text = (FIRMWARE / place).read_text("utf-8")
        assert [flag for flag in needed if flag not in text] == []
    root = ET.parse(pack / "crease.crease.pdsc").getroot()
    told = [
        root.findtext("description"),
        *(d.text for d in root.iterfind(".//component/description")),
    ]
    assert len(told) == 4
    for words in told:
        assert [flag for flag in needed if flag not in (words or "")] == []
    (row,) = (
        line
        for line in (ROOT / "README.md").read_text("utf-8").splitlines()
        if line.startswith("| CMSIS-Pack")
    )
    assert [flag for flag in needed if flag not in row] == []


def test_no_manifest_names_a_source_by_hand() -> None:
    """A list that is written down falls behind: they take what lies in the rooms."""
    places = ["zephyr/CMakeLists.txt", "library.json", "package/crease.pdsc.in"]
    names = [Path(name).name for name in library()]
    for place in places:
        text = (FIRMWARE / place).read_text("utf-8")
        assert [name for name in names if f"/{name}" in text] == []


def test_a_folder_is_asked_for_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert cmsis_pack.main([]) == 2
    assert capsys.readouterr().err == "error: cmsis_pack.py FOLDER\n"
