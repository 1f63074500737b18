"""Of hand-made code the bound is what is counted by hand; what has none is said. Run by `make wcet`: it compiles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from flow import output_of
from longest import BoundError, Code, NamedLoop, Programme, read
from wcet import Constants, Table

EIGHT_TIMES = """
    push {r4, lr}       @ 1
    movs r4, #8         @ 1
1:  cbz r0, 2f          @ 8
    bl leaf             @ 8 and 2 each
    b 3f                @ 8
2:  nop
3:  subs r4, #1         @ 8
    bne 1b              @ 8
    pop {r4, pc}        @ 1
"""
"""The longest path through it: 3 + 8 (5 + 2), by the call each time."""
TABLE_JUMP = """
    tbb [pc, r0]
    .byte 1, 1
    bx lr
"""
TWO_ENTRIES = """
    movs r1, #4         @ 1
    cbz r0, 2f          @ 1
1:  nop                 @ 1 each time
2:  subs r1, #1         @ 1 each time
    bne 1b              @ 1 each time
    bx lr               @ 1
"""
TESTS_FIRST = """
    movs r1, #8         @ 1
1:  subs r1, #1         @ 1 each time, and once more
    bmi 2f              @ 1 each time, and once more
    ldr r2, [r0]        @ 1 each time
    b 1b                @ 1 each time
2:  bx lr               @ 1
"""
NESTED = """
int sum(const int *of, int rows, volatile int *to);
int sum(const int *of, int rows, volatile int *to) {
    int all = 0;
    for (int i = 0; i < 16; i++) {
        *to = i;
        for (int k = 0; k < rows; k++) {
            *to = of[k];
        }
    }
    while (*to > 3) {
        all++;
    }
    return all;
}
"""
SMALL: dict[str, Any] = {
    "stages": {},
    "bound": [
        {"most": "CR_LANES", "loops": ["sum: i < 16"]},
        {"most": 4, "loops": ["sum: k < rows"]},
        {"most": 2, "loops": ["sum: *to > 3"]},
    ],
}


def linked(folder: Path, source: str, text: str, root: str) -> Path:
    """A program of one source."""
    file, program = folder / source, folder / "program.elf"
    file.write_text(text, encoding="ascii")
    words = ["arm-none-eabi-gcc", "-mcpu=cortex-m7", "-mthumb", "-O2", "-g", "-nostdlib"]
    output_of([*words, f"-Wl,-e,{root}", file, "-o", program])
    return program


def assembled(folder: Path, body: str) -> Code:
    """The function `hand`, and `leaf` of two instructions."""
    head = "    .syntax unified\n    .thumb\n    .cpu cortex-m7\n"
    functions = "".join(
        f"    .global {name}\n    .type {name}, %function\n{name}:{code}\n"
        for name, code in (("hand", body), ("leaf", "\n    adds r0, #0\n    bx lr\n"))
    )
    return read(linked(folder, "hand.s", head + functions, "hand"), ["hand"])


def programme(code: Code, root: str, most: float) -> Programme:
    """With one bound for all loops."""

    def bound(_loop: NamedLoop, _copy: tuple[str, str]) -> float:
        return most

    return Programme(code, root, {}, bound)


def test_bound_of_a_loop_with_a_call_is_what_is_counted_by_hand(tmp_path: Path) -> None:
    code = assembled(tmp_path, EIGHT_TIMES)
    assert programme(code, "hand", 8).longest().instructions == 3 + 8 * (5 + 2)


def test_fact_bounds_the_way_that_is_longer(tmp_path: Path) -> None:
    """Three times by the call, five by the other way."""
    made = programme(assembled(tmp_path, EIGHT_TIMES), "hand", 8)
    made.at_most({"call hand > leaf": 1.0}, 3.0)
    assert made.longest().instructions == 3 + 3 * (5 + 2) + 5 * 4


def test_fact_of_a_place_that_is_nowhere_is_said(tmp_path: Path) -> None:
    made = programme(assembled(tmp_path, EIGHT_TIMES), "hand", 8)
    for place in ("call hand > twig", "enter twig", "loop twig", "lanes twig", "sometimes hand"):
        with pytest.raises(BoundError, match=r"nothing of the code|sometimes"):
            made.at_most({place: 1.0}, 3.0)


def test_what_ran_more_often_than_its_bound_is_said(tmp_path: Path) -> None:
    code = assembled(tmp_path, EIGHT_TIMES)
    block = code.functions["hand"].blocks
    start, loop, call, other, end, out = sorted(block)
    leaf = code.functions["leaf"].entry
    ran = {start: 1, loop: 8, call: 8, other: 0, end: 8, out: 1, leaf: 8}
    assert programme(code, "hand", 8).broken(ran, 1, {"enter leaf": 1.0}, 8.0) == []
    (line,) = programme(code, "hand", 7).broken(ran, 1, {"enter leaf": 1.0}, 8.0)
    assert "at most 7: 1.0 too many" in line
    (line,) = programme(code, "hand", 8).broken(ran, 1, {"enter leaf": 1.0}, 6.0)
    assert "at most 6: 2.0 too many" in line


def test_loop_that_is_entered_in_two_places_is_bounded(tmp_path: Path) -> None:
    """One part of it may run once more than its body does, and the other, where it is entered, once more than that."""
    code = assembled(tmp_path, TWO_ENTRIES)
    assert programme(code, "hand", 4).longest().instructions == 3 + 5 + 2 * 6


def test_fact_of_a_loop_that_tests_first_is_of_its_body(tmp_path: Path) -> None:
    """Five bodies and six tests: when the sixth counted, the path would be too short."""
    made = programme(assembled(tmp_path, TESTS_FIRST), "hand", 8)
    assert made.longest().instructions == 1 + 9 * 2 + 8 * 2 + 1
    made.at_most({"loop hand/library": 1.0}, 5.0)
    assert made.longest().instructions == 1 + 6 * 2 + 5 * 2 + 1


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("\n    push {lr}\n    blx r3\n    pop {pc}\n", "call through a pointer"),
        ("\n    bx r3\n", "jump through a register"),
        ("\n    mov pc, r3\n", "jump through a register"),
        (TABLE_JUMP, "jump through a table"),
    ],
)
def test_code_that_cannot_be_followed_is_said(body: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(BoundError, match=said):
        assembled(tmp_path, body)


def test_recursion_has_no_longest_path(tmp_path: Path) -> None:
    code = assembled(tmp_path, "\n    push {lr}\n    cbz r0, 1f\n    bl hand\n1:  pop {pc}\n")
    with pytest.raises(BoundError, match="no longest path"):
        programme(code, "hand", 8).longest()


def test_loops_are_named_by_their_tests_and_bounded_by_the_table(tmp_path: Path) -> None:
    code = read(linked(tmp_path, "sum.c", NESTED, "sum"), ["sum"])
    table = Table(SMALL)
    table.check(code)
    made = table.programme(code, "sum", Constants())
    runs = made.longest().counts
    heads = {loop.name.rpartition(" #")[0]: loop.loop.head for loop in code.loops}
    most = {"sum: i < 16": 16, "sum: k < rows": 16 * 4, "sum: *to > 3": 2}
    for name, n in most.items():
        # a loop that tests at its head enters that once more
        assert n <= runs[("", "sum"), heads[name]] <= n + max(1, n // 16), name


@pytest.mark.parametrize("spoilt", range(3))
def test_loop_without_a_bound_is_said(spoilt: int, tmp_path: Path) -> None:
    code = read(linked(tmp_path, "sum.c", NESTED, "sum"), ["sum"])
    rows = [row for n, row in enumerate(SMALL["bound"]) if n != spoilt]
    with pytest.raises(BoundError, match="a loop without a bound"):
        Table({**SMALL, "bound": rows}).check(code)


def test_bound_without_a_loop_is_said(tmp_path: Path) -> None:
    code = read(linked(tmp_path, "sum.c", NESTED, "sum"), ["sum"])
    more = [*SMALL["bound"], {"most": 2, "loops": ["sum: i < 17"]}]
    with pytest.raises(BoundError, match="no such loop"):
        Table({**SMALL, "bound": more}).check(code)
