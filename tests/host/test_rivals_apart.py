"""What ships is what runs here; other methods are in an extension of their own, loaded when one is asked for."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import crease as package
import numpy as np
import pytest
from crease.base.errors import SceneError
from crease.base.native import RESPONSES, Extension, ffi, lib, lib_of
from crease.base.scene import open_scene
from crease.loop.hil import Loop, run_inprocess
from crease.replay import recording, replay
from crease.replay.contacts import find_contacts
from crease.replay.replay import DEFAULT_RESPONSE, ReplayOptions, World, run_path
from crease.replay.trajectory import load_trajectory

ROOT = Path(__file__).resolve().parents[2]
SCENE, PATH = ROOT / "build/scenes/edge90_cube.crs", ROOT / "build/meshes/edge90_cube.csv"
OTHERS = [name for name in RESPONSES if name != DEFAULT_RESPONSE]
RIVALS = lib_of(RESPONSES["extent"])
SHIPPED = Extension(lib, ffi)


def config_of(native: Extension, response: str) -> Any:
    config = native.ffi.new("cr_config *", native.lib.cr_config_default())
    config.response = RESPONSES[response]
    return config


def test_what_ships_knows_one_response() -> None:
    assert [name for name in dir(lib) if name.startswith("CR_RESPONSE_")] == [
        "CR_RESPONSE_COUNT",
        "CR_RESPONSE_WAY_OUT",
    ]
    assert lib.CR_RESPONSE_COUNT == 1
    assert lib_of(RESPONSES[DEFAULT_RESPONSE]) == lib_of(len(RESPONSES)) == SHIPPED


@pytest.mark.parametrize("response", OTHERS)
def test_what_ships_refuses_the_others(scene_crs: Path, response: str) -> None:
    scene, config = open_scene(scene_crs), config_of(SHIPPED, response)
    assert lib.cr_world_size(scene.handle, config) == 0
    assert ffi.string(lib.cr_config_error(config)).startswith(b"response, ")
    room = ffi.new("char[]", 1 << 20)
    aligned = ffi.cast("void *", -(-int(ffi.cast("uintptr_t", room)) // 64) * 64)
    code = lib.cr_world_init(ffi.new("cr_world **"), aligned, 1 << 19, scene.handle, config)
    assert code == lib.CR_ERR_CONFIG
    servo = ffi.new("cr_servo_config *", lib.cr_servo_config_default())
    servo.world = config[0]
    assert ffi.string(lib.cr_servo_config_error(servo)).startswith(b"response, ")
    assert lib.cr_servo_size(scene.handle, servo) == 0


def test_names_of_the_others_are_those_of_c() -> None:
    of_c = {
        name.removeprefix("CR_RESPONSE_").lower(): int(getattr(RIVALS.lib, name))
        for name in dir(RIVALS.lib)
        if name.startswith("CR_RESPONSE_")
    }
    assert of_c.pop("count") == len(RESPONSES)
    assert of_c == RESPONSES


def test_plain_structs_are_laid_out_alike() -> None:
    """Tables, settings and scenes are read as what ships has them, whoever answered."""

    def layouts(native: Extension) -> dict[str, Any]:
        names, tags, _ = map(set, native.ffi.list_types())
        opaque = names & tags
        whole = {*(names - opaque), *(f"struct {tag}" for tag in tags - opaque)}
        kinds = {name: native.ffi.typeof(name) for name in sorted(whole)}
        return {
            name: (native.ffi.sizeof(kind), [(m, f.offset, f.type.cname) for m, f in kind.fields])
            for name, kind in kinds.items()
            if kind.kind == "struct"
        }

    here = layouts(SHIPPED)
    assert {"cr_config", "cr_scene", "cr_servo_config", "cr_output", "cr_record"} <= set(here)
    assert not {"cr_world", "cr_servo"} & set(here)
    assert here == layouts(RIVALS)


def test_a_world_is_not_for_the_other_extension(scene_crs: Path) -> None:
    scene = open_scene(scene_crs)
    ours, theirs = World(scene), World(scene, ReplayOptions(response="extent"))
    assert theirs.size_bytes > ours.size_bytes
    loop = Loop(scene)
    for native, handle in ((RIVALS, ours.handle), (SHIPPED, theirs.handle)):
        with pytest.raises(TypeError, match="cr_world"):
            native.lib.cr_world_clear_fault(handle)
    with pytest.raises(TypeError, match="cr_servo"):
        RIVALS.lib.cr_servo_get_status(loop.servo.c)
    with pytest.raises(TypeError, match="cr_scene"):
        RIVALS.own("cr_config", scene.handle)


@pytest.mark.parametrize("response", [DEFAULT_RESPONSE, "fixed45"])
def test_others_are_loaded_when_asked_for(
    scene_crs: Path, press_csv: Path, tmp_path: Path, response: str
) -> None:
    text = (
        "import sys; from crease.cli import main; status = main(sys.argv[1:]);"
        "print([name for name in sys.modules if name.startswith('crease._rivals')]); sys.exit(status)"
    )
    files = [str(scene_crs), str(press_csv), "-o", str(tmp_path / "out.csv")]
    words = [sys.executable, "-c", text, "replay", *files, "--response", response]
    said = subprocess.run(words, capture_output=True, text=True, check=True)
    assert (said.stdout.splitlines()[-1] == "[]") == (response == DEFAULT_RESPONSE)


def test_without_them_one_line_says_so(scene_crs: Path, press_csv: Path, tmp_path: Path) -> None:
    text = (
        "import sys, crease.base.native as n; n.find_spec = lambda name: None;"
        "from crease.cli import main; sys.exit(main(sys.argv[1:]))"
    )
    files = [str(scene_crs), str(press_csv), "-o", str(tmp_path / "out.csv")]
    words = [sys.executable, "-c", text, "replay", *files, "--response"]
    said = subprocess.run([*words, "extent"], capture_output=True, text=True, check=False)
    assert (said.returncode, said.stdout) == (1, "")
    assert said.stderr.splitlines()[-1] == (
        "error: response extent: this build has no crease._rivals; run `make build`, or use way_out"
    )
    subprocess.run([*words, DEFAULT_RESPONSE], capture_output=True, check=True)


def without_times(rows: Any) -> list[bytes]:
    return [rows[name].tobytes() for name in rows.dtype.names if name != "tick_ns"]


@pytest.fixture
def all_by_rivals(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """From its call on, the extension with rivals answers with the way out too."""

    def swap() -> None:
        for room in (replay, recording):
            monkeypatch.setattr(room, "lib_of", lambda _: RIVALS)

    return swap


def test_both_extensions_answer_the_way_out_alike(all_by_rivals: Callable[[], None]) -> None:
    scene, path = open_scene(SCENE), load_trajectory(PATH)
    options = ReplayOptions(damping_Ns_m=2.0)
    shipped = run_path(scene, path, options)
    assert np.count_nonzero(shipped["areas"]) > 1000
    all_by_rivals()
    assert World(scene, options).native == RIVALS
    assert without_times(run_path(scene, path, options)) == without_times(shipped)


@pytest.mark.slow
def test_both_extensions_close_the_loop_alike(
    scene_crs: Path, press_csv: Path, all_by_rivals: Callable[[], None]
) -> None:
    scene, path = open_scene(scene_crs), load_trajectory(press_csv)
    shipped = run_inprocess(scene, path).recording
    assert shipped.rows["areas"].any()
    all_by_rivals()
    assert run_inprocess(scene, path).recording.rows.tobytes() == shipped.rows.tobytes()


def test_a_recording_of_another_response_runs_again(
    scene_crs: Path, press_csv: Path, tmp_path: Path
) -> None:
    scene, path = open_scene(scene_crs), load_trajectory(press_csv)
    loop = package.Loop(scene, response="fixed45")
    loop.run(path)
    assert loop.mode == "rendering"
    assert loop.faults == []
    kept = recording.load_recording(loop.save(tmp_path / "run.crr"))
    assert kept.config.world.response == RESPONSES["fixed45"]
    again = recording.rerun(kept, scene)
    assert again.records == loop.ticks
    assert again.different == 0
    assert kept.rows["areas"].any()


def test_a_batch_and_a_picture_are_of_the_response_that_was_asked_for(
    scene_crs: Path, press_csv: Path
) -> None:
    scene, path = open_scene(scene_crs), load_trajectory(press_csv)
    one = package.World(scene, response="overlap")
    many = package.Worlds(scene, 2, response="overlap")
    pose = path.rows[399, 1:]
    seen = many.step(np.stack([pose, pose]))
    felt = one.tick(pose)
    assert felt.force_N[2] > 0.1
    assert (seen["force_N"] == felt.force_N).all()
    one.clear_fault()
    assert find_contacts(scene, path, ReplayOptions(response="overlap")).ticks["contacts"].any()


def test_a_setting_that_is_refused_is_said_by_who_answers(scene_crs: Path) -> None:
    for response in (DEFAULT_RESPONSE, "extent"):
        with pytest.raises(SceneError, match=r"stiffness_N_m: 0\.\.1e6"):
            World(open_scene(scene_crs), ReplayOptions(stiffness_N_m=-1.0, response=response))
