"""Worst-case response times of the bus schedule, and an event simulation that must never exceed them.

Analysis: Davis, Burns, Bril, Lukkien 2007, "Controller Area Network (CAN) schedulability analysis: refuted, revisited
and revised": busy period, then every instance in it; with an error model of one bus error per interval. Frames are
taken with the most stuff bits they can have. Unit: us throughout; at 1 Mbit/s one bit is 1 us.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from heapq import heappop, heappush
from math import ceil

from crease.bus.dictionary import Dictionary, Message

ERROR_BITS = 31
"""Longest error frame with interframe space; the frame it hit is sent again."""
_ROUNDS_MAX = 10_000


def frame_bits(length: int) -> int:
    """Bits of a classical data frame with an 11-bit identifier, worst stuffing, interframe space included.

    Davis et al., equation 1: g + 8 s + 13 + floor((g + 8 s - 1) / 4) with g = 34.
    """
    return 34 + 8 * length + 13 + (34 + 8 * length - 1) // 4


def fd_frame_us(length: int, bit_us: float = 1.0, data_bit_us: float = 0.2) -> float:
    """Time of a CAN FD frame with an 11-bit identifier and bit-rate switch, worst stuffing, interframe space included.

    ISO 11898-1:2015. In nominal bits: 17 from start of frame to BRS, at most 4 stuff bits among them, 13 from the CRC
    delimiter to the end of the interframe space. In data bits: ESI, DLC, data and their stuff bits; stuff count and CRC
    with a fixed stuff bit before them and after every fourth.   Errors: ValueError for a length that no DLC has.
    """
    if length not in (*range(9), 12, 16, 20, 24, 32, 48, 64):
        raise ValueError(f"no CAN FD frame has {length} bytes")
    stuffed = (17 + 5 + 8 * length - 1) // 4
    check = 4 + (17 if length <= 16 else 21)
    data_bits = 5 + 8 * length + (stuffed - 4) + check + 1 + check // 4
    return (17 + 4 + 13) * bit_us + data_bits * data_bit_us


@dataclass(frozen=True)
class Timing:
    """One message in the analysis. Units: us."""

    name: str
    cob: int
    cost_us: float
    period_us: float
    jitter_us: float
    cyclic: bool


@dataclass(frozen=True)
class Response:
    """Worst case of one message. response_us None: the bus is overloaded, no bound."""

    name: str
    cob: int
    cost_us: float
    period_us: float
    response_us: float | None

    @property
    def feasible(self) -> bool:
        """The frame is through before its next instance is released."""
        return self.response_us is not None and self.response_us <= self.period_us


def timings(messages: Sequence[Message], bit_us: float = 1.0) -> list[Timing]:
    """The messages with their cost, highest priority first."""
    found = [
        Timing(m.name, m.cob, frame_bits(m.bytes) * bit_us, m.period_us, m.jitter_us, m.cyclic)
        for m in messages
    ]
    return sorted(found, key=lambda timing: timing.cob)


def load(items: Sequence[Timing], cyclic_only: bool = False) -> float:
    """Share of the bus time that is used, 0..1."""
    return sum(i.cost_us / i.period_us for i in items if i.cyclic or not cyclic_only)


def _fixed_point(start: float, step: Callable[[float], float], limit: float) -> float | None:
    """Least solution of w = step(w) from below; None past the limit."""
    value = start
    for _ in range(_ROUNDS_MAX):
        after = step(value)
        if after == value:
            return value
        if after > limit:
            return None
        value = after
    return None


def response(
    items: Sequence[Timing], at: int, bit_us: float = 1.0, error_interval_us: float | None = None
) -> float | None:
    """Worst-case response time of message `at` from its nominal release; None when there is no bound."""
    own, above, below = items[at], items[:at], items[at + 1 :]
    blocking = max((i.cost_us for i in below), default=0.0)
    limit = 1000 * max(i.period_us for i in items)
    resent = max(i.cost_us for i in items[: at + 1]) + ERROR_BITS * bit_us

    def errors(time_us: float) -> float:
        return 0.0 if error_interval_us is None else ceil(time_us / error_interval_us) * resent

    def busy(time_us: float) -> float:
        same = [*above, own]
        return (
            errors(time_us)
            + blocking
            + sum(ceil((time_us + i.jitter_us) / i.period_us) * i.cost_us for i in same)
        )

    if sum(i.cost_us / i.period_us for i in [*above, own]) >= 1.0:
        return None
    length = _fixed_point(own.cost_us, busy, limit)
    if length is None:
        return None
    worst = 0.0
    for instance in range(ceil((length + own.jitter_us) / own.period_us)):
        before = blocking + instance * own.cost_us

        def queued(wait_us: float, before: float = before) -> float:
            higher = sum(
                ceil((wait_us + i.jitter_us + bit_us) / i.period_us) * i.cost_us for i in above
            )
            return errors(wait_us + own.cost_us) + before + higher

        wait = _fixed_point(before, queued, limit)
        if wait is None:
            return None
        worst = max(worst, own.jitter_us + wait - instance * own.period_us + own.cost_us)
    return worst


def analyse(
    items: Sequence[Timing], bit_us: float = 1.0, error_interval_us: float | None = None
) -> list[Response]:
    """Every message, highest priority first."""
    return [
        Response(
            i.name, i.cob, i.cost_us, i.period_us, response(items, at, bit_us, error_interval_us)
        )
        for at, i in enumerate(items)
    ]


def feasible(items: Sequence[Timing], error_interval_us: float | None = None) -> bool:
    """Every message is through before its next instance is released."""
    return all(found.feasible for found in analyse(items, 1.0, error_interval_us))


def at_rate(items: Sequence[Timing], rate_Hz: float) -> list[Timing]:
    """The same bus with another rate of the SYNC, and of what follows it."""
    return [replace(i, period_us=i.period_us * (1e3 / rate_Hz)) if i.cyclic else i for i in items]


def highest_rate_Hz(items: Sequence[Timing], step_Hz: int = 25, most_Hz: int = 4000) -> int:
    """Largest multiple of `step_Hz` at which the schedule is feasible; 0 when none is."""
    rates = range(step_Hz, most_Hz + 1, step_Hz)
    return max((rate for rate in rates if feasible(at_rate(items, rate))), default=0)


@dataclass(frozen=True)
class Cycle:
    """One period while torque flows: SYNC, states, computation, torque.

    Units: us after SYNC is handed to the controller. states_us: the last state has come, when nothing else is on the
    bus. answers_us: the same at the latest. deadline_us: what the host waits at most. budget_us, budget_quiet_us: how
    long the computation may take so that the torque frame is through before the next SYNC is due, in every case, and
    with nothing else on the bus. bridged_us: the torque frame of a tick that waited until the deadline is through.
    """

    states_us: float
    answers_us: float
    deadline_us: float
    budget_us: float
    budget_quiet_us: float
    bridged_us: float


def cycle(dictionary: Dictionary, bit_us: float = 1.0, step_us: float = 50.0) -> Cycle:
    """The phases of one period follow one another, so that they can be added up: tighter than `analyse`, which
    takes every frame to be released at any time.

    A frame of a drive may be on the wire when SYNC is handed over; another may start in the time that the drives need
    to answer; a third may be on the wire when the torque frame is handed over: the heartbeats, once each. The host's
    own heartbeat goes out behind its torque frame, and SYNC behind that when the bus was late. The wrist comes below
    the states, while the host computes: a computation shorter than its frame waits for it instead. A bus error is left
    out: a state that it delays beyond the deadline is bridged.
    """
    messages = [m for m in dictionary.messages() if m.rendering]
    cost = {m.name: frame_bits(m.bytes) * bit_us for m in messages}
    return _phases(messages, cost, float(dictionary.bus["period_us"]), step_us)


def _phases(
    messages: Sequence[Message], cost: Mapping[str, float], period: float, step_us: float
) -> Cycle:
    """`cycle` of these frames, of which each takes `cost`, us."""
    states = [m for m in messages if m.name.startswith("STATE")]
    seldom = [m for m in messages if not m.cyclic]
    in_way = sorted((cost[m.name] for m in seldom if m.sender == "drive"), reverse=True)[:3]
    behind_torque = sum(cost[m.name] for m in seldom if m.sender == "host")
    reaction = max(m.jitter_us for m in states)
    quiet = cost["SYNC"] + reaction + sum(cost[m.name] for m in states)
    answers = quiet + in_way[0] + in_way[1]
    deadline = ceil((answers + behind_torque) / step_us) * step_us
    return Cycle(
        states_us=quiet,
        answers_us=answers + behind_torque,
        deadline_us=deadline,
        budget_us=period - answers - in_way[2] - cost["TORQUE"],
        budget_quiet_us=period - quiet - cost["TORQUE"],
        bridged_us=deadline + max(in_way[0], cost.get("WRIST", 0.0)) + cost["TORQUE"],
    )


WRIST_NODES = (0x14, 0x15, 0x16)
"""Of the drives yaw, pitch and roll, behind those of the device, where all six axes are on the bus."""
NOMINAL_US, DATA_US = 1.0, 0.2
"""Of a bit of a CAN FD frame at 1 and 5 Mbit/s."""


def six_axes(dictionary: Dictionary) -> list[Message]:
    """The frames of six drives: those of the wrist have what those of the device have, and TORQUE has six words.

    No WRIST: its angles are states. Highest priority first.
    """
    found: list[Message] = []
    last = dictionary.axes[-1]
    for message in dictionary.messages():
        if message.name == "WRIST":
            continue
        found.append(replace(message, bytes=12) if message.name == "TORQUE" else message)
        if message.name.endswith(f"_{last.name}"):
            found += [
                replace(
                    message,
                    name=f"{message.name[: -len(last.name)]}{name}",
                    cob=message.cob - last.node + node,
                )
                for name, node in zip(("YAW", "PITCH", "ROLL"), WRIST_NODES, strict=True)
            ]
    return sorted(found, key=lambda message: message.cob)


def _six_classic(dictionary: Dictionary) -> list[Timing]:
    """Six drives in classical frames: two torque frames of three words each."""
    messages = six_axes(dictionary)
    torque = next(m for m in messages if m.name == "TORQUE")
    others = [m for m in messages if m.name != "TORQUE"]
    pair = [
        replace(torque, name=name, cob=torque.cob + i, bytes=6)
        for i, name in enumerate(("TORQUE", "TORQUE_WRIST"))
    ]
    return timings([*others, *pair])


def six_cycle(dictionary: Dictionary, step_us: float = 50.0) -> Cycle:
    """One period of six axes on CAN FD, 1 and 5 Mbit/s, states of 8 bytes; as of `cycle`."""
    messages = [m for m in six_axes(dictionary) if m.rendering]
    cost = {m.name: fd_frame_us(m.bytes, NOMINAL_US, DATA_US) for m in messages}
    return _phases(messages, cost, float(dictionary.bus["period_us"]), step_us)


def layouts(dictionary: Dictionary) -> dict[str, list[Timing]]:
    """The bus as it is, the two that were rejected, CAN FD with 12-byte states (the velocity besides), and six axes."""
    messages = dictionary.messages()
    nodes = [axis.node for axis in dictionary.axes]
    default_emcy = [
        replace(m, cob=0x080 + (m.cob & 0x7F)) if m.name.startswith("EMCY") else m for m in messages
    ]
    per_axis = [m for m in default_emcy if m.name != "TORQUE" and not m.name.startswith("CONTROL")]
    torque = next(m for m in messages if m.name == "TORQUE")
    per_axis += [replace(torque, name=f"TORQUE_{n:X}", cob=0x200 + n, bytes=4) for n in nodes]
    return {
        "this one": timings(messages),
        "default EMCY identifiers": timings(default_emcy),
        "one torque frame per axis": timings(per_axis),
        "CAN FD, 1 and 5 Mbit/s": _fd_timings(messages),
        "six axes, classical": _six_classic(dictionary),
        "six axes, CAN FD": [
            replace(i, cost_us=fd_frame_us(length, NOMINAL_US, DATA_US))
            for i, length in _with_lengths(six_axes(dictionary))
        ],
    }


def _with_lengths(messages: Sequence[Message]) -> list[tuple[Timing, int]]:
    """Timings with the bytes of their frames, highest priority first. Their cost is for the caller to set."""
    return [
        (Timing(m.name, m.cob, 0.0, m.period_us, m.jitter_us, m.cyclic), m.bytes)
        for m in sorted(messages, key=lambda m: m.cob)
    ]


def _fd_timings(messages: Sequence[Message]) -> list[Timing]:
    """Every frame as CAN FD, the states with 12 bytes."""
    length = {m.name: 12 if m.name.startswith("STATE") else m.bytes for m in messages}
    return [replace(i, cost_us=fd_frame_us(length[i.name])) for i in timings(messages)]


def worst_cyclic_us(items: Sequence[Timing]) -> float | None:
    """The latest cyclic frame after the SYNC; None: no bound."""
    found = [r.response_us for r, i in zip(analyse(items), items, strict=True) if i.cyclic]
    return None if any(r is None for r in found) else max(r for r in found if r is not None)


# ----------------------------------------------------------------------------------------------------- event simulation


def _releases(
    items: Sequence[Timing], duration_us: float, dice: random.Random | None
) -> list[tuple[float, float, int]]:
    """(queued at, nominal release, message) in order of time: random, or the critical instant when there is no dice."""
    found: list[tuple[float, float, int]] = []
    for at, item in enumerate(items):
        start = -item.jitter_us if dice is None else dice.uniform(0, item.period_us)
        for count in range(ceil(duration_us / item.period_us)):
            nominal = start + count * item.period_us
            late = (
                item.jitter_us * (count == 0) if dice is None else dice.uniform(0, item.jitter_us)
            )
            found.append((nominal + late, nominal, at))
    return sorted(found)


def _run(
    items: Sequence[Timing], releases: Sequence[tuple[float, float, int]], now_us: float
) -> dict[str, float]:
    """Longest response of every message on a bus with arbitration and without preemption, idle from `now_us` on."""
    worst = {item.name: 0.0 for item in items}
    waiting: list[tuple[int, float]] = []
    index = 0
    while index < len(releases) or waiting:
        while index < len(releases) and releases[index][0] <= now_us:
            heappush(waiting, (releases[index][2], releases[index][1]))
            index += 1
        if not waiting:
            now_us = releases[index][0]
            continue
        at, nominal = heappop(waiting)
        now_us += items[at].cost_us
        worst[items[at].name] = max(worst[items[at].name], now_us - nominal)
    return worst


def simulate(items: Sequence[Timing], duration_us: float, seed: int) -> dict[str, float]:
    """Longest response of every message over a run with random phases and jitter."""
    return _run(items, _releases(items, duration_us, random.Random(seed)), 0.0)


def simulate_critical(items: Sequence[Timing], at: int, duration_us: float) -> float:
    """Response of message `at` when everything is released at once, as late as its jitter lets it, just after the
    longest frame of lower priority has started: the case that the analysis is about."""
    blocking = max((i.cost_us for i in items[at + 1 :]), default=0.0)
    above = items[: at + 1]
    return _run(above, _releases(above, duration_us, None), blocking)[items[at].name]
