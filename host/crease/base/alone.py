"""What one thread at a time may use: C code runs without the interpreter's lock, and knows nothing of threads."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial, wraps
from typing import Concatenate, NoReturn, ParamSpec, TypeVar

from crease.base.errors import CreaseError

P = ParamSpec("P")
R = TypeVar("R")
S = TypeVar("S")


class Alone:
    """A lock that nobody waits for: another thread is told so. The same thread may enter again.

        with alone: ...

    `enter`, `refuse` and `leave` are the same at half the cost, for a tick.
    """

    __slots__ = ("_what", "enter", "leave")

    def __init__(self, what: str) -> None:
        """what: it is, for the message: `world`."""
        lock = threading.RLock()
        self._what = what
        self.leave = lock.release
        self.enter: Callable[[], bool] = partial(lock.acquire, False)

    def refuse(self) -> NoReturn:
        """Errors: CreaseError, always."""
        raise CreaseError(
            f"{self._what}: used by two threads at once; make one {self._what} a thread: they may share a scene"
        )

    def __enter__(self) -> None:
        if not self.enter():
            self.refuse()

    def __exit__(self, *_: object) -> None:
        self.leave()


def stays(kind: str, instead: str) -> NoReturn:
    """For `__reduce__` of what is memory of this process.   Errors: TypeError, always."""
    raise TypeError(f"a {kind} is memory of this process and no pickle holds it; {instead}")


def alone(method: Callable[Concatenate[S, P], R]) -> Callable[Concatenate[S, P], R]:
    """A method that only one thread at a time is in, of an object whose `_alone` is an `Alone`."""

    @wraps(method)
    def guarded(self: S, /, *args: P.args, **kwargs: P.kwargs) -> R:
        with self._alone:  # type: ignore[attr-defined]
            return method(self, *args, **kwargs)

    return guarded
