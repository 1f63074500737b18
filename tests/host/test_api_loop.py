"""`crease.Loop` and `crease.Worlds`: the loop of `crease hil` and the ticks of `World`, from Python, to the bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import crease
import numpy as np
import pytest
from crease.base.native import lib
from crease.base.scene import open_scene
from crease.loop import hil
from crease.loop.loop import Setup, bring_up, open_loop
from crease.replay.recording import load_recording, rerun
from crease.replay.trajectory import check_rows

FREE = [0.0, 0.0, 0.05, 1.0, 0.0, 0.0, 0.0]
PRESSED = [0.0, 0.0, 0.008, 1.0, 0.0, 0.0, 0.0]


@pytest.fixture(scope="module")
def scene(scene_crs: Path) -> crease.Scene:
    return open_scene(scene_crs)


def way(ticks: int) -> np.ndarray[Any, Any]:
    """Down onto the block, (ticks, 7)."""
    poses = np.tile(PRESSED, (ticks, 1))
    poses[:, 2] = np.linspace(0.02, 0.006, ticks)
    return poses


def test_the_loop_gives_way_and_pushes_back(scene: crease.Scene) -> None:
    loop = crease.Loop(scene, stiffness=800.0)
    felt = loop.run(way(600))
    assert (len(felt), loop.mode, loop.faults) == (600, "rendering", [])
    assert np.diff(felt.t_s) == pytest.approx(1e-3, abs=1e-9)
    held = loop.hold(1500)
    assert held.contact_force_N[-1, 2] == pytest.approx(800.0 * held.depth_m[-1], rel=0.01)
    assert held.position_m[-1, 2] > 0.006 + 1e-3  # above where the hand wants it
    felt_N = held.hand_force_N[-1, 2]  # dry friction holds the arm too
    assert felt_N == pytest.approx(held.force_N[-1, 2], abs=0.6)
    assert felt_N > 0.3
    assert held.areas[-1] == held.zones[-1] == 1
    assert np.linalg.norm(held.quaternion[-1]) == pytest.approx(1.0, abs=1e-6)
    assert not held.faults.any()
    touched = int(np.count_nonzero(held.areas))
    assert repr(held).startswith(f"Felt(1,500 ticks, {touched:,} in contact, ")
    assert repr(held).endswith(" N at most)")


@pytest.mark.slow
def test_it_is_the_loop_of_the_instrument_to_the_bit(scene: crease.Scene) -> None:
    """No second loop: the ticks of `crease.loop.loop`, that `crease hil` and the benchmarks run."""
    poses, loop = way(300), crease.Loop(scene)
    first, rest = loop.run(poses[:100]), loop.run(poses[100:])
    by_tick = crease.Loop(scene)
    ticked = [by_tick.tick(pose) for pose in poses[:50]]
    known = open_loop(scene, Setup())
    rows = np.column_stack([np.arange(300) * 1e-3, poses])
    targets = hil.hand_targets(check_rows(rows, "way"), known.config)
    bring_up(known, targets)
    known.run(targets)
    records = known.result().recording.rows[-300:]
    assert records.tobytes() == first.rows.tobytes() + rest.rows.tobytes()
    assert b"".join(f.rows.tobytes() for f in ticked) == records[:50].tobytes()


def test_a_recording_of_it_runs_again(scene: crease.Scene, scene_crs: Path, tmp_path: Path) -> None:
    loop = crease.Loop(scene)
    loop.run(way(200))
    file = loop.save(tmp_path / "run.crr")
    with pytest.raises(crease.CreaseError, match="exists already"):
        loop.save(file)
    found = rerun(load_recording(file), scene)
    assert (found.records, found.different) == (loop.ticks, 0)
    loop.run(way(10))  # goes on after a save


def test_paths_with_times_are_resampled(scene: crease.Scene) -> None:
    rows = np.column_stack([[0.0, 0.1], np.tile(FREE, (2, 1))])
    assert len(crease.Loop(scene).run(rows)) == 101


def test_where_the_device_stands_can_be_chosen(scene: crease.Scene) -> None:
    far = np.array(FREE) + np.array([1.0, 2.0, 3.0, 0, 0, 0, 0])
    with pytest.raises(crease.LoopError, match="does not reach"):
        crease.Loop(scene).run(far[None])
    felt = crease.Loop(scene, at=far[:3]).run(far[None])
    assert felt.position_m[-1] == pytest.approx(far[:3], abs=2e-3)


def test_a_fault_is_told_and_reset_ends_it(scene: crease.Scene) -> None:
    loop = crease.Loop(scene, keep=False)
    loop.run(way(20))
    lib.cr_servo_input(loop._loop.servo.c, int(lib.CR_INPUT_BUS_OFF))
    felt = loop.hold(5)
    assert felt.faults[-1]
    assert loop.faults
    assert loop.mode == "fault"
    assert not felt.force_N[-1].any()
    with pytest.raises(crease.LoopError, match="keep=False"):
        loop.save("never.crr")
    loop.reset()
    assert (loop.ticks, loop.faults) == (0, [])
    assert not loop.run(way(20)).faults.any()


WORD: Any = "a"
HALF: Any = 1.5
TUPLE: Any = (1, 2, 3)


def started(scene: crease.Scene) -> crease.Loop:
    loop = crease.Loop(scene, keep=False)
    loop.start(FREE)
    return loop


WRONG: list[tuple[Any, str]] = [
    (lambda s: crease.Loop(s, response="nothing"), "response 'nothing' is not known"),
    (lambda s: crease.Loop(s, stiffness=-1.0), "stiffness"),
    (lambda s: crease.Loop(s, at=[1.0, 2.0]), "three finite numbers"),
    (lambda s: crease.Loop(s).run([[1.0, 2.0]]), "poses of shape"),
    (
        lambda s: crease.Loop(s).run("path"),
        "poses is the name of a file, path; give what crease.load_path",
    ),
    (lambda s: crease.Loop(s).tick([0, 0, 1, 2, 0, 0, 0]), "quaternion has length 2"),
    (lambda s: crease.Loop(s).hold(3), "no pose yet"),
    (lambda s: crease.Worlds(s, 4, response="nothing"), "response 'nothing' is not known"),
    (lambda s: started(s).hold(-1), "ticks is -1; give a whole number of 1 or more"),
    (lambda s: started(s).hold(HALF), "ticks is 1.5; give a whole number of 1 or more"),
    (lambda s: started(s).hold(0), "ticks is 0; give a whole number of 1 or more"),
    (lambda s: crease.Loop(s).save("never.crr"), "never.crr: the loop has no ticks to write yet"),
    (lambda s: crease.Loop(s, stiffness=WORD), "stiffness is 'a'; give a number from 0"),
    (lambda s: crease.Loop(s, damping=-1), "damping is -1; give a number from 0 to 1000 N s/m"),
    (lambda s: crease.Loop(s, hand=TUPLE), "hand is .1, 2, 3.; give crease.Hand"),
    (lambda s: crease.Hand(-1, 1, 1), "hand: mass_kg is -1; .* 0 to 100 kg"),
    (lambda s: crease.Hand(1, np.nan, 1), "hand: damping_Ns_m is nan; .* 0 to 10000 N s/m"),
    (lambda s: crease.Hand(1, 1, 2e6), "hand: stiffness_N_m is 2000000.0"),
    (lambda s: crease.Worlds(s, 0), "count is 0; give a whole number of 1 or more"),
    (lambda s: crease.Worlds(s, WORD), "count is 'a'; give a whole number of 1 or more"),
    (lambda s: crease.Worlds(s, HALF), "count is 1.5; give a whole number of 1 or more"),
    (lambda s: crease.Worlds(s, 3, threads=0), "threads is 0; give a whole number of 1 or more"),
    (
        lambda s: crease.Worlds(s, 10**9),
        "1,000,000,000 worlds take .* half of this machine's memory",
    ),
    (lambda s: crease.Worlds(s, 4).step(np.zeros((3, 7))), "give \\(4, 7\\), one pose a world"),
    (lambda s: crease.Worlds(s, 4).step([["a"] * 7] * 4), "not numbers"),
    (lambda s: crease.Worlds(s, 4).reset(np.ones(3, bool)), "4 truth values"),
]


@pytest.mark.parametrize("at", range(len(WRONG)), ids=lambda at: WRONG[at][1].split()[0])
def test_what_is_wrong_is_one_line(at: int, scene: crease.Scene) -> None:
    call, text = WRONG[at]
    with pytest.raises(crease.CreaseError, match=text) as error:
        call(scene)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("count", "threads"), [(1, None), (7, 2), (130, 1), (130, 2), (130, 3)])
def test_every_world_of_a_batch_feels_what_one_alone_feels(
    count: int, threads: int | None, scene: crease.Scene
) -> None:
    rng, steps = np.random.default_rng(count), 30
    poses = np.tile(PRESSED, (steps, count, 1))
    poses[..., :3] += np.cumsum(rng.normal(0.0, 2e-4, (steps, count, 3)), axis=0)
    worlds = crease.Worlds(scene, count, threads=threads, damping=1.0)
    seen = [worlds.step(step) for step in poses]
    for i in {0, count // 2, count - 1}:
        alone = crease.World(scene, damping=1.0)
        for k in range(steps):
            out = alone.tick(poses[k, i])
            for name in ("force_N", "torque_Nm", "normal"):
                assert np.array_equal(seen[k][name][i], getattr(out, name))
            assert seen[k]["depth_m"][i] == out.depth_m
    assert seen[0]["force_N"].shape == (count, 3)
    assert seen[0]["depth_m"].shape == (count,)
    assert (worlds.areas > 0).any()
    worlds.close()


def test_worlds_are_reset_one_by_one(scene: crease.Scene) -> None:
    worlds = crease.Worlds(scene, 3)
    poses = np.tile(PRESSED, (3, 1))
    poses[1, 3] = 2.0  # no unit quaternion
    seen = worlds.step(poses)
    assert worlds.faults.tolist() == seen["faults"].tolist() == [0, 1, 0]
    seen = worlds.reset(np.array([False, True, False]))
    assert worlds.faults.tolist() == seen["faults"].tolist() == [0, 0, 0]
    assert seen["depth_m"][1] == 0.0 < seen["depth_m"][0]
    poses[1] = PRESSED
    assert (worlds.step(poses)["force_N"][:, 2] > 1.0).all()
    assert not worlds.reset()["force_N"].any()


def test_observations_are_copies(scene: crease.Scene) -> None:
    worlds = crease.Worlds(scene, 2)
    seen = worlds.step([FREE, PRESSED])
    kept = seen["force_N"].copy()
    worlds.step([PRESSED, FREE])
    assert np.array_equal(seen["force_N"], kept)  # copies
    assert not kept[0].any()
    assert kept[1, 2] > 1.0
