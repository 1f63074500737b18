"""Every verb of the command line: exit status, the one line of an error, reports, and whole outputs."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import trimesh
from crease import __version__
from crease.base.native import lib
from crease.base.progress import Progress
from crease.mesh.mesh import load_mesh
from crease.verbs import info
from crease.verbs.bake import unit_warning
from host_tools import Run, Said


def assert_error(said: Said, *parts: str) -> None:
    """Status 1 and one line `error: ...` with these parts."""
    lines = [line for line in said.err.splitlines() if not line.startswith("warning: ")]
    assert said.status == 1
    assert len(lines) == 1
    assert lines[0].startswith("error: ")
    for part in parts:
        assert part in lines[0]


def test_version_is_that_of_the_firmware(crease: Run) -> None:
    said = crease("--version")
    assert (said.status, said.out) == (0, f"crease {__version__}\n")
    parts = (lib.CR_VERSION_MAJOR, lib.CR_VERSION_MINOR, lib.CR_VERSION_PATCH)
    assert ".".join(map(str, parts)) == __version__


@pytest.mark.slow
def test_module_runs_as_the_command() -> None:
    result = subprocess.run(
        [sys.executable, "-m", "crease", "--version"], capture_output=True, text=True, check=True
    )
    assert result.stdout == f"crease {__version__}\n"


@pytest.mark.parametrize("verb", ["check", "bake", "info", "replay", "plot"])
def test_help_of_every_verb(crease: Run, verb: str) -> None:
    said = crease(verb, "--help")
    assert said.status == 0
    assert said.out.startswith(f"usage: crease {verb}")


@pytest.mark.parametrize(
    "line",
    [
        "",
        "fly",
        "bake",
        "bake a.stl b.stl -o c.crs",
        "bake a.stl b.stl -o c.crs --unit parsec",
        "bake a.stl b.stl -o c.crs --unit mm --voxel -2mm",
        "bake a.stl b.stl -o c.crs --unit mm --crease-angle 190",
        "replay a.crs b.csv",
        "replay a.crs b.csv -o c.csv --response magic",
        "replay a.crs b.csv -o c.csv --stiffness nan",
        "replay a.crs b.csv -o c.csv --damping x",
        "replay a.crs b.csv -o c.csv --lookups 31",
        "replay a.crs b.csv -o c.csv --lookups 64.5",
        "plot -o x.png",
        "info",
    ],
)
def test_wrong_command_line_exits_2(crease: Run, line: str) -> None:
    said = crease(*line.split())
    assert said.status == 2
    verb = " ".join(line.split()[:1]) if line.split()[:1] != ["fly"] else ""
    assert re.fullmatch(rf"error: .*; see `{f'crease {verb}'.strip()} --help`\n", said.err)


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("bake a.stl", "TOOL, -o, --unit are missing"),
        ("check a.stl", "--unit is missing"),
        ("fly", "there is no verb 'fly'; the verbs are check, bake, info,"),
        ("info a.crs --devise x", "there is no option --devise, perhaps --device"),
        ("info a.crs b.crs", "'b.crs' is one argument too many"),
        ("replay a.crs b.csv -o c.csv --stiffness=-3", "--stiffness: -3 is not in 0..1e+06"),
        ("experiment al -o D", "NAME: 'al' is not known; use penetration, timing, "),
        ("replay a.crs b.csv -o c.csv --friction 1", "--friction is of a held tool; give --couple"),
    ],
)
def test_what_is_wrong_with_a_command_line_is_one_line_with_the_mend(
    crease: Run, line: str, text: str
) -> None:
    said = crease(*line.split())
    assert (said.status, said.out) == (2, "")
    assert said.err.startswith(f"error: {text}")
    assert said.err.count("\n") == 1


@pytest.mark.slow
def test_bake_reports_for_people(
    folder: Path, block_stl: Path, ball_stl: Path, crease: Run
) -> None:
    said = crease("bake", block_stl, ball_stl, "-o", folder / "people.crs", "--unit", "mm")
    assert said.status == 0
    for word in (
        "scene",
        "triangles",
        "12 static, 5,120 tool",
        "voxel",
        "samples",
        "distance error",
        "time",
    ):
        assert word in said.out


@pytest.mark.slow
def test_bake_reports_for_programs(
    folder: Path, block_stl: Path, ball_stl: Path, crease: Run
) -> None:
    args = (
        "--unit",
        "mm",
        "--voxel",
        "3mm",
        "--spacing",
        "2mm",
        "--tolerance",
        "0.2mm",
        "--crease-angle",
        "40",
    )
    said = crease("bake", block_stl, ball_stl, "-o", folder / "json.crs", *args, "--json")
    report = said.json
    assert said.status == 0
    assert report["voxmap"]["voxel_m"] == pytest.approx(3e-3)
    assert report["tool"]["spacing_m"] == pytest.approx(2e-3)
    assert report["static"]["crease_angle_deg"] == pytest.approx(40.0)
    assert report["static"]["convex_edges"] == 12
    assert report["image_bytes"] == (folder / "json.crs").stat().st_size
    assert report["warnings"] == []


@pytest.mark.slow
def test_same_meshes_bake_to_the_same_bytes(
    folder: Path, block_stl: Path, ball_stl: Path, scene_crs: Path, crease: Run
) -> None:
    again = folder / "again.crs"
    crease("bake", block_stl, ball_stl, "-o", again, "--unit", "mm", "--spacing", "1.5mm")
    assert again.read_bytes() == scene_crs.read_bytes()


@pytest.mark.slow
def test_tool_may_have_a_unit_of_its_own(folder: Path, block_stl: Path, crease: Run) -> None:
    tool = folder / "ball_cm.stl"
    trimesh.creation.icosphere(subdivisions=3, radius=1.0).export(tool)
    args = ("--unit", "mm", "--tool-unit", "cm", "--json")
    report = crease("bake", block_stl, tool, "-o", folder / "cm.crs", *args).json
    assert report["tool"]["max_m"] == pytest.approx([0.01] * 3, rel=1e-3)
    assert report["static"]["max_m"] == pytest.approx([0.04, 0.04, 0.0])


@pytest.mark.slow
def test_bake_warns_of_a_tool_in_another_unit(
    folder: Path, block_stl: Path, ball_stl: Path, crease: Run
) -> None:
    sizes = ("--unit", "mm", "--tool-unit", "in", "--voxel", "8mm", "--spacing", "80mm")
    said = crease("bake", block_stl, ball_stl, *sizes, "-o", folder / "units.crs", "--json")
    assert said.status == 0
    (text, *_) = said.json["warnings"]
    assert text == (
        f"{ball_stl}: the tool is 508 mm long, 6 times as long as the mock-up, 80 mm; if that is wrong, give its unit "
        "with --tool-unit, the mock-up's with --unit"
    )
    assert said.err.startswith(f"warning: {text}\n")


@pytest.mark.parametrize(
    ("static_m", "tool_m", "told"),
    [
        (1e-3, 1e-3, ""),
        (1e-3, 1e-2, ""),
        (1e-3, 2.1e-2, "the tool is 420 mm long, 5 times as long as the mock-up, 80 mm; "),
        (2.4e-2, 1e-3, ""),
        (2.6e-2, 1e-3, "the tool is 20 mm long, 104 times as short as the mock-up, 2.08 m; "),
    ],
)
def test_a_tool_is_warned_of_from_5_times_to_a_hundredth_of_the_mock_up(
    block_stl: Path, ball_stl: Path, static_m: float, tool_m: float, told: str
) -> None:
    lines = unit_warning(load_mesh(block_stl, static_m), load_mesh(ball_stl, tool_m))
    assert [told in line for line in lines] == [True] * bool(told)


@pytest.mark.slow
def test_bake_warns_of_a_mend_and_goes_on(folder: Path, ball_stl: Path, crease: Run) -> None:
    box = trimesh.creation.box(extents=[80, 80, 40])
    box.invert()
    box.export(folder / "inverted.stl")
    said = crease(
        "bake", folder / "inverted.stl", ball_stl, "-o", folder / "inv.crs", "--unit", "mm"
    )
    assert said.status == 0
    assert said.err == f"warning: {folder / 'inverted.stl'}: was inside out: turned 12 triangles\n"


def test_bake_refuses_an_open_mesh(folder: Path, ball_stl: Path, crease: Run) -> None:
    """A dish: its opening is half of its own surface."""
    box = trimesh.creation.box(extents=[80, 80, 20])
    box.update_faces(box.face_normals[:, 2] < 0.5)
    box.export(folder / "open.stl")
    said = crease("bake", folder / "open.stl", ball_stl, "-o", folder / "open.crs", "--unit", "mm")
    assert_error(
        said, "open.stl: is open and encloses nothing: 4 edges", "--sheet 1mm, or close it"
    )
    assert not (folder / "open.crs").exists()


@pytest.mark.slow
def test_bake_closes_an_open_mesh_or_strictly_refuses_it(
    folder: Path, ball_stl: Path, crease: Run
) -> None:
    box = trimesh.creation.box(extents=[80, 80, 40])
    box.update_faces(box.face_normals[:, 2] < 0.5)
    box.export(folder / "deep.stl")
    line = ("bake", folder / "deep.stl", ball_stl, "-o", folder / "deep.crs", "--unit", "mm")
    said = crease(*line, "--strict")
    assert_error(said, "deep.stl: closed 1 opening", "near (0, 0, 20) mm", "--strict")
    assert not (folder / "deep.crs").exists()
    said = crease(*line, "--voxel", "4mm", "--spacing", "3mm")
    assert said.status == 0
    assert "warning:" in said.err
    assert "closed 1 opening, 33 % of the surface" in said.err


def test_bake_refuses_a_wrong_unit_with_the_likely_one(
    folder: Path, block_stl: Path, ball_stl: Path, crease: Run
) -> None:
    said = crease("bake", block_stl, ball_stl, "-o", folder / "unit.crs", "--unit", "m")
    assert_error(said, "120 m across", "try --unit mm")


def test_output_that_exists_needs_force(
    folder: Path, block_stl: Path, ball_stl: Path, press_csv: Path, scene_crs: Path, crease: Run
) -> None:
    out = folder / "kept.csv"
    out.write_text("precious")
    assert_error(crease("replay", scene_crs, press_csv, "-o", out), "exists already", "--force")
    assert out.read_text() == "precious"
    assert crease("replay", scene_crs, press_csv, "-o", out, "--force").status == 0
    assert out.read_text().startswith("t_s,")
    said = crease("bake", block_stl, ball_stl, "-o", scene_crs, "--unit", "mm")
    assert_error(said, "exists already")


def test_output_of_another_suffix_is_refused(
    folder: Path,
    block_stl: Path,
    ball_stl: Path,
    press_csv: Path,
    scene_crs: Path,
    press_out: Path,
    crease: Run,
) -> None:
    assert_error(
        crease("bake", block_stl, ball_stl, "-o", folder / "x.stl", "--unit", "mm"), ".crs"
    )
    assert_error(crease("replay", scene_crs, press_csv, "-o", folder / "x.xls"), ".csv, .npz")
    assert_error(crease("plot", press_out, "-o", folder / "x.gif"), ".png, .svg, .pdf")


def test_output_in_a_missing_folder_is_refused(
    scene_crs: Path, press_csv: Path, crease: Run
) -> None:
    said = crease("replay", scene_crs, press_csv, "-o", "/nowhere/at/all.csv")
    assert_error(said, "/nowhere/at", "make it first")


def test_info_for_people_and_programs(scene_crs: Path, crease: Run) -> None:
    said = crease("info", scene_crs)
    assert said.status == 0
    for word in (
        "static",
        "12 triangles",
        "80 mm x 80 mm x 40 mm",
        "12 convex, 0 concave",
        "point shell",
    ):
        assert word in said.out
    info = crease("info", scene_crs, "--json").json
    assert info["static"]["triangles"] == 12
    assert info["static"]["concave_edges"] == 0
    assert info["tool"]["points"] > 100
    assert 0.0 < info["voxmap"]["error_max_m"] < info["voxmap"]["voxel_m"]


def test_info_of_what_is_no_scene(folder: Path, block_stl: Path, crease: Run) -> None:
    assert_error(crease("info", block_stl), "block.stl", "give the .crs that `crease bake` wrote")
    assert_error(crease("info", folder / "none.crs"), "No such file")
    assert_error(crease("info", folder), "directory")


def test_info_of_a_scene_that_is_empty_or_cut_off(
    tmp_path: Path, scene_crs: Path, crease: Run
) -> None:
    image, cut = scene_crs.read_bytes(), tmp_path / "cut.crs"
    for size, reason in (
        (0, "is an empty file; bake it again"),
        (50, "is cut off within its head, after 50 bytes; bake it again"),
        (100_000, f"is cut off: it holds 100,000 of {len(image):,} bytes; bake it again"),
    ):
        cut.write_bytes(image[:size])
        assert_error(crease("info", cut), f"{cut}: {reason}")


def test_replay_report_for_programs(
    folder: Path, scene_crs: Path, press_csv: Path, crease: Run
) -> None:
    report = crease("replay", scene_crs, press_csv, "-o", folder / "r.csv", "--json").json
    assert report["ticks"] == 400
    assert 250 < report["ticks_in_contact"] < 310
    assert report["force_max_N"] == pytest.approx(2.0, rel=0.02)
    assert report["ticks_limited"] == 0


def test_bad_row_stops_the_replay_and_leaves_nothing(
    folder: Path, scene_crs: Path, press_csv: Path, crease: Run
) -> None:
    bad = folder / "bad.csv"
    lines = press_csv.read_text().splitlines()
    lines[200] = lines[200].replace(",", ",oops", 1)
    bad.write_text("\n".join(lines))
    before = set(folder.iterdir())
    said = crease("replay", scene_crs, bad, "-o", folder / "never.csv")
    assert_error(said, f"{bad}:201: x_m is 'oops", "not a number")
    assert set(folder.iterdir()) == before


def test_a_scene_in_the_place_of_a_path_is_told(folder: Path, scene_crs: Path, crease: Run) -> None:
    said = crease("replay", scene_crs, scene_crs, "-o", folder / "none.csv")
    assert_error(said, f"{scene_crs}: is no path and no table", "neither .csv nor .npz; give one")


def test_a_table_of_scenes_that_is_missing_is_named(tmp_path: Path, crease: Run) -> None:
    gone = tmp_path / "gone.toml"
    said = crease("bench", "properties", "-o", tmp_path / "out", "--table", gone)
    assert_error(
        said, f"{gone}: is missing; run in a checkout, or name the table of scenes with --table"
    )


def test_force_limit_is_warned_of(
    folder: Path, scene_crs: Path, press_csv: Path, crease: Run
) -> None:
    said = crease("replay", scene_crs, press_csv, "-o", folder / "lim.csv", "--stiffness", "1e6")
    assert said.status == 0
    assert re.search(
        r"warning: \d+ of 400 ticks reached the limit of the force, 100 N$", said.err, re.MULTILINE
    )
    assert "left out" not in said.err


def test_late_answers_are_warned_of(
    folder: Path, scene_crs: Path, press_csv: Path, crease: Run
) -> None:
    words = ("replay", scene_crs, press_csv, "-o", folder / "late.csv", "--skips", "none")
    said = crease(*words, "--lookups", "32", "--json")
    assert said.status == 0
    late = json.loads(said.out)["ticks_late"]
    assert late > 0
    assert f"warning: {late} of 400 ticks answer an earlier pose, up to" in said.err
    assert json.loads(crease(*words, "--json", "--force").out)["ticks_late"] == 0


class Terminal:
    """A stream that says it is a terminal."""

    def __init__(self) -> None:
        self.text = ""

    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> int:
        self.text += text
        return len(text)

    def flush(self) -> None:
        pass


def test_progress_shows_only_long_work_and_cleans_up(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr("crease.base.progress.time.monotonic", lambda: now[0])
    stream = Terminal()
    with Progress(stream) as progress:  # type: ignore[arg-type]
        progress("work", 0.1)
        assert stream.text == ""
        now[0] = 2.0
        progress("work", 0.5)
        assert "50%" in stream.text
    assert stream.text.endswith("\r\x1b[K")


def test_progress_is_silent_in_a_pipe(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = [0.0]
    monkeypatch.setattr("crease.base.progress.time.monotonic", lambda: now[0])
    with Progress() as progress:
        now[0] = 5.0
        progress("work", 0.5)
    assert capsys.readouterr().err == ""


def test_replace_never_touches_an_input(
    folder: Path, scene_crs: Path, press_csv: Path, crease: Run
) -> None:
    path = folder / "own_input.csv"
    path.write_bytes(press_csv.read_bytes())
    link = folder / "own_input_link.csv"
    link.symlink_to(path)
    for target in (path, link):
        said = crease("replay", scene_crs, path, "-o", target, "--force")
        assert_error(said, f"{target}: is an input")
    assert path.read_bytes() == press_csv.read_bytes()


@pytest.mark.parametrize("verb", ["bake", "replay", "plot", "view", "hil"])
def test_missing_input_is_told_before_an_output_that_exists(
    folder: Path, scene_crs: Path, block_stl: Path, press_csv: Path, crease: Run, verb: str
) -> None:
    gone = folder / "gone"
    words, suffix = {
        "bake": ((gone, block_stl, "--unit", "mm"), ".crs"),
        "replay": ((gone, press_csv), ".csv"),
        "plot": ((gone,), ".png"),
        "view": ((press_csv, "--scene", gone), ".html"),
        "hil": ((gone, "--operator", press_csv), ".crr"),
    }[verb]
    there = folder / f"there_{verb}{suffix}"
    there.write_bytes(b"x")
    assert_error(crease(verb, *words, "-o", there), f"{gone}: there is no such file")


def test_mend_is_told_once(folder: Path, scene_crs: Path, crease: Run) -> None:
    image = bytearray(scene_crs.read_bytes())
    version = image[8]
    for other, mend in ((version - 1, "bake it again"), (version + 1, "update crease")):
        image[8] = other
        old = folder / "old.crs"
        old.write_bytes(bytes(image))
        said = crease("info", old)
        assert_error(said, "old.crs", f"format {other}, this crease reads {version}; {mend}")
        assert said.err.count(mend) == 1


def test_what_has_no_end_is_not_read_to_it(crease: Run) -> None:
    assert_error(crease("info", "/dev/zero"), "/dev/zero", "is no file")


def test_interrupt_is_one_line(crease: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(_args: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(info, "run", interrupted)
    said = crease("info", "any.crs")
    assert (said.status, said.err) == (130, "error: interrupted\n")


def test_interrupt_while_modules_load_is_one_line() -> None:
    command = Path(sys.executable).parent / "crease"
    child = subprocess.Popen([command, "--version"], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    maps = Path(f"/proc/{child.pid}/maps")
    while child.poll() is None and "numpy" not in maps.read_text():
        pass
    child.send_signal(signal.SIGINT)
    out, err = child.communicate(timeout=30)
    assert (child.returncode, out, err) == (-signal.SIGINT, b"", b"error: interrupted\n")


@pytest.mark.parametrize("encoding", ["ascii", "utf-8"])
@pytest.mark.parametrize("name", ["sz\u00e4ne \u4e2d.crs", "sz\udce4ne.crs"])
def test_a_name_that_the_terminal_cannot_show_is_escaped(
    encoding: str, name: str, scene_crs: Path, tmp_path: Path
) -> None:
    scene = tmp_path / name
    scene.write_bytes(scene_crs.read_bytes())
    command = [str(Path(sys.executable).parent / "crease"), "info", str(scene)]
    env = {**os.environ, "PYTHONIOENCODING": encoding}
    said = subprocess.run(command, capture_output=True, env=env, check=False)
    assert (said.returncode, said.stderr) == (0, b"")
    assert name.encode(encoding, "backslashreplace") in said.stdout
    said = subprocess.run([*command, "--nothing"], capture_output=True, env=env, check=False)
    assert (said.returncode, said.stderr.count(b"\n")) == (2, 1)


@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&- >&- 2>&-"])
def test_a_stream_that_is_closed_at_the_start_stops_nothing(
    closed: str, ball_stl: Path, tmp_path: Path
) -> None:
    command = f"{Path(sys.executable).parent / 'crease'} check {ball_stl} --unit mm -o {tmp_path / 'c.png'}"
    said = subprocess.run(["sh", "-c", f"{command} {closed}"], capture_output=True, check=False)
    assert (said.returncode, said.stderr) == (0, b"")
    assert [file.name for file in tmp_path.iterdir()] == ["c.png"]


def test_a_full_disk_under_the_output_is_one_line(ball_stl: Path) -> None:
    command = [str(Path(sys.executable).parent / "crease"), "check", str(ball_stl), "--unit", "mm"]
    with Path("/dev/full").open("w") as full:
        said = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, check=False)
    assert said.returncode == 1
    assert said.stderr == b"error: standard output: No space left on device\n"
