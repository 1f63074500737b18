"""What Python callers may get wrong: two threads in one world, a pickle of one, the name of a file for a path."""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import crease
import numpy as np
import pytest
from crease.base.alone import Alone

KINDS: dict[str, Callable[[Path], object]] = {
    "Scene": crease.Scene.open,
    "World": crease.World,
    "Worlds": lambda path: crease.Worlds(path, 2),
    "Coupling": crease.Coupling,
    "Loop": crease.Loop,
}


@pytest.mark.parametrize("kind", list(KINDS))
def test_what_is_memory_of_a_process_says_what_travels_instead(kind: str, scene_crs: Path) -> None:
    made = KINDS[kind](scene_crs)
    with pytest.raises(TypeError, match=rf"^a {kind} is memory of this process .*; send the path"):
        pickle.dumps(made)
    if isinstance(made, crease.Scene):
        assert copy.copy(made) is copy.deepcopy(made) is made


def test_the_name_of_a_file_is_no_path(scene_crs: Path) -> None:
    for made in (crease.World(scene_crs), crease.Coupling(scene_crs)):
        with pytest.raises(crease.TrajectoryError, match=r"nope\.csv; give what crease\.load_path"):
            made.replay("nope.csv")
    for name in ("nope.csv", Path("nope.csv")):
        with pytest.raises(crease.TrajectoryError, match=r"nope\.csv; give what crease\.load_path"):
            crease.Loop(scene_crs).run(name)  # type: ignore[arg-type]


SCRIPT = """
import sys, threading
import crease, numpy as np
scene = crease.Scene.open(sys.argv[1])
DEEP = [0.0, 0.0, 0.008, 1.0, 0.0, 0.0, 0.0]
said = []
def twice(work, times):
    def many():
        for _ in range(times):
            try:
                work()
            except crease.CreaseError as error:
                said.append(str(error))
    threads = [threading.Thread(target=many) for _ in range(2)]
    [thread.start() for thread in threads]
    [thread.join() for thread in threads]
kind = sys.argv[2]
if kind == "tick":
    world = crease.World(scene)
    twice(lambda: world.tick(DEEP), 20_000)
elif kind == "replay":
    world, poses = crease.World(scene), np.tile(DEEP, (2000, 1))
    twice(lambda: world.replay(poses), 10)
elif kind == "mixed":
    world, poses = crease.World(scene), np.tile(DEEP, (200, 1))
    twice(lambda: (world.reset(), world.replay(poses), world.tick(DEEP)), 50)
elif kind == "step":
    worlds, poses = crease.Worlds(scene, 128), np.tile(DEEP, (128, 1))
    twice(lambda: worlds.step(poses), 200)
elif kind == "couple":
    coupling = crease.Coupling(scene)
    twice(lambda: coupling.tick(DEEP), 2000)
elif kind == "loop":
    loop, poses = crease.Loop(scene), np.tile([0.0, 0.0, 0.02, 1.0, 0.0, 0.0, 0.0], (300, 1))
    twice(lambda: loop.run(poses), 4)
print(len(said), *sorted(set(said)), sep="\\n")
"""

WHAT = {
    **dict.fromkeys(("tick", "replay", "mixed"), "world"),
    "step": "batch of worlds",
    "couple": "coupling",
    "loop": "loop",
}


@pytest.mark.parametrize("kind", list(WHAT))
def test_two_threads_at_once_break_nothing(kind: str, scene_crs: Path) -> None:
    command = [sys.executable, "-c", SCRIPT, str(scene_crs), kind]
    said = subprocess.run(command, capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stderr
    count, *texts = said.stdout.splitlines()
    assert set(texts) <= {
        f"{WHAT[kind]}: used by two threads at once; make one {WHAT[kind]} a thread: they may share a scene"
    }
    if kind in ("replay", "step", "loop"):  # long enough that the other comes meanwhile
        assert int(count) > 0


def elsewhere(work: Callable[[], object]) -> BaseException | None:
    """What `work` raises in another thread."""
    caught: list[BaseException] = []

    def run() -> None:
        try:
            work()
        except BaseException as error:
            caught.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    return caught[0] if caught else None


def test_while_one_thread_is_in_a_world_others_are_refused_and_may_come_after(
    scene_crs: Path,
) -> None:
    world, pose = crease.World(scene_crs), [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0]
    inside: Alone = world._alone
    calls: list[Callable[[], object]] = [
        lambda: world.tick(pose),
        lambda: world.replay([pose]),
        world.reset,
        world.clear_fault,
    ]
    with inside:
        assert all("two threads" in str(elsewhere(call)) for call in calls)
        world.tick(pose)  # the same thread goes on
    with pytest.raises(crease.TrajectoryError):
        world.tick([1.0])  # leaves as it came
    assert [elsewhere(call) for call in calls] == [None] * 4


def test_threads_with_worlds_of_their_own_share_a_scene(scene_crs: Path) -> None:
    scene, poses = crease.Scene.open(scene_crs), np.tile([0, 0, 0.008, 1, 0, 0, 0], (500, 1))
    felt: list[crease.Replay] = []
    threads = [
        threading.Thread(target=lambda: felt.append(crease.World(scene).replay(poses)))
        for _ in range(3)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(np.array_equal(one.force_N, felt[0].force_N) for one in felt)
    assert len(felt) == 3
