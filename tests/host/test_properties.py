"""The judge of `crease bench properties`: it keeps a right force, and each way to spoil one breaks the right check.

The right forces are in closed form: a cube in an inside corner is pushed out of each wall by its depth there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import make
import numpy as np
import numpy.typing as npt
import property_paths
import property_shapes
import pytest
from crease.base.attitude import to_matrix
from crease.base.errors import CreaseError
from crease.replay.trajectory import load_trajectory
from host_tools import Run
from scipy.spatial.transform import Rotation
from study.properties.answers import Answer, refined, steps_mm
from study.properties.checks import Finding
from study.properties.geometry import S_MAX, Pair, distances
from study.properties.judge import Effort, Row, Stage, judge, make_stage
from study.properties.run import choose_responses, choose_scenes
from study.properties.scenes import PropertyScene, load_meshes, load_scenes
from study.properties.search import search
from study.properties.tables import kept_share, read_csv, scene_table, summary_table, to_csv

ROOT = Path(__file__).resolve().parent.parent.parent
TABLE = ROOT / "meshes" / "property_scenes.toml"
F64 = npt.NDArray[np.float64]
Force = Callable[[F64], F64]
"""Force over stiffness, mm, of poses (n, 7)."""

CORNER_WALLS = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))
CORNER = PropertyScene(
    "corner", "", "", "inside_corner.stl", "cube20_12.stl", "corner.csv", walls=CORNER_WALLS
)
FLOOR = PropertyScene(
    "floor",
    "",
    "",
    "floor.stl",
    "cube20_12.stl",
    "press.csv",
    flat_z_mm=0.0,
    convex=True,
    twin="twin",
)
ROCK = PropertyScene(
    "rock", "", "", "floor.stl", "cube20_12.stl", "rock_loop.csv", flat_z_mm=0.0, convex=True
)
JAW = PropertyScene("jaw", "", "", "bar.stl", "jaw.stl", "jaw.csv", jammed=True, balance="jaw")
LIFT = np.array([0.0, 0.0, 0.1])
EFFORT = Effort(poses=60, clear_s=0.2)


@pytest.fixture(scope="module")
def meshes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the meshes and paths of the scenes."""
    folder = tmp_path_factory.mktemp("meshes")
    for scene in (CORNER, FLOOR, ROCK, JAW):
        for name in (scene.static[:-4], scene.tool[:-4]):
            data = make.stl_bytes(name, make.MESHES[name]())
            (folder / f"{name}.stl").write_bytes(data)
    paths = {
        "corner": property_paths.PATHS["corner"](),
        "press": property_paths.line("0 0 10.4 | 0 0 8.8 | 3 1 9.2 | 3 1 10.4", 0.05),
        "rock_loop": property_paths.PATHS["rock_loop"](),
        "jaw": property_paths.line("0.1 0 0 | 0.3 6 0 | -0.2 12 0", 0.02),
    }
    for name, path in paths.items():
        (folder / f"{name}.csv").write_bytes(make.csv_bytes(path))
    return folder


@pytest.fixture(scope="module")
def stages(meshes: Path) -> dict[str, Stage]:
    """The scenes, looked at once."""
    return {
        s.name: make_stage(s, meshes, Pair(*load_meshes(s, meshes)), EFFORT)
        for s in (CORNER, FLOOR, ROCK, JAW)
    }


def corner_force(poses: F64) -> F64:
    """Out of each of three walls by the depth of the 20 mm cube behind it."""
    return np.asarray(np.maximum(10.0 - poses[:, :3], 0.0))


def floor_force(poses: F64) -> F64:
    """Up by the depth."""
    return np.outer(np.maximum(10.0 - poses[:, 2], 0.0), [0.0, 0.0, 1.0])


ENDS = np.array([[x, y, z] for x in (-10, 10) for y in (-10, 10) for z in (-10, 10)], float)


def lowest_force(poses: F64) -> F64:
    """The way out of the floor for any attitude: the depth of the lowest corner."""
    turned = to_matrix(poses[:, 3:])
    low = poses[:, 2] + np.einsum("nb,mb->nm", turned[:, 2], ENDS).min(axis=1)
    return np.outer(np.maximum(-low, 0.0), [0.0, 0.0, 1.0])


def lowest_torque(poses: F64) -> F64:
    """Of that force at the middle of the lowest corners: the gradient of half the squared depth."""
    levers = []
    for pose in poses:
        ends = ENDS @ to_matrix(pose[3:]).T
        levers.append(ends[ends[:, 2] < ends[:, 2].min() + 1e-6].mean(axis=0))
    return np.cross(np.array(levers), lowest_force(poses))


def jaw_force(poses: F64) -> F64:
    """Half of what both springs would differ by."""
    return np.asarray(-poses[:, 0][:, None] * np.array([1.0, 0.0, 0.0]))


def answered(force: Force, torque: Force | None = None) -> Callable[[F64], Answer]:
    """A way to answer with this force, and this torque, mm^2."""

    def ask(poses: F64) -> Answer:
        turn = np.zeros((len(poses), 3)) if torque is None else torque(poses)
        way = force(poses)
        return Answer(way, turn, np.full(len(poses), 5.0), np.asarray(way.any(axis=1)))

    return ask


def judged(
    stage: Stage, force: Force, torque: Force | None = None, twin: Force | None = None
) -> Row:
    """All checks on an answer."""
    ask = answered(force, torque)
    return judge(
        stage, "made up", ask(stage.poses), ask, {"twin": answered(twin or force)(stage.poses)}
    )


def broken(row: Row) -> set[str]:
    """Properties that are rated and not kept."""
    return {name for name, kept in row.verdicts().items() if not kept}


def test_right_forces_keep_all_that_their_scenes_ask_for(stages: dict[str, Stage]) -> None:
    corner = judged(stages["corner"], corner_force)
    assert set(corner.verdicts()) == {"P2", "P3", "P5", "P6", "P7", "P9"}
    assert broken(corner) == set()
    assert corner.values()["clear_p50"] == pytest.approx(1.0, abs=0.007)
    assert corner.values()["amplification"] == pytest.approx(1.0, abs=1e-6)
    floor = judged(stages["floor"], floor_force)
    assert set(floor.verdicts()) == {"P1", "P2", "P3", "P4", "P6", "P7", "P8", "P9"}
    assert broken(floor) == set()
    jaw = judged(stages["jaw"], jaw_force)
    assert broken(jaw) == set()
    assert jaw.values()["jam_poses"] > 0
    assert "P2" not in jaw.verdicts()


def test_double_force_is_neither_flat_nor_the_way_out(stages: dict[str, Stage]) -> None:
    row = judged(stages["floor"], lambda p: 2.0 * floor_force(p), twin=floor_force)
    assert broken(row) == {"P1", "P2", "P4"}
    assert row.values()["clear_p50"] == pytest.approx(0.5, abs=0.007)
    assert row.values()["flat_error"] == pytest.approx(1.0, abs=1e-4)
    assert broken(judged(stages["corner"], lambda p: 4.0 * corner_force(p))) == {"P2", "P5", "P9"}


def test_dropped_component_leaves_a_wall_and_does_not_clear(stages: dict[str, Stage]) -> None:
    row = judged(stages["corner"], lambda p: corner_force(p) * [1.0, 0.0, 1.0])
    assert broken(row) == {"P2", "P5"}
    assert row.values()["wall_error"] == pytest.approx(1.0, rel=0.5)
    assert row.values()["clear_p95"] == S_MAX


def jumping(size_mm: float, at_mm: float = 9.3) -> Force:
    """The floor's force and a step of size_mm sideways at one height."""
    return lambda p: floor_force(p) + np.outer((p[:, 2] < at_mm) * size_mm, [1.0, 0.0, 0.0])


def test_jump_is_found_however_small_beside_the_steps(stages: dict[str, Stage]) -> None:
    row = judged(stages["floor"], jumping(0.03), twin=floor_force)
    assert row.values()["jump_mm"] == pytest.approx(0.03, rel=0.1)
    assert "P3" in broken(row)
    assert "P3" not in broken(judged(stages["floor"], jumping(0.004), twin=floor_force))


def test_steep_is_not_a_jump_but_amplification(stages: dict[str, Stage]) -> None:
    def steep(poses: F64) -> F64:
        bump = np.clip(20.0 * (9.5 - poses[:, 2]), 0.0, 2.0)
        return floor_force(poses) + np.outer(bump, [1.0, 0.0, 0.0])

    row = judged(stages["floor"], steep)
    assert "P3" not in broken(row)
    assert "P9" in broken(row)
    assert row.values()["amplification"] == pytest.approx(np.hypot(20.0, 1.0), rel=0.02)


def test_torque_that_jumps_breaks_continuity(stages: dict[str, Stage]) -> None:
    def torque(poses: F64) -> F64:
        return np.outer((poses[:, 2] < 9.3) * 5.0, [1.0, 0.0, 0.0])

    row = judged(stages["floor"], floor_force, torque)
    assert row.values()["torque_jump_mm"] == pytest.approx(
        5.0 / stages["floor"].pair.radius_mm, rel=0.05
    )
    assert "P3" in broken(row)


def test_force_that_depends_on_the_way_makes_energy(stages: dict[str, Stage]) -> None:
    """Softer before x = 1.5 mm: pressed in soft, let out stiff."""

    def curl(poses: F64) -> F64:
        return floor_force(poses) * (0.9 + 0.1 * np.clip(poses[:, :1], 0.0, 1.0))

    row = judged(stages["floor"], curl, twin=curl)
    assert "P6" in broken(row)
    stiff_J, soft_J = 0.5 * 0.8**2, 0.9 * 0.5 * 1.2**2
    assert row.values()["energy_share"] > 0.02 * stiff_J / soft_J


@pytest.mark.slow
def test_turns_do_work_too(stages: dict[str, Stage]) -> None:
    """Pressed level, let out tilted, and back: the gradient of a potential gives back all, without its torque not."""
    row = judged(stages["rock"], lowest_force, lowest_torque)
    assert row.values()["energy_share"] < 0.005
    assert row.values()["torque_rms_mm"] < 1e-3
    assert not {"P1", "P2", "P6", "P7", "P8", "P9"} & broken(row)
    assert {"P6", "P8"} <= broken(judged(stages["rock"], lowest_force))
    assert {"P6", "P8"} <= broken(judged(stages["rock"], lowest_force, lambda p: -lowest_torque(p)))


def test_force_in_free_space_is_a_ghost(stages: dict[str, Stage]) -> None:
    row = judged(stages["floor"], lambda p: floor_force(p) + [0.0, 0.0, 0.05] * (p[:, 2:3] < 10.35))
    assert row.values()["ghost_mm"] == pytest.approx(0.05)
    assert "P7" in broken(row)


def test_silence_keeps_nothing(stages: dict[str, Stage]) -> None:
    row = judged(stages["floor"], lambda p: 0.0 * floor_force(p))
    assert row.silent == 1.0
    assert not any(row.verdicts().values())


def test_shallow_contact_without_a_force_is_a_miss(stages: dict[str, Stage]) -> None:
    row = judged(stages["floor"], lambda p: floor_force(p) * (p[:, 2:3] < 9.4))
    assert row.values()["silent_mm"] == pytest.approx(0.6, abs=0.06)
    assert "P7" in broken(row)
    fine = judged(stages["floor"], lambda p: floor_force(p) * (p[:, 2:3] < 9.6))
    assert "P7" not in broken(fine)


def test_torque_beyond_the_touching_face_breaks_virtual_work(stages: dict[str, Stage]) -> None:
    """The cube's face reaches 10 mm to each side: a lever of 9 mm may be, one of 12 may not."""

    def pulled(lever_mm: float) -> Force:
        return lambda p: floor_force(p)[:, 2:] * np.array([0.0, -lever_mm, 0.0])

    assert "P8" not in broken(judged(stages["floor"], floor_force, pulled(9.0)))
    row = judged(stages["floor"], floor_force, pulled(12.0))
    assert "P8" in broken(row)
    assert row.values()["torque_rms_mm"] == pytest.approx(
        2.0 / stages["floor"].pair.radius_mm, rel=0.35
    )


def test_jaw_may_feel_the_difference_but_not_more(stages: dict[str, Stage]) -> None:
    assert "P7" not in broken(judged(stages["jaw"], lambda p: 2.0 * jaw_force(p)))
    assert "P7" in broken(judged(stages["jaw"], lambda p: 2.2 * jaw_force(p)))
    assert "P7" in broken(judged(stages["jaw"], lambda p: -jaw_force(p)))
    along = judged(stages["jaw"], lambda p: jaw_force(p) + 20.0 * LIFT)
    assert along.values()["jam_largest"] == pytest.approx(2.0 / 1.4, rel=0.3)
    assert "P7" in broken(judged(stages["jaw"], lambda p: jaw_force(p) + LIFT))


def test_thickness_of_an_overlap_is_its_depth(stages: dict[str, Stage]) -> None:
    pair = stages["floor"].pair
    pressed = pair.overlap(np.array([0.0, 0.0, 9.25, 1.0, 0.0, 0.0, 0.0]))
    assert pressed.thickness_mm == pytest.approx(0.75, abs=1e-5)
    assert pressed.volume_mm3 == pytest.approx(300.0, rel=1e-6)
    leaning = Rotation.from_euler("xyz", [0.0, 45.0, 45.0], degrees=True).as_quat()[[3, 0, 1, 2]]
    low = (ENDS @ to_matrix(leaning).T)[:, 2].min()
    edge = pair.overlap(np.array([0.0, 0.0, -low - 0.5, *leaning]))
    assert edge.thickness_mm == pytest.approx(0.5, abs=1e-3)
    assert pair.overlap(np.array([0.0, 0.0, 10.1, 1.0, 0.0, 0.0, 0.0])).volume_mm3 == 0.0


def test_distance_from_a_triangle_over_face_edge_and_corner() -> None:
    triangle = np.array([[[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]]])
    points = np.array([[1.0, 1.0, 2.0], [2.0, -3.0, 0.0], [-3.0, -4.0, 0.0], [3.0, 3.0, 0.0]])
    assert distances(points, triangle) == pytest.approx([2.0, 3.0, 5.0, np.sqrt(2.0)])


def test_crescent_of_a_ring_is_as_thick_as_the_ring_is_deep(meshes: Path) -> None:
    """Play of 0.2 mm, ring shifted by 0.5: some 0.3 mm of overlap, wrapped round the boss."""
    for name in ("boss", "ring"):
        (meshes / f"{name}.stl").write_bytes(make.stl_bytes(name, make.MESHES[name]()))
    scene = replace(CORNER, static="boss.stl", tool="ring.stl")
    found = Pair(*load_meshes(scene, meshes)).overlap(np.array([0.5, 0.0, 2.0, 1.0, 0.0, 0.0, 0.0]))
    assert found.thickness_mm == pytest.approx(0.3, abs=0.03)


def test_way_out_of_hulls_is_exact(stages: dict[str, Stage]) -> None:
    pair = stages["floor"].pair
    pose = np.array([0.0, 0.0, 9.0, 1.0, 0.0, 0.0, 0.0])
    assert pair.exit_mm(pose, np.array([0.0, 0.0, 1.0])) == pytest.approx(1.0, abs=1e-5)
    assert pair.exit_mm(pose, np.array([0.0, 0.6, 0.8])) == pytest.approx(1.25, abs=1e-5)


def test_jaw_is_jammed_and_the_cube_is_not(stages: dict[str, Stage]) -> None:
    for name, jammed in (("jaw", True), ("floor", False)):
        stage = stages[name]
        assert stage.pair.is_jammed(stage.poses[stage.at[3]], stage.overlaps[3]) is jammed


def test_refined_path_keeps_its_poses_and_divides_its_steps() -> None:
    poses = np.zeros((4, 7))
    poses[:, 0], poses[:, 3] = [0.0, 1.0, 3.0, 4.0], 1.0
    fine, is_part = refined(poses, np.array([1]), 4)
    assert fine[:, 0].tolist() == [0.0, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0]
    assert is_part.tolist() == [False, True, True, True, True, False]
    assert steps_mm(poses, np.zeros((1, 3))).tolist() == [1.0, 2.0, 1.0]


def test_numbers_without_a_bound_are_not_rated() -> None:
    assert not Finding("told", 3.0).rated
    assert Finding("kept", 1.0, 1.0).kept
    assert not Finding("nan", float("nan"), 1.0).kept


def test_csv_reads_back_as_the_tables(stages: dict[str, Stage]) -> None:
    rows = [
        judged(stages["corner"], corner_force),
        judged(stages["floor"], lambda p: 2.0 * floor_force(p)),
    ]
    records = read_csv(to_csv(rows))
    assert [r["scene"] for r in records] == ["corner", "floor"]
    assert records[1]["P1"] == "broken"
    assert "flat_error" in records[1]["breaks"].split()
    table = scene_table(records, "made up")
    assert table.rows[0][-1] == "none"
    assert "**100**" in table.rows[1]
    assert kept_share(records) == pytest.approx(12 / 14)
    assert summary_table(records).rows[0][0] == "made up"


def test_scenes_and_responses_are_chosen_by_name() -> None:
    table = load_scenes(TABLE)
    assert [s.name for s in choose_scenes(table, ["pads4"])] == ["pads1", "pads4"]
    assert len(choose_scenes(table, [])) == len(table)
    with pytest.raises(CreaseError, match="no scene none"):
        choose_scenes(table, ["none"])
    published = choose_responses(["published"], False)[0][1]
    assert (published.response, published.coverage) == ("extent", "hard")
    assert [name for name, _ in choose_responses([], True)] == ["way_out"]
    with pytest.raises(CreaseError, match="no response none"):
        choose_responses(["none"], False)


@pytest.mark.parametrize("text", ["[a]\nabout = 1\n", "not toml", "[a]\nunknown = 1\n"])
def test_bad_table_is_refused(tmp_path: Path, text: str) -> None:
    file = tmp_path / "scenes.toml"
    file.write_text(text)
    with pytest.raises(CreaseError, match="cannot be read"):
        load_scenes(file)


@pytest.mark.slow
def test_paths_of_the_table_begin_and_end_free_and_move_little(
    meshes: Path, tmp_path: Path
) -> None:
    """What P6 and P9 rest on; every mesh is closed, or `stl_bytes` reloaded would not be a solid."""
    for scene in load_scenes(TABLE).values():
        for name in (scene.static[:-4], scene.tool[:-4]):
            if not (file := tmp_path / f"{name}.stl").exists():
                file.write_bytes(make.stl_bytes(name, make.MESHES[name]()))
        (tmp_path / scene.path).write_bytes(make.csv_bytes(make.PATHS[scene.path[:-4]]()))
        rows = load_trajectory(tmp_path / scene.path).rows
        poses = np.column_stack([1e3 * rows[:, 1:4], rows[:, 4:]])
        pair = Pair(*load_meshes(scene, tmp_path))
        assert pair.volume(poses[0]) == 0.0, scene.name
        assert pair.volume(poses[-1]) == 0.0, scene.name
        assert steps_mm(poses, pair.tool_vertices).max() < 0.35, scene.name


@pytest.mark.slow
def test_command_judges_a_scene(tmp_path: Path, crease: Run) -> None:
    done = crease(
        "bench", "properties", "-o", tmp_path, "--quick", "--scenes", "rock_loop",
        "--table", TABLE, "--meshes", ROOT / "build" / "meshes", "--images", tmp_path,
    )  # fmt: skip
    assert done.status == 0, done.err
    assert "rock_loop" in done.out
    records = read_csv((tmp_path / "properties.csv").read_text())
    assert [(r["scene"], r["response"]) for r in records] == [("rock_loop", "way_out")]
    for name in ("properties.md", "properties.png", "properties_way_out.png"):
        assert (tmp_path / name).stat().st_size > 100


def test_shapes_that_others_rely_on_are_where_they_say() -> None:
    """A ball R 30 mm at SEAT_MM just touches the torus: its circle is 40 mm away."""
    assert np.hypot(30.0, property_shapes.SEAT_MM) == pytest.approx(40.0, abs=1e-3)


@pytest.mark.slow
def test_search_finds_what_the_path_does_not_meet(stages: dict[str, Stage]) -> None:
    """A strip beside the path, 1.5 mm wide, where the force is doubled."""

    def hidden(poses: F64) -> F64:
        strip = (poses[:, 1:2] > 1.4) & (poses[:, 1:2] < 2.9)
        return lowest_force(poses) * (1.0 + strip)

    stage = stages["floor"]
    assert broken(judged(stage, hidden, twin=floor_force)) == set()
    steep, far = search(stage, "made up", answered(hidden))
    assert steep.value > 10.0
    assert far.value == pytest.approx(0.5, abs=0.01)
    assert 1.4 < far.pose[1] < 2.9
    right = [w.value for w in search(stage, "made up", answered(lowest_force))]
    assert right[0] == pytest.approx(1.0, abs=1e-6)
