"""Worst stack of a library from gcc's -fcallgraph-info=su files (.ci), and the proof that nothing in it recurses.

What is proven: no cycle among the calls that gcc knows; every frame has a size known at compile time; nothing is called
through a pointer; every function that is called is in the files, or in the list of externals with a stack of its own.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

_NODE = re.compile(r'^node: \{ title: "([^"]*)" label: "([^"]*)"', re.MULTILINE)
_EDGE = re.compile(r'^edge: \{ sourcename: "([^"]*)" targetname: "([^"]*)"', re.MULTILINE)
_FRAME = re.compile(r"(\d+) bytes \(([a-z,]+)\)")
INDIRECT = "__indirect_call"
EXCEPTION_BYTES = 112
"""What an interrupt puts on the stack itself: 26 words, floating-point registers among them, and one to align.

Source: Arm DDI0403, B1.5.7.
"""


class CallGraphError(Exception):
    """The call graph is not bounded: one line says where."""


@dataclass(frozen=True)
class Graph:
    """frame_bytes: own stack of each function. calls: whom it calls."""

    frame_bytes: dict[str, int]
    calls: dict[str, set[str]]


@dataclass(frozen=True)
class Chain:
    """The deepest chain of calls from a function: names with their own frames, and the sum."""

    bytes: int
    functions: tuple[tuple[str, int], ...]


def short_name(function: str) -> str:
    """gcc writes statics as file:name."""
    return function.rsplit(":", maxsplit=1)[-1]


def read_graph(files: Sequence[Path], external_bytes: Mapping[str, int]) -> Graph:
    """The call graph of all files.

    external_bytes: stack of functions outside of them.   Errors: CallGraphError.
    """
    frames: dict[str, int] = {}
    calls: dict[str, set[str]] = {}
    for file in files:
        text = file.read_text(encoding="utf-8")
        for title, label in _NODE.findall(text):
            if (frame := _FRAME.search(label)) is None:
                continue
            if frame[2] != "static":
                raise CallGraphError(
                    f"{short_name(title)}: the size of its stack is {frame[2]}, not fixed"
                )
            frames[title] = int(frame[1])
            calls.setdefault(title, set())
        for source, target in _EDGE.findall(text):
            calls.setdefault(source, set()).add(target)
    for source, targets in calls.items():
        if INDIRECT in targets:
            raise CallGraphError(f"{short_name(source)} calls through a pointer")
        for target in sorted(targets - frames.keys()):
            if target not in external_bytes:
                raise CallGraphError(
                    f"{short_name(source)} calls {target}, whose stack is not known"
                )
            frames[target] = external_bytes[target]
    return Graph(frames, calls)


def deepest(graph: Graph, root: str) -> Chain:
    """The worst chain from one function.   Errors: CallGraphError for recursion."""
    done: dict[str, Chain] = {}
    open_: list[str] = []

    def visit(function: str) -> Chain:
        if function in done:
            return done[function]
        if function in open_:
            loop = [short_name(f) for f in (*open_[open_.index(function) :], function)]
            raise CallGraphError(f"recursion: {' -> '.join(loop)}")
        open_.append(function)
        below = [visit(target) for target in sorted(graph.calls.get(function, ()))]
        open_.pop()
        worst = max(below, key=lambda chain: chain.bytes, default=Chain(0, ()))
        frame = graph.frame_bytes[function]
        done[function] = Chain(
            worst.bytes + frame, ((short_name(function), frame), *worst.functions)
        )
        return done[function]

    return visit(root)


def worst_chain(graph: Graph) -> Chain:
    """The worst chain from any function.   Errors: CallGraphError for recursion anywhere."""
    chains = [deepest(graph, function) for function in sorted(graph.frame_bytes)]
    return max(chains, key=lambda chain: chain.bytes)


def named(graph: Graph, name: str) -> str:
    """The function of this name.   Errors: CallGraphError when there is none, or more."""
    found = [f for f in graph.frame_bytes if short_name(f) == name]
    if len(found) != 1:
        raise CallGraphError(f"{len(found)} functions are called {name}")
    return found[0]


def interrupted(graph: Graph, below: str, above: str, never: str) -> tuple[Chain, Chain]:
    """The worst chains of what is interrupted and of the interrupt over it, the processor's own frame in the second.

    never: a function that the interrupt does not call as it is set up.   Errors: CallGraphError.
    """
    cut = named(graph, never)
    calls = {function: targets - {cut} for function, targets in graph.calls.items()}
    over = deepest(Graph(graph.frame_bytes, calls), named(graph, above))
    entry = ("exception", EXCEPTION_BYTES)
    return deepest(graph, named(graph, below)), Chain(
        over.bytes + EXCEPTION_BYTES, (entry, *over.functions)
    )
