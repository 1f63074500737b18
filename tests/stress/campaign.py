"""A campaign: chunks of cases, each a file of its own, so that it can be stopped and taken up again anywhere."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from crease.base.errors import CreaseError
from crease.base.table import write_bytes
from crease.base.tree import call_in_tree

from stress.cases import KINDS, Found, Place, run_case
from stress.checks import Violation
from stress.keep import keep
from stress.pool import random_pair
from stress.shrink import shrink_poses, shrink_solids

SCENE_SEED = 1_000_000
"""Scenes of a chunk have case numbers from here on."""

KEPT_PER_CHECK = 1
"""Reproducers of a check that one chunk writes: an image each."""

SHRINK_S = 2.0

SETTINGS = "campaign.json"


@dataclass(frozen=True)
class Settings:
    """What a campaign is: the same settings give the same cases."""

    seed: int
    cases: int
    per_chunk: int
    scenes: int = 4
    """Scenes that the cases of a chunk share."""
    shrink_s: float = SHRINK_S
    """Processor time to simplify the solids of one reproducer."""

    @property
    def chunks(self) -> int:
        """How many files."""
        return -(-self.cases // self.per_chunk)

    def size(self, chunk: int) -> int:
        """Cases of a chunk."""
        return min(self.per_chunk, self.cases - chunk * self.per_chunk)


def chunk_file(folder: Path, chunk: int) -> Path:
    """Where a chunk's report lies."""
    return folder / "chunks" / f"{chunk:06d}.json"


def run_chunk(folder: Path, settings: Settings, chunk: int) -> dict[str, Any]:
    """Bake the scenes of a chunk, run its cases, write its report.   Output: the report.   Errors: CreaseError."""
    start_s, cpu_s = time.perf_counter(), time.process_time()
    made = [random_pair((settings.seed, chunk, SCENE_SEED + i)) for i in range(settings.scenes)]
    pairs = [pair for pair, _ in made]
    bake_s = time.process_time() - cpu_s
    kinds = {kind: {"cases": 0, "ticks": 0, "contacts": 0} for kind in KINDS}
    numbers: dict[str, list[float]] = {}
    violations: list[dict[str, Any]] = []
    kept: dict[str, int] = {}
    for case in range(settings.size(chunk)):
        seed = (settings.seed, chunk, case)
        kind, place, found = run_case(seed, pairs)
        _count(kinds[kind], found)
        for name, value in found.numbers.items():
            numbers.setdefault(name, []).append(value)
        if found.violation:
            bad = shrink_poses(place, found.violation)
            kept[bad.check] = kept.get(bad.check, 0) + 1
            reproducer = ""
            if kept[bad.check] <= KEPT_PER_CHECK:
                least = shrink_solids(place, bad, settings.shrink_s)
                reproducer = keep(folder / "violations", seed, kind, *least).name
            violations.append(_entry(seed, kind, place, bad, reproducer))
    report = {
        "chunk": chunk,
        "cases": settings.size(chunk),
        "scenes": [pair.name for pair in pairs],
        "meshes_refused": sum(refused for _, refused in made),
        "kinds": kinds,
        "numbers": {k: [float(f"{v:.6g}") for v in values] for k, values in numbers.items()},
        "violations": violations,
        "bake_cpu_s": round(bake_s, 3),
        "cpu_s": round(time.process_time() - cpu_s, 3),
        "seconds": round(time.perf_counter() - start_s, 3),
    }
    write_bytes(chunk_file(folder, chunk), (json.dumps(report) + "\n").encode())
    return report


def _count(kind: dict[str, int], found: Found) -> None:
    kind["cases"] += 1
    kind["ticks"] += found.ticks
    kind["contacts"] += found.contacts


def _entry(
    seed: tuple[int, ...], kind: str, place: Place, bad: Violation, reproducer: str
) -> dict[str, Any]:
    return {
        "case": list(seed),
        "kind": kind,
        "scene": place.pair.name,
        "convex": place.pair.convex,
        "check": bad.check,
        "text": bad.text,
        "value": bad.value,
        "bound": bad.bound,
        "options": asdict(bad.options),
        "reproducer": reproducer,
    }


def open_campaign(folder: Path, settings: Settings) -> list[int]:
    """Make the folder, or take up what is there.

    Output: chunks still to do.   Errors: CreaseError when the folder holds another campaign.
    """
    file = folder / SETTINGS
    try:
        (folder / "chunks").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CreaseError(f"{folder}: cannot be made: {error.strerror}") from error
    if file.exists():
        ours = asdict(settings)
        try:
            there = json.loads(file.read_text(encoding="utf-8"))
            others = [key for key in ("seed", "per_chunk", "scenes") if there[key] != ours[key]]
        except (OSError, ValueError, LookupError, TypeError) as error:
            raise CreaseError(f"{file}: is not of a campaign; name another folder") from error
        if others:
            same = " ".join(f"--{key.replace('_', '-')} {there[key]}" for key in others)
            raise CreaseError(
                f"{folder}: holds another campaign; name another folder, or give {same}"
            )
    write_bytes(file, (json.dumps(asdict(settings)) + "\n").encode())
    return [c for c in range(settings.chunks) if _done(folder, settings, c) is None]


def _done(folder: Path, settings: Settings, chunk: int) -> dict[str, Any] | None:
    """The report of a chunk that is there and of the right size."""
    try:
        report: dict[str, Any] = json.loads(chunk_file(folder, chunk).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return report if report.get("cases") == settings.size(chunk) else None


def run_chunk_of(folder: str, settings: dict[str, Any], chunk: int) -> dict[str, Any]:
    """`run_chunk` from plain values."""
    return run_chunk(Path(folder), Settings(**settings), chunk)


def read_reports(folder: Path, settings: Settings) -> list[dict[str, Any]]:
    """The reports that are there, in order."""
    found = (_done(folder, settings, chunk) for chunk in range(settings.chunks))
    return [report for report in found if report is not None]


def _serial(
    folder: Path, settings: Settings, todo: list[int], _jobs: int
) -> Iterator[dict[str, Any]]:
    for chunk in todo:
        yield run_chunk(folder, settings, chunk)


def _pool(folder: Path, settings: Settings, todo: list[int], jobs: int) -> Iterator[dict[str, Any]]:
    from concurrent.futures import ProcessPoolExecutor, as_completed
    from multiprocessing import get_context

    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        waiting = [pool.submit(run_chunk, folder, settings, chunk) for chunk in todo]
        try:
            for done in as_completed(waiting):
                yield done.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


TLS_FILES = ("ca.pem", "cert.pem", "key.pem")


def _security(scheduler: str, tls: Path | None) -> Any:
    """What a client at tls:// shows and asks for; None at tcp://.   Errors: CreaseError."""
    from distributed.security import Security

    if scheduler.startswith("tls://") != (tls is not None):
        raise CreaseError(
            f"--scheduler {scheduler}: --tls DIR and an address tls://... belong together"
        )
    if tls is None:
        return None
    missing = [name for name in TLS_FILES if not (tls / name).is_file()]
    if missing:
        raise CreaseError(
            f"--tls {tls}: {', '.join(missing)} not there; it needs {', '.join(TLS_FILES)}"
        )
    ca, cert, key = (str(tls / name) for name in TLS_FILES)
    return Security(
        tls_ca_file=ca, tls_client_cert=cert, tls_client_key=key, require_encryption=True
    )


def _dask(
    folder: Path, settings: Settings, todo: list[int], scheduler: str, tls: Path | None
) -> Iterator[dict[str, Any]]:
    """On a cluster that is there already. Its workers see `folder` under the same path."""
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        raise CreaseError("--scheduler needs Dask: pip install 'crease[dask]'") from error
    security = _security(scheduler, tls)
    try:
        client: Any = Client(scheduler, timeout=10, security=security)
    except (OSError, ValueError) as error:
        raise CreaseError(f"--scheduler {scheduler}: no answer: {error}") from error
    with client:
        # Workers need not have this module on their path: they are sent nothing that it defines.
        words = ["stress.campaign", "run_chunk_of", str(folder), asdict(settings)]
        waiting = client.map(
            call_in_tree, *([word] * len(todo) for word in words), todo, pure=False
        )
        for done in as_completed(waiting):
            yield done.result()


def run_campaign(
    folder: Path,
    settings: Settings,
    jobs: int = 1,
    scheduler: str | None = None,
    progress: Callable[[float], None] = lambda _: None,
    tls: Path | None = None,
) -> list[dict[str, Any]]:
    """Run what is still to do.   Output: the reports of all chunks.   Errors: CreaseError.

    scheduler: of a Dask cluster, instead of jobs. tls: folder with TLS_FILES, when it is at tls://.
    """
    folder = folder.absolute()
    todo = open_campaign(folder, settings)
    if scheduler:
        running = _dask(folder, settings, todo, scheduler, tls)
    else:
        running = (_serial if jobs == 1 else _pool)(folder, settings, todo, jobs)
    for count, _ in enumerate(running, settings.chunks - len(todo) + 1):
        progress(count / settings.chunks)
    return read_reports(folder, settings)


def summarise(reports: list[dict[str, Any]]) -> dict[str, Any]:
    """Counts over all chunks; violations by check, scene kind and convexity; spread of the numbers."""
    kinds = {k: {n: sum(r["kinds"][k][n] for r in reports) for n in ("cases", "ticks", "contacts")}
             for k in KINDS}  # fmt: skip
    violations = [v for r in reports for v in r["violations"]]
    by_check: dict[str, int] = {}
    for v in violations:
        by_check[v["check"]] = by_check.get(v["check"], 0) + 1
    numbers: dict[str, dict[str, float]] = {}
    for name in sorted({n for r in reports for n in r["numbers"]}):
        values = np.concatenate([r["numbers"].get(name, []) for r in reports])
        p50, p99, p999 = (float(v) for v in np.percentile(values, [50, 99, 99.9]))
        numbers[name] = {"p50": p50, "p99": p99, "p99.9": p999, "max": float(values.max())}
    return {
        "cases": sum(r["cases"] for r in reports),
        "scenes": 2 * sum(len(r["scenes"]) for r in reports),
        "meshes_refused": sum(r["meshes_refused"] for r in reports),
        "ticks": sum(k["ticks"] for k in kinds.values()),
        "kinds": kinds,
        "violations": len(violations),
        "violations_by_check": by_check,
        "numbers": numbers,
        "cpu_s": round(sum(r["cpu_s"] for r in reports), 1),
        "bake_cpu_s": round(sum(r["bake_cpu_s"] for r in reports), 1),
    }
