"""The benchmark: scenes and responses chosen, judged, and written as CSV, tables and figures."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from crease.base.errors import CreaseError
from crease.base.native import RESPONSES as KNOWN
from crease.base.table import write_bytes
from crease.lab.setup import Result, Table, machine
from crease.replay.replay import ReplayOptions

from study.against_exact import BenchSetup
from study.properties.answers import RESPONSES, asker
from study.properties.figures import SHOWN, draw_paths, draw_scenes, draw_time
from study.properties.geometry import F64, Pair
from study.properties.judge import QUICK, Effort, Row, judge_all, make_stage
from study.properties.libraries import judge_libraries
from study.properties.scenes import (
    PropertyScene,
    bake_digest,
    image_of,
    load_meshes,
    load_scenes,
)
from study.properties.search import SEARCHED, Worst, search
from study.properties.tables import markdown, read_csv, scene_table, summary_table, to_csv

CSV = "properties.csv"
MARKDOWN = "properties.md"
SEARCH_CSV = "search.csv"


def choose_scenes(table: dict[str, PropertyScene], names: Sequence[str]) -> list[PropertyScene]:
    """The named scenes, and before them those that they are compared with; all when none is named.

    Errors: CreaseError for a name that is not there.
    """
    if unknown := [name for name in names if name not in table]:
        raise CreaseError(f"no scene {', '.join(unknown)}; there are {', '.join(table)}")
    wanted = set(names or table)
    wanted |= {t for n in list(wanted) for t in (table[n].twin, table[n].exchanged) if t}
    return [scene for name, scene in table.items() if name in wanted]


def choose_responses(names: Sequence[str], quick: bool) -> list[tuple[str, ReplayOptions]]:
    """By name: one of RESPONSES, or any other response of the library. A quick look takes the first only.

    Errors: CreaseError.
    """
    default = dict(RESPONSES)
    known = {**{name: ReplayOptions(response=name) for name in KNOWN}, **default}
    if unknown := [name for name in names if name not in known]:
        raise CreaseError(f"no response {', '.join(unknown)}; there are {', '.join(known)}")
    chosen = names or list(default)[: 1 if quick else None]
    return [(name, known[name]) for name in chosen]


def run(setup: BenchSetup) -> Result:
    """Judge, and write what was found into setup.out.   Errors: CreaseError."""
    if setup.search:
        return run_search(setup)
    scenes = choose_scenes(load_scenes(setup.property_scenes), setup.scenes)
    responses = choose_responses(setup.responses, setup.quick)
    effort = QUICK if setup.quick else Effort(repeat=min(setup.repeat, 3))
    images = setup.images / "by_content"
    rows = list(
        judge_all(
            scenes,
            responses,
            setup.meshes,
            images,
            effort,
            lambda t: print(t, file=sys.stderr, flush=True),
        )
    )
    if setup.peers and setup.peers.is_dir():  # a file is for `pareto`
        rows += judge_libraries(scenes, setup.peers, setup.meshes, effort)
    result = Result(
        "properties",
        "Properties of the contact force",
        "P1 to P9 by booleans and planes, without a reference force; what breaks its bound stands in asterisks. "
        f"Machine: {machine()}.",
    )
    text = to_csv(rows)
    records = read_csv(text)
    names = list(dict.fromkeys(row.response for row in rows))
    tables = [summary_table(records), *(scene_table(records, name) for name in names)]
    result.tables += tables[: 2 if len(names) == 1 else 1]
    write_bytes(setup.out / CSV, text.encode())
    parts = "\n\n".join(f"## {table.caption}\n\n{markdown(table)}" for table in tables)
    write_bytes(setup.out / MARKDOWN, f"{parts}\n".encode())
    result.files += [CSV, MARKDOWN]
    draw(setup, result, rows, names)
    return result


def run_search(setup: BenchSetup) -> Result:
    """The worst poses near the paths of some scenes, as CSV and table.   Errors: CreaseError."""
    scenes = choose_scenes(load_scenes(setup.property_scenes), setup.scenes or SEARCHED)
    responses = choose_responses(setup.responses or RESPONSES[0][:1], setup.quick)
    found: list[Worst] = []
    code = bake_digest()
    for scene in scenes:
        bodies = load_meshes(scene, setup.meshes)
        stage = make_stage(scene, setup.meshes, Pair(*bodies), QUICK)
        image = image_of(scene, bodies, setup.images / "by_content", code)
        for name, options in responses:
            found += search(stage, name, asker(image, options))
    result = Result(
        "search",
        "Worst poses near the paths",
        "Random restarts round the path, the worst led on by shrinking steps. Amplification over 0.02 mm.",
    )
    heads = (
        "scene",
        "response",
        "measure",
        "worst",
        "asked",
        "x y z, mm; quaternion",
        "force / k, mm",
    )
    rows = [
        (
            w.scene,
            w.response,
            w.measure,
            f"{w.value:.3f}",
            str(w.asked),
            _numbers(w.pose),
            _numbers(w.force_mm),
        )
        for w in found
    ]
    result.tables.append(Table("Worst found", heads, tuple(rows)))
    lines = [",".join(heads).replace(", mm", "_mm"), *(",".join(row) for row in rows)]
    write_bytes(setup.out / SEARCH_CSV, ("\n".join(lines) + "\n").encode())
    result.files.append(SEARCH_CSV)
    return result


def _numbers(values: F64) -> str:
    """Separated by spaces, exact enough to ask again."""
    return " ".join(f"{v:.8g}" for v in values)


def draw(setup: BenchSetup, result: Result, rows: Sequence[Row], names: Sequence[str]) -> None:
    """A figure for each response, and one of run time against properties."""
    for name in names:
        mine = [row for row in rows if row.response == name]
        caption = "Each cell: value over bound. Blank: the scene does not ask."
        setup.write_figure(result, f"properties_{name}.png", draw_scenes(mine, name), caption)
    if (figure := draw_paths(rows, SHOWN)) is not None:
        setup.write_figure(
            result, "properties_paths.png", figure, "Size of the force along the path."
        )
    setup.write_figure(
        result,
        "properties.png",
        draw_time(read_csv(to_csv(rows))),
        "Up and left is better: more kept, in less time.",
    )
