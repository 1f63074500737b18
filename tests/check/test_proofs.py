"""The proofs of `make prove` can fail, and say what they are: each spoiled bound is found."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from proofs import ROOT, all_proofs, main, page_breach, prove, read_proof

SPOILED = [
    (
        "scene_cluster",
        "contact/scene.c",
        "c->piece[i] >= m->piece_count",
        "c->piece[i] > m->piece_count",
    ),
    ("servo_rx", "servo/servo.c", "s->frame_count >= CR_RX_MAX", "s->frame_count > CR_RX_MAX"),
    ("scene_sections", "contact/scene.c", "end > size_bytes)", "end > size_bytes + 64u)"),
    (
        "sdo_answer",
        "servo/sdo.c",
        "if (bus->sdo_step == step_count(",
        "if (bus->sdo_step == 1u + step_count(",
    ),
    (
        "scene_bricks",
        "contact/scene.c",
        "table > s->cell_count - b->cells",
        "table - 1u > s->cell_count - b->cells",
    ),
    (
        "record_config",
        "servo/config.c",
        "c->window > CR_WINDOW_MAX",
        "c->window > CR_WINDOW_MAX + 1u",
    ),
]
"""Proof, file, a bound of it, the same bound one too large."""


@pytest.mark.slow
@pytest.mark.parametrize(("name", "file", "bound", "spoiled"), SPOILED, ids=[s[0] for s in SPOILED])
def test_a_spoiled_bound_is_found(
    name: str, file: str, bound: str, spoiled: str, tmp_path: Path
) -> None:
    firmware = shutil.copytree(
        ROOT / "firmware", tmp_path / "firmware", ignore=shutil.ignore_patterns("*.png", "*.md")
    )
    text = (firmware / file).read_text("utf-8")
    assert text.count(bound) == 1
    (firmware / file).write_text(text.replace(bound, spoiled), "utf-8")
    (proof,) = (p for p in all_proofs() if p.name == name)
    found = prove(proof, firmware, 120.0).failed
    assert any(line.startswith("line ") for line in found), found


LOOP = """/* Proof    a loop over any count up to ten ends
 * Entry    none
 * Bounds   none
 * Unwind   {unwind} */
#include "prove.h"

int main(void) {{
    const uint32_t count = nondet_u32();
    uint8_t bytes[10];
    ASSUME(count <= {most}u);
    for (uint32_t i = 0; i < count; i++) {{
        bytes[i] = 0u;
    }}
    return 0;
}}
"""


@pytest.mark.parametrize(
    ("unwind", "most", "found"),
    [(11, 10, None), (9, 10, "unwinding assertion"), (12, 11, "array bounds")],
)
def test_a_loop_is_proved_whole_or_not_at_all(
    unwind: int, most: int, found: str | None, tmp_path: Path
) -> None:
    file = tmp_path / "loop.c"
    file.write_text(LOOP.format(unwind=unwind, most=most), "ascii")
    failed = prove(read_proof(file), limit_s=60.0).failed
    assert (found is None and not failed) or any(str(found) in line for line in failed)


def test_the_page_has_the_table_of_the_proofs() -> None:
    assert len(all_proofs()) >= 8
    assert page_breach() is None


def test_a_head_that_says_too_little_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mute.c").write_text("/* Proof    of nothing\n * Unwind   1 */\n", "ascii")
    with pytest.raises(ValueError, match=r"mute.c: its head does not say Bounds, Entry"):
        read_proof(tmp_path / "mute.c")


def test_a_proof_that_is_not_there_is_refused_in_one_line(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["--only", "of_fermat"]) == 2
    assert capsys.readouterr().err == "error: no proof of_fermat in tests/prove\n"


@pytest.mark.parametrize(
    "file", ["contact/scene.c", "servo/sdo.c", "servo/record.c", "servo/config.c"]
)
def test_no_float_becomes_an_integer_where_bytes_come_in(file: str) -> None:
    """ESBMC does not ask whether such a conversion is defined: there are none."""
    dump = ["clang", "-fsyntax-only", "-std=c11", "-Xclang", "-ast-dump", "-fno-color-diagnostics"]
    said = subprocess.run(
        [*dump, f"-I{ROOT / 'firmware'}", str(ROOT / "firmware" / file)],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    own = said[said.index("StaticAssert" if file == "servo/record.c" else "FunctionDecl") :]
    functions = re.split(r"\n(?=\|-FunctionDecl|`-FunctionDecl)", own)
    here = [f for f in functions if "math3.h" not in f.splitlines()[0]]
    assert "IntegralToFloating" in said or file != "contact/scene.c"
    assert [f.splitlines()[0][:160] for f in here if "FloatingToIntegral" in f] == []
