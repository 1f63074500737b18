"""Control flow of object code for Cortex-M: functions, basic blocks, calls and loops, by objdump and addr2line.

What cannot be read is an error, not a guess: a jump through a register or a table, a call through a pointer.
"""

from __future__ import annotations

import re
import subprocess
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

_FUNCTION = re.compile(r"^([0-9a-f]+) <([^>]+)>:$")
_CODE = re.compile(r"^ *([0-9a-f]+):\t[0-9a-f ]+\t([a-z][\w.]*)(?:\t(.*))?$")
_TARGET = re.compile(r"\b([0-9a-f]+) <([^>+]+)(\+0x[0-9a-f]+)?>")
_CONDITIONS = ("eq", "ne", "cs", "cc", "mi", "pl", "vs", "vc", "hi", "ls", "ge", "lt", "gt", "le")
_HEAD = re.compile(r"^( *)(for|while) \((.*)$")


class FlowError(Exception):
    """Object code that is not understood: one line says where."""


@dataclass(frozen=True)
class Instruction:
    """One instruction; target: address that it names, of that function."""

    address: int
    name: str
    operands: str
    target: int | None = None
    function: str = ""


@dataclass
class Block:
    """Instructions without a jump in between. next: addresses of blocks that may follow; calls: functions, in order."""

    start: int
    code: list[Instruction] = field(default_factory=list)
    next: list[int] = field(default_factory=list)
    calls: list[str] = field(default_factory=list)
    ends: bool = False


@dataclass(frozen=True)
class Loop:
    """Blocks that lead to each other. latches: those that jump back to its head; bottom: each of them tests whether it
    goes on, and it is entered at its head alone: then the head runs as often as the body, else perhaps once more.
    """

    head: int
    blocks: frozenset[int]
    latches: frozenset[int]
    bottom: bool


@dataclass
class Function:
    """One function of the program."""

    name: str
    entry: int
    blocks: dict[int, Block]
    loops: list[Loop]


def output_of(words: Sequence[str | Path], said: str | None = None) -> str:
    """What a tool prints; said: on its standard input."""
    text = [str(word) for word in words]
    done = subprocess.run(text, input=said, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise FlowError(f"{text[0]}: {done.stderr.strip()}")
    return done.stdout


def read_code(program: Path, tools: str = "arm-none-eabi-") -> dict[str, list[Instruction]]:
    """Instructions of each function; of several with one name the second is `name~2`."""
    lines = output_of([f"{tools}objdump", "-d", program]).splitlines()
    names: dict[int, str] = {}
    for line in lines:
        if (head := _FUNCTION.match(line)) is not None:
            same = sum(name.partition("~")[0] == head[2] for name in names.values())
            names[int(head[1], 16)] = f"{head[2]}~{same + 1}" if same else head[2]
    starts = sorted(names)
    found: dict[str, list[Instruction]] = {name: [] for name in names.values()}
    code: list[Instruction] = []
    for line in lines:
        if (head := _FUNCTION.match(line)) is not None:
            code = found[names[int(head[1], 16)]]
        elif (match := _CODE.match(line)) is not None:
            operands = match[3] or ""
            to = _TARGET.search(operands.partition("@")[0])
            target = int(to[1], 16) if to is not None else None
            at = bisect_right(starts, target) if target is not None else 0
            function = names[starts[at - 1]] if at else ""
            code.append(Instruction(int(match[1], 16), match[2], operands, target, function))
    return found


def _kind(i: Instruction) -> tuple[str, bool]:
    """jump, call, return or "" of an instruction, and whether it depends on a condition."""
    name = i.name.partition(".")[0]
    if name in ("cbz", "cbnz"):
        return "jump", True
    if name in ("tbb", "tbh"):
        raise FlowError(f"{i.address:x}: a jump through a table")
    conditional = name[-2:] in _CONDITIONS
    if conditional and name not in ("bls", "bics", "mls", "bcs"):
        name = name[:-2]
    elif name in ("bls", "bcs"):
        name = "b"
    if name == "b":
        return "jump", conditional
    if name in ("bl", "blx"):
        if i.target is None:
            raise FlowError(f"{i.address:x}: a call through a pointer")
        return "call", conditional
    if name == "bx":
        if i.operands.strip() != "lr":
            raise FlowError(f"{i.address:x}: a jump through a register")
        return "return", conditional
    writes_pc = (name in ("pop", "ldmia", "ldmfd") and re.search(r"\bpc\}", i.operands)) or (
        name in ("ldr", "mov", "add", "adds") and re.match(r"pc\b", i.operands)
    )
    if writes_pc and name in ("mov", "add", "adds"):
        raise FlowError(f"{i.address:x}: a jump through a register")
    return ("return", conditional) if writes_pc else ("", False)


def build(name: str, code: Sequence[Instruction]) -> Function:
    """Blocks and loops of a function.   Errors: FlowError."""
    inside = {i.address for i in code}
    starts = {code[0].address}
    for at, i in enumerate(code):
        kind, _ = _kind(i)
        if kind == "jump" and i.target in inside:
            starts.add(int(i.target or 0))
        if kind in ("jump", "return") and at + 1 < len(code):
            starts.add(code[at + 1].address)
    blocks: dict[int, Block] = {}
    block = Block(code[0].address)
    runs_out = False
    for at, i in enumerate(code):
        if i.address in starts:
            block = blocks[i.address] = Block(i.address)
        block.code.append(i)
        kind, conditional = _kind(i)
        after = code[at + 1].address if at + 1 < len(code) else None
        if kind == "call":
            block.calls.append(i.function)
        elif kind == "return":
            block.ends = True
        elif kind == "jump" and i.target in inside:
            block.next.append(int(i.target or 0))
        elif kind == "jump" and conditional:
            raise FlowError(f"{name}: {i.address:x}: leaves the function on a condition")
        elif kind == "jump":
            block.calls.append(i.function)  # the last call, in place of a return
            block.ends = True
        falls = kind in ("", "call") or conditional
        if falls and after in starts:
            block.next.append(int(after or 0))
        runs_out = falls and after is None and i.name not in ("nop", "udf", "nop.w")
    seen = _reached(code[0].address, blocks)
    if runs_out and block.start in seen:  # else it is what fills the space to the next function
        raise FlowError(f"{name}: runs out of its end")
    blocks = {start: b for start, b in blocks.items() if start in seen}
    return Function(name, code[0].address, blocks, _loops(code[0].address, blocks))


def _reached(entry: int, blocks: dict[int, Block]) -> set[int]:
    seen, waiting = {entry}, [entry]
    while waiting:
        for after in blocks[waiting.pop()].next:
            if after not in seen:
                seen.add(after)
                waiting.append(after)
    return seen


def _components(nodes: set[int], blocks: dict[int, Block], cut: set[int]) -> list[set[int]]:
    """Sets of blocks that lead to each other without entering any of `cut` again. Source: Tarjan 1972."""
    index: dict[int, int] = {}
    low: dict[int, int] = {}
    kept: list[int] = []
    found: list[set[int]] = []

    def after(at: int) -> list[int]:
        return [n for n in blocks[at].next if n in nodes and n not in cut]

    for root in sorted(nodes):
        if root in index:
            continue
        path = [(root, after(root))]
        index[root] = low[root] = len(index)
        kept.append(root)
        while path:
            at, rest = path[-1]
            if rest:
                n = rest.pop()
                if n not in index:
                    index[n] = low[n] = len(index)
                    kept.append(n)
                    path.append((n, after(n)))
                elif n in kept:
                    low[at] = min(low[at], index[n])
                continue
            path.pop()
            if path:
                low[path[-1][0]] = min(low[path[-1][0]], low[at])
            if low[at] == index[at]:
                body = set(kept[kept.index(at) :])
                del kept[kept.index(at) :]
                if len(body) > 1 or at in after(at):
                    found.append(body)
    return found


def _loops(entry: int, blocks: dict[int, Block]) -> list[Loop]:
    """Loops and those inside of them. One that is entered in several places is counted at one of them."""
    before: dict[int, set[int]] = {start: set() for start in blocks}
    for start, b in blocks.items():
        for n in b.next:
            before[n].add(start)
    loops = []
    waiting = [(set(blocks), set[int]())]
    while waiting:
        nodes, cut = waiting.pop()
        for body in _components(nodes, blocks, cut):
            entries = {n for n in body if n == entry or before[n] - body}
            head = max(entries or body, key=lambda n: (len(before[n] & body), -n))
            latches = before[head] & body
            tests = all(any(n not in body for n in blocks[end].next) for end in latches)
            bottom = tests and entries == {head}
            loops.append(Loop(head, frozenset(body), frozenset(latches), bottom))
            waiting.append((body, cut | {head}))
    return sorted(loops, key=lambda loop: (loop.head, -len(loop.blocks)))


def read_functions(program: Path, roots: Iterable[str]) -> dict[str, Function]:
    """The functions that are called from some, and those themselves.   Errors: FlowError."""
    code = read_code(program)
    found: dict[str, Function] = {}
    waiting = list(roots)
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        if name not in code or not code[name]:
            raise FlowError(f"{name} is called, but not there")
        try:
            found[name] = build(name, code[name])
        except FlowError as error:
            raise FlowError(f"{name}: {error}") from error
        waiting += [called for b in found[name].blocks.values() for called in b.calls]
    return found


# --------------------------------------------------------------------------------------------------------- the sources


@dataclass(frozen=True)
class Frame:
    """A place of the sources."""

    function: str
    file: str
    line: int


def read_frames(program: Path, addresses: Sequence[int]) -> dict[int, tuple[Frame, ...]]:
    """Where each address comes from: innermost inlined function first."""
    said = "".join(f"{a:#x}\n" for a in addresses)
    lines = output_of(["arm-none-eabi-addr2line", "-i", "-f", "-a", "-e", program], said)
    found: dict[int, tuple[Frame, ...]] = {}
    rows = lines.splitlines()
    at = 0
    while at < len(rows):
        address, frames, at = int(rows[at], 16), [], at + 1
        while at < len(rows) and not rows[at].startswith("0x"):
            file, _, line = rows[at + 1].rpartition(":")
            number = re.match(r"\d+", line)
            frames.append(Frame(rows[at], file, int(number[0]) if number else 0))
            at += 2
        found[address] = tuple(frames)
    return found


@dataclass(frozen=True)
class SourceLoop:
    """A loop of the sources, by its lines; test: what decides whether it goes on."""

    test: str
    first: int
    last: int


@cache
def source_loops(file: str) -> tuple[SourceLoop, ...]:
    """The loops of a file that clang-format has been over: a body ends with a brace as far in as its head."""
    if not Path(file).is_file():
        return ()
    lines = Path(file).read_text(encoding="utf-8").splitlines()
    found = []
    for at, line in enumerate(lines):
        if (head := _HEAD.match(line)) is None:
            continue
        text, end = head[3], at
        while text.count("(") >= text.count(")"):
            end += 1
            text += " " + lines[end].strip()
        depth, close = 1, 0
        for close, c in enumerate(text):  # noqa: B007
            depth += (c == "(") - (c == ")")
            if depth == 0:
                break
        inner = text[:close]
        test = inner.split(";")[1].strip() if head[2] == "for" else inner.strip()
        last = next(
            (n for n in range(end + 1, len(lines)) if re.match(rf"^{head[1]}\}}", lines[n])), end
        )
        found.append(SourceLoop(test, at + 1, last + 1))
    return tuple(found)


SURE = 0.75
"""Share of the instructions of a loop that come from a loop of the sources when it was made from that one."""


Origin = tuple[str, SourceLoop]
"""A loop of the sources, behind the function that it stands in."""


def origins_of(
    function: Function, frames: dict[int, tuple[Frame, ...]]
) -> dict[int, Origin | None]:
    """The loop of the sources that each loop was made from, by its head; None where there is none.

    Two, one in the other, may be made from one: from the inner one then, where that made none inside of it.
    """
    ranked = {loop.head: _ranked(function, loop, frames) for loop in function.loops}
    found = {head: origins[0] if origins else None for head, origins in ranked.items()}
    for loop in sorted(function.loops, key=lambda one: len(one.blocks)):
        outside = {found[o.head] for o in function.loops if loop.blocks < o.blocks}
        inside = {found[o.head] for o in function.loops if o.blocks < loop.blocks}
        if found[loop.head] in outside:
            free = [o for o in ranked[loop.head] if o not in outside | inside]
            found[loop.head] = free[0] if free else found[loop.head]
    return found


def _ranked(function: Function, loop: Loop, frames: dict[int, tuple[Frame, ...]]) -> list[Origin]:
    """Where a loop may come from: first the innermost that most of its instructions come from and it goes back in."""
    inner = {
        b
        for other in function.loops
        if other.head != loop.head and other.blocks < loop.blocks
        for b in other.blocks
    }
    own = [i.address for b in sorted(loop.blocks - inner) for i in function.blocks[b].code]
    ends = [function.blocks[b].code[-1].address for b in sorted(loop.latches)]

    def at(address: int) -> set[tuple[int, str, SourceLoop]]:
        """Loops round an address, with how many functions deep in they stand."""
        stack = frames.get(address, ())
        return {
            (len(stack) - up, f.function, s)
            for up, f in enumerate(stack)
            for s in source_loops(f.file)
            if s.first <= f.line <= s.last
        }

    here = [at(address) for address in own]
    share = {o: sum(o in h for h in here) / len(own) for h in here for o in h}
    back = {o for end in ends for o in at(end)}
    sure = [o for o, part in share.items() if part >= SURE]
    # where the one inside of it was unrolled, that is not where it goes back from
    some = [o for o in sure if o in back]
    rest = [o for o in sure if o not in some] or ([] if some else list(back))

    def depth(o: tuple[int, str, SourceLoop]) -> tuple[int, int]:
        return o[0], o[2].first - o[2].last

    some.sort(key=depth, reverse=True)
    rest.sort(key=depth, reverse=True)
    return [(name, one) for _, name, one in (*some, *rest)]
