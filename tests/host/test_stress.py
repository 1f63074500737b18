"""The campaign: reproducible, resumable, the same on a cluster; its checks see what is wrong; and a short run of it."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import manifold3d
import numpy as np
import pytest
from crease.base.errors import CreaseError
from crease.base.native import ffi, skip_mask
from crease.lab.exact import Solids, exact_contact, exact_joined
from crease.replay.replay import ReplayOptions
from host_tools import Run
from stress import checks
from stress.campaign import TLS_FILES, Settings, chunk_file, read_reports, run_campaign, summarise
from stress.cases import KINDS, Place, run_case, touching
from stress.drift import ROW, run_drift
from stress.keep import keep
from stress.pool import Pair, quaternion_product, random_pair, to_frame
from stress.shrink import check_again, shrink_solids

SEED = 11
OPEN = frozenset({"continuity", "continuity where areas merge or part", "frame"})
"""Known limits (firmware/DESIGN.md): jumps. Everything else must hold without exception."""


@pytest.fixture(scope="session")
def pair() -> Pair:
    return random_pair((SEED, 0, 1))[0]


def same(a: dict[str, object], b: dict[str, object]) -> bool:
    """Reports but for their times."""
    timing = ("cpu_s", "bake_cpu_s", "seconds")
    return {k: v for k, v in a.items() if k not in timing} == {
        k: v for k, v in b.items() if k not in timing
    }


@pytest.mark.slow
def test_short_campaign_finds_no_violation_but_known_jumps(tmp_path: Path) -> None:
    settings = Settings(seed=SEED, cases=600, per_chunk=600, scenes=3)
    summary = summarise(run_campaign(tmp_path, settings))
    assert summary["cases"] == 600
    assert all(kind["cases"] > 5 for kind in summary["kinds"].values())
    assert set(summary["violations_by_check"]) <= OPEN
    assert summary["violations"] <= 0.03 * summary["cases"]
    contacts = sum(kind["contacts"] for kind in summary["kinds"].values())
    assert contacts > 0.3 * summary["ticks"]


@pytest.mark.slow
def test_a_campaign_is_taken_up_where_it_stopped(tmp_path: Path) -> None:
    settings = Settings(seed=SEED, cases=20, per_chunk=10, scenes=1)
    whole = run_campaign(tmp_path / "a", settings)
    run_campaign(tmp_path / "b", replace(settings, cases=10))
    first = chunk_file(tmp_path / "b", 0).stat().st_mtime_ns
    chunk_file(tmp_path / "b", 1).write_text("half a fi")
    parts = run_campaign(tmp_path / "b", settings)
    assert chunk_file(tmp_path / "b", 0).stat().st_mtime_ns == first
    assert len(whole) == len(parts) == 2
    assert all(same(a, b) for a, b in zip(whole, parts, strict=True))
    assert len(read_reports(tmp_path / "b", settings)) == 2
    with pytest.raises(CreaseError, match=f"another folder, or give --seed {SEED}"):
        run_campaign(tmp_path / "b", replace(settings, seed=SEED + 1))


def test_a_folder_of_another_campaign_is_told_with_what_differs(tmp_path: Path) -> None:
    file = tmp_path / "campaign.json"
    file.write_text('{"seed": 1, "per_chunk": 10, "scenes": 2}')
    with pytest.raises(CreaseError, match=r"name another folder, or give --scenes 2$"):
        run_campaign(tmp_path, Settings(seed=1, cases=10, per_chunk=10, scenes=3))
    for text in ("x", "[]", "{}", "3"):
        file.write_text(text)
        with pytest.raises(CreaseError, match=r"campaign\.json: is not of a campaign"):
            run_campaign(tmp_path, Settings(seed=1, cases=10, per_chunk=10, scenes=3))


@pytest.mark.parametrize(
    "words",
    [
        ("--cases", "10"),
        ("--seed", "2"),
        ("--per-chunk", "10"),
        ("--scenes", "2"),
        ("--shrink", "1"),
        ("--scheduler", "tcp://127.0.0.1:1"),
        ("--drift", "10"),
    ],
)
def test_the_closed_loop_refuses_options_of_random_cases(
    crease: Run, tmp_path: Path, words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("crease.verbs.stress._closed_loop", lambda _: None)
    said = crease("stress", "-o", tmp_path / "out", "--closed-loop", "--quick", *words)
    assert said.status == 2
    assert f"error: {words[0]} is of random cases; leave it out with --closed-loop" in said.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("words", [("--quick",), ("--tls", "here")])
def test_options_of_another_campaign_are_refused(
    crease: Run, tmp_path: Path, words: tuple[str, ...]
) -> None:
    assert crease("stress", "-o", tmp_path / "out", "--cases", "1", *words).status == 2
    assert not (tmp_path / "out").exists()


@pytest.fixture
def tls(tmp_path: Path) -> Path:
    """Certificates of a cluster: one key that signs itself, for all of it."""
    folder = tmp_path / "tls"
    folder.mkdir()
    words = "openssl req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=cluster -keyout key.pem -out cert.pem"
    subprocess.run(words.split(), cwd=folder, check=True, capture_output=True)
    shutil.copy(folder / "cert.pem", folder / "ca.pem")
    return folder


@contextmanager
def two_workers(folder: Path, *words: str) -> Iterator[str]:
    """The programs of Dask, a scheduler and two workers of one thread, each in a process; gives the address."""
    dask, file = Path(sys.executable).with_name("dask"), folder / "scheduler.json"
    log = (folder / "dask.log").open("w")
    common = ["--scheduler-file", file, *words, "--no-dashboard"]
    commands = [[dask, "scheduler", "--host", "127.0.0.1", "--port", "0", *common]]
    commands += 2 * [[dask, "worker", "--nthreads", "1", "--no-nanny", *common]]
    running = [
        subprocess.Popen([*map(str, c)], stdout=log, stderr=log, cwd=folder) for c in commands
    ]
    try:
        end_s = time.monotonic() + 60
        while not file.exists() or not file.read_text():
            assert time.monotonic() < end_s, (folder / "dask.log").read_text()
            time.sleep(0.1)
        yield str(json.loads(file.read_text())["address"])
    finally:
        for process in running:
            process.kill()
            process.wait()
        log.close()


def stress_table(folder: Path, *words: str) -> dict[str, Any]:
    """summary.json of a small campaign by the command, without times and what is run besides."""
    options = f"--cases 8 --per-chunk 2 --scenes 1 --shrink 0 --drift 1000 --seed {SEED}".split()
    command = [sys.executable, "-m", "crease", "stress", "-o", str(folder), *options, *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (folder / "summary.json").exists(), done.stderr
    table: dict[str, Any] = json.loads((folder / "summary.json").read_text())
    return {k: v for k, v in table.items() if k not in ("seconds", "cpu_s", "bake_cpu_s", "drift")}


@pytest.mark.slow
def test_two_dask_workers_processes_and_one_process_give_the_same_table(
    tmp_path: Path, tls: Path
) -> None:
    here = stress_table(tmp_path / "here")
    assert here["cases"] == 8
    assert stress_table(tmp_path / "pool", "--jobs", "2") == here
    with two_workers(tmp_path) as address:
        assert address.startswith("tcp://")
        assert stress_table(tmp_path / "dask", "--scheduler", address) == here
    ca, cert, key = (str(tls / name) for name in TLS_FILES)
    files = ("--tls-ca-file", ca, "--tls-cert", cert, "--tls-key", key)
    with two_workers(tls, "--protocol", "tls", *files) as address:
        assert address.startswith("tls://")
        at = ("--scheduler", address, "--tls", str(tls))
        assert stress_table(tmp_path / "encrypted", *at) == here


@pytest.mark.slow
def test_what_a_cluster_at_tls_needs_is_said(tmp_path: Path, tls: Path) -> None:
    settings = Settings(1, 5, 5)
    for address, folder in (("tls://127.0.0.1:1", None), ("tcp://127.0.0.1:1", tls)):
        with pytest.raises(CreaseError, match="belong together"):
            run_campaign(tmp_path / "a", settings, scheduler=address, tls=folder)
    (tls / "key.pem").unlink()
    with pytest.raises(CreaseError, match=r"key\.pem not there"):
        run_campaign(tmp_path / "a", settings, scheduler="tls://127.0.0.1:1", tls=tls)


@pytest.mark.slow
def test_a_scheduler_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(CreaseError, match="no answer"):
        run_campaign(tmp_path, Settings(1, 5, 5), scheduler="tcp://127.0.0.1:1")


@pytest.mark.slow
def test_cases_are_the_same_for_the_same_seed(pair: Pair) -> None:
    for case in range(12):
        one, two = (run_case((SEED, 0, case), [pair]) for _ in range(2))
        assert one[0] == two[0]
        assert one[2].numbers == two[2].numbers
        assert one[2].ticks == two[2].ticks


def test_checks_see_wrong_answers(pair: Pair) -> None:
    rng = np.random.default_rng(SEED)
    poses = touching(rng, pair, 40, -3e-3, -1e-3)
    options = ReplayOptions()
    good = checks.answer(pair.here, poses, options)
    assert checks.sound(good, poses, options) is None
    wrong = {
        "not finite": ("force_N", np.nan),
        "above its limit": ("force_N", 100.1),
        "negative depth": ("depth_m", -1e-9),
        "a fault": ("faults", 1),
    }
    for text, (column, value) in wrong.items():
        rows = good.copy()
        rows[column][7] = value
        bad = checks.sound(rows, poses, options)
        assert bad is not None
        assert text in bad.text
        assert len(bad.poses) == 8
    rows = good.copy()
    rows["depth_m"][3] = 1.0
    assert checks.bounded(pair.here, rows, poses, options) is not None
    rows["depth_m"][3] = (
        1.1 * 2.0 * pair.here.scene.meta.tool_radius_m
    )  # swallowed by more than it is long itself
    assert checks.bounded(pair.here, rows, poses, options) is None
    assert checks.bounded(pair.here, rows, poses, replace(options, response="extent")) is not None
    away = poses + np.array([0, 0, 0.3, 0, 0, 0, 0])
    far = checks.answer(pair.here, away, options)
    assert checks.free(pair, pair.here, far, away, options, 1) is None
    far["force_N"][5] = (0, 0, 1)
    assert checks.free(pair, pair.here, far, away, options, 1) is not None
    near = touching(rng, pair, 200, 4e-3, 5e-3)
    apart = checks.answer(pair.here, near, options)
    silent = ~apart["force_N"].any(axis=1)
    apart["force_N"][silent] = (0, 0, 1)
    apart["depth_m"][silent] = 1e-6
    assert checks.free(pair, pair.here, apart, near, options, 200) is not None


@pytest.mark.slow
def test_continuity_sees_a_jump_and_not_a_slope() -> None:
    """Of extent: hard coverage jumps by whole samples; soft coverage seldom does."""
    hard = soft = 0
    pairs = [random_pair((SEED, 1, seed))[0] for seed in (0, 20)]
    for seed in range(40):
        made = pairs[seed // 20]
        rng = np.random.default_rng((SEED, 2, seed))
        way = np.linspace(0, 2e-3, 24)[:, None] * np.array([0.6, 0.0, 0.8])
        start = touching(rng, made, 1, -2e-3, -1e-3)
        poses = np.hstack([start[:, :3] + way, np.tile(start[:, 3:], (24, 1))])
        for coverage in ("hard", "soft"):
            options = ReplayOptions(response="extent", coverage=coverage)
            jump_m = checks.continuity(made, made.here, poses, options)[1]
            jumps = jump_m > 0.05 * made.here.spacing_m
            hard += jumps and coverage == "hard"
            soft += jumps and coverage == "soft"
    assert hard > 2 * soft


def test_a_reproducer_replays(crease: Run, pair: Pair, tmp_path: Path) -> None:
    poses = touching(np.random.default_rng(SEED), pair, 3, -3e-3, -1e-3)
    options = ReplayOptions(stiffness_N_m=500.0)
    bad = checks.Violation("frame", "made up", 1.0, 0.5, poses, options)
    own = keep(tmp_path, (1, 2, 3), "frame", Place(pair, pair.there), bad)
    report = json.loads((own / "case.json").read_text(encoding="utf-8"))
    assert len(report["replay"]) == 2
    expected = checks.answer(pair.there, poses, options)["force_N"]
    words = report["replay"][0].split()
    assert words[:2] == ["crease", "replay"]
    words[words.index("scene.crs")] = str(own / "scene.crs")
    words[words.index("scene.csv")] = str(own / "scene.csv")
    words[words.index("scene-out.csv")] = str(own / "out.csv")
    assert crease(*words[1:]).status == 0
    table = np.genfromtxt(own / "out.csv", delimiter=",", names=True)
    found = np.column_stack([table[f"f{a}_N"] for a in "xyz"])
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())


def test_settings_of_a_violation_are_in_its_commands(pair: Pair, tmp_path: Path) -> None:
    poses = touching(np.random.default_rng(SEED), pair, 2, -3e-3, -1e-3)
    options = ReplayOptions(force_max_N=0.5, skip=skip_mask(["top", "tree"]))
    bad = checks.Violation("skipping", "made up", 1.0, 0.5, poses, options)
    own = keep(tmp_path, (1, 2, 4), "skips", Place(pair, pair.here), bad)
    report = json.loads((own / "case.json").read_text(encoding="utf-8"))
    first, second = report["replay"]
    assert "--force-max 0.5 --skips top,tree" in first
    assert "--force-max 0.5" in second
    assert "--skips" not in second


def test_replay_takes_a_force_limit_and_skips(crease: Run, pair: Pair, tmp_path: Path) -> None:
    poses = touching(np.random.default_rng(SEED), pair, 20, -3e-3, -2e-3)
    bad = checks.Violation("sound", "made up", 1.0, 0.5, poses, ReplayOptions())
    own = keep(tmp_path, (1, 2, 5), "near", Place(pair, pair.here), bad)
    tables = []
    for number, words in enumerate(((), ("--skips", "none"), ("--force-max", "0.25"))):
        out = tmp_path / f"{number}.csv"
        assert crease("replay", own / "scene.crs", own / "scene.csv", "-o", out, *words).status == 0
        tables.append(np.genfromtxt(out, delimiter=",", names=True))
    plain, unskipped, limited = (
        np.linalg.norm([table[f"f{a}_N"] for a in "xyz"], axis=0) for table in tables
    )
    assert (plain == unskipped).all()
    assert tables[0]["nodes"].sum() != tables[1]["nodes"].sum()
    np.testing.assert_allclose(limited, np.minimum(plain, 0.25), rtol=1e-5)
    assert plain.max() > 0.25
    wrong = crease("replay", own / "scene.crs", own / "scene.csv", "-o", out, "--skips", "tops")
    assert wrong.status == 2
    assert "'tops' is no skip" in wrong.err


@pytest.mark.slow
def test_solids_shrink_while_the_violation_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    """With no depth allowed, any contact is a violation: most of both solids can go."""
    made = random_pair((SEED, 0, 1))[0]
    poses = touching(np.random.default_rng(SEED), made, 1, -3e-3, -2e-3)

    def felt(
        rows: checks.Rows, poses: checks.F64, options: ReplayOptions
    ) -> checks.Violation | None:
        force_N = float(np.linalg.norm(rows["force_N"], axis=1).max())
        return checks.Violation("sound", "felt", force_N, 0.0, poses, options) if force_N else None

    monkeypatch.setattr(checks, "sound", felt)
    rows = checks.answer(made.here, poses, ReplayOptions())
    bad = felt(rows, poses, ReplayOptions())
    assert bad is not None
    place, least = shrink_solids(Place(made, made.here), bad, 5.0)
    before, after = (
        sum(s.num_tri() for s in (p.solids.static, p.solids.tool)) for p in (made, place.pair)
    )
    assert after < before
    assert (least.poses == bad.poses).all()
    assert check_again(place, least.poses, least.options, least.check) is not None
    same_place, same_bad = shrink_solids(Place(made, made.here), bad, 0.0)
    assert same_place.pair is made
    assert same_bad is bad


def test_joined_pieces_answer_as_one() -> None:
    """Two feet of 6 mm, 4 mm apart, 1 mm and 2 mm deep in a wall: 1 + 2 mm apart, 2 mm as one."""
    wall = manifold3d.Manifold.cube((0.1, 0.1, 0.02)).translate((-0.05, -0.05, -0.02))
    foot = manifold3d.Manifold.cube((6e-3, 6e-3, 10e-3))
    feet = foot.translate((-8e-3, 0, -1e-3)) + foot.translate((2e-3, 0, -2e-3))
    feet += manifold3d.Manifold.cube((16e-3, 6e-3, 4e-3)).translate((-8e-3, 0, 6e-3))
    solids = Solids(wall.as_original(), feet.as_original())
    pose = np.array([0.0, 0, 0, 1, 0, 0, 0])
    np.testing.assert_allclose(exact_contact(solids, pose)[0], (0, 0, 3e-3), atol=1e-9)
    np.testing.assert_allclose(exact_joined(solids, pose, 3.9e-3), (0, 0, 3e-3), atol=1e-9)
    np.testing.assert_allclose(exact_joined(solids, pose, 4.1e-3), (0, 0, 2e-3), atol=1e-9)


def test_frames_keep_distances(pair: Pair) -> None:
    poses = touching(np.random.default_rng(SEED), pair, 5, -1e-3, 1e-3)
    moved = to_frame(pair.there.frame, poses)
    gaps = np.linalg.norm(np.diff(moved[:, :3], axis=0), axis=1) / pair.there.frame.scale
    np.testing.assert_allclose(gaps, np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1))
    identity = quaternion_product(pair.there.frame.quaternion, np.array([1.0, 0, 0, 0]))
    np.testing.assert_allclose(identity, pair.there.frame.quaternion)


def test_kinds_share_all_cases() -> None:
    assert sum(share for _, share in KINDS.values()) == pytest.approx(1.0)


@pytest.mark.slow
def test_quaternion_drift_over_a_short_run() -> None:
    assert ROW.itemsize == ffi.sizeof("cr_drift_row")
    kept, left = run_drift(SEED, 100_000, True, 200), run_drift(SEED, 100_000, False, 200)
    assert kept.failed == left.failed == ()
    assert kept.in_contact > 20
    assert abs(kept.norm_last - 1) < 1e-6


@pytest.mark.slow
def test_the_verb_reports_and_fails_on_violations(crease: Run, tmp_path: Path) -> None:
    words = (
        "stress",
        "-o",
        str(tmp_path / "s"),
        "--cases",
        "40",
        "--per-chunk",
        "40",
        "--scenes",
        "1",
    )
    done = crease(*words, "--seed", "5", "--drift", "1000", "--json")
    summary = json.loads(done.out)
    assert summary["cases"] == 40
    assert done.status == (1 if summary["violations"] else 0)
    assert crease("stress", "-o", tmp_path, "--cases", "0").status == 2
