"""The longest path through object code: a linear programme over the flow of all its blocks.

Each block runs as often as it is entered and left; each loop at most so often as the table says for each time that it
is reached; facts bound places against each other, and the work that a slice may count. What the programme finds can be
no path at all, but no path is longer. Source: Li, Malik 1995, implicit path enumeration.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from flow import FlowError, Function, Loop, SourceLoop, origins_of, read_frames, read_functions
from scipy.optimize import linprog
from scipy.sparse import csr_array

_CLONE = re.compile(r"\.(isra|constprop|part|cold)\.\d+|~\d+")


class BoundError(Exception):
    """A path is not bounded, or the table does not fit the code: one line says what."""


def plain(name: str) -> str:
    """A function's name without what a compiler appends, and which of several it is."""
    return _CLONE.sub("", name)


@dataclass(frozen=True)
class NamedLoop:
    """A loop of the object code. name: `object function/source function: test #n`, once where both are the same."""

    function: str
    name: str
    origin: tuple[str, SourceLoop] | None
    loop: Loop
    outer: Loop
    """The outermost loop round it that was made from the same one of the sources: the loop itself, mostly."""


@dataclass
class Code:
    """Functions, and their loops by name."""

    functions: dict[str, Function]
    loops: list[NamedLoop] = field(default_factory=list)
    inlined: dict[tuple[str, str], int] = field(default_factory=dict)
    """Of a function, and one that was made part of it: the block that has most of that."""


def _names(function: Function, frames: Mapping[int, Any]) -> list[NamedLoop]:
    origins = origins_of(function, dict(frames))
    found = []
    counts: dict[str, int] = {}

    def line(loop: Loop) -> int:
        stack = frames.get(function.blocks[loop.head].code[0].address, ())
        return stack[-1].line if stack else 0

    for loop in sorted(function.loops, key=lambda one: (line(one), one.head)):
        origin = origins[loop.head]
        text = f"{origin[0]}: {origin[1].test}" if origin else "library"
        name = (
            text
            if origin and origin[0] == plain(function.name)
            else f"{plain(function.name)}/{text}"
        )
        counts[name] = counts.get(name, 0) + 1
        round_it = [
            o
            for o in function.loops
            if loop.blocks <= o.blocks and origins[o.head] == origin and origin is not None
        ]
        outer = max(round_it, key=lambda o: len(o.blocks), default=loop)
        found.append(NamedLoop(function.name, f"{name} #{counts[name]}", origin, loop, outer))
    return found


def read(program: Path, roots: Iterable[str]) -> Code:
    """The code that some functions may run.   Errors: BoundError."""
    try:
        functions = read_functions(program, roots)
    except FlowError as error:
        raise BoundError(str(error)) from error
    addresses = sorted(
        {i.address for f in functions.values() for b in f.blocks.values() for i in b.code}
    )
    frames = read_frames(program, addresses)
    code = Code(functions)
    for function in functions.values():
        code.loops += _names(function, frames)
        code.inlined |= _inlined(function, frames)
    return code


def _inlined(function: Function, frames: Mapping[int, Any]) -> dict[tuple[str, str], int]:
    sizes: dict[str, dict[int, int]] = {}
    for start, block in function.blocks.items():
        for instruction in block.code:
            for name in {frame.function for frame in frames.get(instruction.address, ())[:-1]}:
                of = sizes.setdefault(plain(name), {})
                of[start] = of.get(start, 0) + 1
    return {(function.name, name): max(of, key=lambda b: of[b]) for name, of in sizes.items()}


_ARITHMETIC = ("vmul", "vsqrt", "vdiv", "vmla", "vfma", "vnmul")


def passed_over(function: Function, loop: Loop) -> list[int]:
    """Blocks of a loop that calculate, and that some way round it does not run."""
    found = []
    for start in loop.blocks:
        names = [i.name.partition(".")[0] for i in function.blocks[start].code]
        if start == loop.head or not any(n.startswith(_ARITHMETIC) for n in names):
            continue
        seen, waiting = {loop.head, start}, [loop.head]
        while waiting:
            for after in function.blocks[waiting.pop()].next:
                if after in loop.blocks and after not in seen:
                    seen.add(after)
                    waiting.append(after)
        round_it = loop.latches & (seen - {start})
        if round_it:
            found.append(start)
    return found


# ------------------------------------------------------------------------------------------------------ the programme


Copy = tuple[str, str]
"""A function as it is run in a stage: stage and name; of library functions the caller too, behind `<`."""
Sum = dict[int, float]
Return = tuple[Copy, int, int]
"""A function, one of its blocks, and which of the calls there."""


@dataclass(frozen=True)
class Longest:
    """The longest one. by: instructions of each copy of a function; counts: how often each block runs."""

    instructions: int
    by: dict[Copy, float]
    counts: dict[tuple[Copy, int], float]


class Programme:
    """Flow of everything that a root may run, once for each stage."""

    def __init__(
        self,
        code: Code,
        root: str,
        stages: Mapping[str, str],
        bound: Callable[[NamedLoop, Copy], float],
        per_caller: Sequence[str] = (),
        resumed: str = "",
        before: Mapping[str, float] | None = None,
    ) -> None:
        """stages: of the functions that begin one; bound: how often the body of a loop runs.

        resumed: a loop at whose head the path begins, where functions up to the root have been called; before: how
        often places had been come by then, beside these calls.   Errors: BoundError.
        """
        self.code, self.root, self.stages, self.per_caller = code, root, stages, per_caller
        self.before = dict(before or {})
        self._loops: dict[str, list[NamedLoop]] = {}
        for loop in code.loops:
            self._loops.setdefault(loop.function, []).append(loop)
        self.columns = 0
        self.blocks: dict[tuple[Copy, int], int] = {}
        self.edges: dict[tuple[Copy, int, int], int] = {}
        self.entries: dict[Copy, Sum] = {}
        self._exits: dict[tuple[Copy, int], int] = {}
        self.equal: list[tuple[Sum, float]] = []
        self.least: list[tuple[Sum, float]] = []  # sums that are at most a number,
        self.said: list[str] = []  # and what each is
        # where the path may come back to functions that had been called
        self.returns: dict[Return, int] = {}
        self._copy_all()
        self.begins = self._resume(resumed) if resumed else (self.first, code.functions[root].entry)
        self._flow()
        for copy in self.entries:
            for loop in self._loops.get(self.name_of(copy), ()):
                self._bound(copy, loop, bound(loop, copy))

    @staticmethod
    def name_of(copy: Copy) -> str:
        """The function of a copy."""
        return copy[1].partition("<")[0]

    def _called(self, copy: Copy, called: str) -> Copy:
        name = f"{called}<{plain(self.name_of(copy))}" if called in self.per_caller else called
        return self.stages.get(called, copy[0]), name

    def _new(self) -> int:
        self.columns += 1
        return self.columns - 1

    def _copy_all(self) -> None:
        first = (self.stages.get(self.root, ""), self.root)
        waiting = [first]
        while waiting:
            copy = waiting.pop()
            if copy in self.entries:
                continue
            self.entries[copy] = {}
            function = self.code.functions[self.name_of(copy)]
            for start, block in function.blocks.items():
                self.blocks[copy, start] = self._new()
                for after in block.next:
                    self.edges[copy, start, after] = self._new()
                if block.ends:
                    self._exits[copy, start] = self._new()
                waiting += [self._called(copy, c) for c in block.calls]
        self.first = first

    def _resume(self, name: str) -> tuple[Copy, int]:
        """The head of a loop. Whoever led to it returns once, from one of its calls; that it was called counts too."""
        heads = [
            (copy, loop.loop.head)
            for copy in self.entries
            for loop in self._loops.get(self.name_of(copy), ())
            if name in (loop.name, loop.name.rpartition(" #")[0])
        ]
        if len(heads) != 1:
            raise BoundError(f"{name}: {len(heads)} loops to go on from")
        into: dict[Copy, Sum] = {copy: {} for copy in self.entries}
        for copy in self.entries:
            for start, block in self.code.functions[self.name_of(copy)].blocks.items():
                for n, called in enumerate(block.calls):
                    column = self.returns[copy, start, n] = self._new()
                    into[self._called(copy, called)][column] = 1.0
        for copy, row in into.items():
            if copy == self.first:
                continue
            for (of, _, _), column in self.returns.items():
                if of == copy and copy != heads[0][0]:
                    row[column] = row.get(column, 0.0) - 1.0
            self.equal.append((row, float(copy == heads[0][0])))
        return heads[0]

    def _returns_in(self, copy: Copy, blocks: Iterable[int]) -> Sum:
        """Returns to some blocks."""
        those = set(blocks)
        found = [c for (of, start, _), c in self.returns.items() if of == copy and start in those]
        return dict.fromkeys(found, 1.0)

    def _returns_from(self, copy: Copy) -> Sum:
        """Returns from a function that had been called."""
        blocks = {of: self.code.functions[self.name_of(of)].blocks for of in self.entries}
        return {
            c: 1.0
            for (of, start, n), c in self.returns.items()
            if self._called(of, blocks[of][start].calls[n]) == copy
        }

    def _flow(self) -> None:
        for (copy, start, n), column in self.returns.items():
            # what the block calls after that is called as well
            for called in self.code.functions[self.name_of(copy)].blocks[start].calls[n + 1 :]:
                into = self.entries[self._called(copy, called)]
                into[column] = into.get(column, 0.0) + 1.0
        for copy in self.entries:
            for start, block in self.code.functions[self.name_of(copy)].blocks.items():
                for called in block.calls:
                    into = self.entries[self._called(copy, called)]
                    column = self.blocks[copy, start]
                    into[column] = into.get(column, 0.0) + 1.0
        into_: dict[tuple[Copy, int], list[int]] = {}
        out: dict[tuple[Copy, int], list[int]] = {}
        for (copy, start, after), column in self.edges.items():
            out.setdefault((copy, start), []).append(column)
            into_.setdefault((copy, after), []).append(column)
        for (copy, start), column in self._exits.items():
            out.setdefault((copy, start), []).append(column)
        for (copy, start), column in self.blocks.items():
            function = self.code.functions[self.name_of(copy)]
            row: Sum = {column: -1.0}
            for c in into_.get((copy, start), ()):
                row[c] = row.get(c, 0.0) + 1.0
            if start == function.entry:
                for c, times in self.entries[copy].items():
                    row[c] = row.get(c, 0.0) + times
            self.equal.append((row, -float((copy, start) == self.begins)))
            leaves: Sum = dict.fromkeys([column, *self._returns_in(copy, [start])], -1.0)
            for c in out.get((copy, start), ()):
                leaves[c] = leaves.get(c, 0.0) + 1.0
            self.equal.append((leaves, 0.0))

    def into(self, copy: Copy, loop: Loop) -> tuple[Sum, float]:
        """How often a loop is reached: a sum and a number."""
        row: Sum = {}
        for (of, start, after), column in self.edges.items():
            if of == copy and start not in loop.blocks and after in loop.blocks:
                row[column] = row.get(column, 0.0) + 1.0
        row |= self._returns_in(copy, loop.blocks)
        if self.code.functions[self.name_of(copy)].entry in loop.blocks:
            for column, n in self.entries[copy].items():
                row[column] = row.get(column, 0.0) + n
        return row, float(self.begins[0] == copy and self.begins[1] in loop.blocks)

    def _bound(self, copy: Copy, loop: NamedLoop, most: float) -> None:
        runs = most if loop.loop.bottom else most + 1
        row, begun = self.into(copy, loop.outer)
        total = {column: -runs * n for column, n in row.items()}
        head = self.blocks[copy, loop.loop.head]
        total[head] = total.get(head, 0.0) + 1.0
        self.least.append((total, runs * begun))
        self.said.append(f"{loop.name} @ {copy[0]}: at most {most:g}")

    def _bodies(self, copy: Copy, loop: Loop) -> Sum:
        """How often the body of a loop begins: as its head runs, or goes on from there, when it tests first."""
        head = self.code.functions[self.name_of(copy)].blocks[loop.head]
        on = [after for after in head.next if after in loop.blocks]
        if loop.bottom or len(on) == len(head.next):
            row: Sum = {self.blocks[copy, loop.head]: 1.0}
            return row | self._returns_in(copy, loop.blocks)
        row = {self.edges[copy, loop.head, after]: 1.0 for after in on}
        return row | self._returns_in(copy, loop.blocks - {loop.head})

    # ------------------------------------------------------------------------------------------------------- places

    def place(self, text: str) -> tuple[list[Sum], float]:
        """How often something happens: sums, each of which it is, and what is added to them; 0 where it is not run.

        `enter F`, `call F > G`, `inlined F > G`, `loop NAME`, `into NAME`, `lanes NAME`.   Errors: BoundError: nothing
        at all is that.
        """
        text, _, stage = text.partition(" @ ")
        kind, _, what = text.partition(" ")
        row: Sum = {}
        apart: list[Sum] = []
        begun = 0.0

        def add(more: Mapping[int, float]) -> None:
            for column, n in more.items():
                row[column] = row.get(column, 0.0) + n

        for copy in self.entries:
            if stage and copy[0] != stage:
                continue
            name = self.name_of(copy)
            if kind == "enter" and plain(name) == what:
                add(self.entries[copy])
                add(self._returns_from(copy))
                begun += float(copy == self.first)
            elif kind == "call" and plain(name) == what.partition(" > ")[0]:
                for start, block in self.code.functions[name].blocks.items():
                    n = sum(plain(c) == what.partition(" > ")[2] for c in block.calls)
                    add({self.blocks[copy, start]: float(n)} if n else {})
                    for at, c in enumerate(block.calls):
                        back = self.returns.get((copy, start, at))
                        if back is not None and plain(c) == what.partition(" > ")[2]:
                            add({back: 1.0})
            elif kind == "inlined" and plain(name) == what.partition(" > ")[0]:
                inner = self.code.inlined.get((name, what.partition(" > ")[2]))
                if inner is not None:
                    add({self.blocks[copy, inner]: 1.0})
                    add(self._returns_in(copy, [inner]))
            elif kind in ("loop", "into", "lanes"):
                for loop in self._loops.get(name, ()):
                    if what not in (loop.name, loop.name.rpartition(" #")[0]):
                        continue
                    if kind == "loop":
                        add(self._bodies(copy, loop.loop))
                    elif kind == "into" and loop.outer == loop.loop:
                        more, one = self.into(copy, loop.loop)
                        add(more)
                        begun += one
                    elif kind == "lanes":
                        of = self.code.functions[name]
                        apart += [{self.blocks[copy, b]: 1.0} for b in passed_over(of, loop.loop)]
        if not row and not apart and not begun and not self._is_somewhere(kind, what):
            raise BoundError(f"{text}: nothing of the code is that")
        return (apart or [row]), begun

    def _is_somewhere(self, kind: str, what: str) -> bool:
        """Whether a place is one of the code, though not of what the root runs."""
        if kind == "enter":
            return any(plain(name) == what for name in self.code.functions)
        caller, _, called = what.partition(" > ")
        if kind == "inlined":
            return any(plain(of) == caller and name == called for of, name in self.code.inlined)
        if kind == "call":
            return any(
                plain(name) == caller and plain(c) == called
                for name, f in self.code.functions.items()
                for b in f.blocks.values()
                for c in b.calls
            )
        names = {loop.name for loop in self.code.loops}
        return kind in ("loop", "into", "lanes") and (
            what in names or what in {n.rpartition(" #")[0] for n in names}
        )

    def at_most(self, places: Mapping[str, float], most: float) -> None:
        """The sum of some places is at most a number. Where one is several blocks it holds for each."""
        total, begun, several = self._total(places)
        for row in several or [{}]:
            both = dict(total)
            for column, m in row.items():
                both[column] = both.get(column, 0.0) + m
            self.least.append((both, most - begun))
            self.said.append(f"{dict(places)} at most {most:g}")

    def _total(self, places: Mapping[str, float]) -> tuple[Sum, float, list[Sum]]:
        """Sum of places, what is added to it, and of one that is several blocks each of them."""
        total: Sum = {}
        several: list[Sum] = []
        added = 0.0
        for text, n in places.items():
            rows, begun = self.place(text)
            added += n * (begun + self.before.get(text, 0.0))
            if len(rows) > 1 and (several or n != 1.0):
                raise BoundError(f"{text}: several blocks: once, and counted once")
            if len(rows) > 1:
                several = rows
            else:
                for column, m in rows[0].items():
                    total[column] = total.get(column, 0.0) + n * m
        return total, added, several

    # ------------------------------------------------------------------------------------------------------ measured

    def broken(
        self, ran: Mapping[int, int], times: int, places: Mapping[str, float], most: float
    ) -> list[str]:
        """Bounds and facts that blocks which ran so often, in so many runs of the root, do not fit; library aside.

        They hold for the sum of runs as for each. What must give is looked for, as little as can be. places: whose sum
        is at most a number in all of these runs.
        """
        rows = [(row, times * n) for row, n in self.equal]
        together: dict[tuple[str, int], Sum] = {}
        for (copy, start), column in self.blocks.items():
            name = self.name_of(copy)
            if name not in self.per_caller:
                together.setdefault((name, start), {})[column] = 1.0
        rows += [(row, float(ran.get(start, 0))) for (_, start), row in together.items()]
        least = [(row, times * n) for row, n in self.least]
        least.append((self._total(places)[0], most))
        given = len(least)
        lax = [({**row, self.columns + i: -1.0}, n) for i, (row, n) in enumerate(least)]
        cost = np.concatenate([np.zeros(self.columns), np.ones(given)])
        found = self._solve(cost, lax, rows, self.columns + given)[self.columns :]
        said = [*self.said, f"{dict(places)} at most {most:g}"]
        return [f"{said[i]}: {found[i]:.1f} too many" for i in np.flatnonzero(found > 1e-3)]

    def never(self) -> list[str]:
        """Calls that led to where the path begins, but that by its bounds and facts it cannot come back from."""
        said = []
        for (copy, start, n), column in self.returns.items():
            called = self.code.functions[self.name_of(copy)].blocks[start].calls[n]
            cost = np.zeros(self.columns)
            cost[column] = -1.0
            leads = self._solve(cost, [], self.equal, self.columns)[column] > 0.0
            if leads and not self._solve(cost, self.least, self.equal, self.columns)[column] > 0.0:
                said.append(f"{plain(self.name_of(copy))} > {plain(called)}")
        return said

    # ------------------------------------------------------------------------------------------------------- longest

    def longest(self) -> Longest:
        """The longest path.   Errors: BoundError."""
        cost = np.zeros(self.columns)
        for (copy, start), column in self.blocks.items():
            cost[column] = len(self.code.functions[self.name_of(copy)].blocks[start].code)
        for (copy, start, _), column in self.returns.items():
            cost[column] = len(self.code.functions[self.name_of(copy)].blocks[start].code)

        x = self._solve(-cost, self.least, self.equal, self.columns)
        counts = {key: float(x[column]) for key, column in self.blocks.items()}
        by: dict[Copy, float] = {}
        for (copy, start), n in counts.items():
            size = len(self.code.functions[self.name_of(copy)].blocks[start].code)
            by[copy] = by.get(copy, 0.0) + n * size
        return Longest(int(np.ceil(cost @ x - 1e-6)), by, counts)

    def _solve(
        self,
        cost: npt.NDArray[np.float64],
        least: Sequence[tuple[Sum, float]],
        equal: Sequence[tuple[Sum, float]],
        columns: int,
    ) -> npt.NDArray[np.float64]:
        def matrix(rows: Sequence[tuple[Sum, float]]) -> tuple[Any, Any]:
            at = [r for r, (row, _) in enumerate(rows) for _ in row]
            of = [c for row, _ in rows for c in row]
            values = [n for row, _ in rows for n in row.values()]
            shape = (len(rows), columns)
            return csr_array((values, (at, of)), shape=shape), np.array([b for _, b in rows])

        a_ub, b_ub = matrix(least)
        a_eq, b_eq = matrix(equal)
        for presolve in (True, False):  # to give up is no answer
            options = {"presolve": presolve}
            found = linprog(cost, a_ub, b_ub, a_eq, b_eq, method="highs", options=options)
            if found.status == 0:
                return np.asarray(found.x)
        raise BoundError(f"{self.root}: no longest path: {found.message}")
