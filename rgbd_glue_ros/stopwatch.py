"""Measures wall time."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


def timed(function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> tuple[R, float]:
    """The result of a function, and the milliseconds it took."""
    start = perf_counter()
    result = function(*args, **kwargs)
    return result, (perf_counter() - start) * 1e3


class Stopwatch:
    """Wall time between calls of ``lap``, by name.

    Attributes:
        laps_ms: milliseconds.
    """

    def __init__(self) -> None:
        self.laps_ms: dict[str, float] = {}
        self._last = perf_counter()

    def lap(self, name: str) -> None:
        """Ends the lap of that name and starts the next."""
        now = perf_counter()
        self.laps_ms[name] = (now - self._last) * 1e3
        self._last = now
