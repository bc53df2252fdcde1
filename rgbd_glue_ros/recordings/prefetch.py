"""Work done by threads ahead of its use, in order."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

# OpenCV releases the interpreter lock while it processes images, so two threads halve the time.
_THREADS = 2
_AHEAD = 4


def mapped_ahead(
    function: Callable[[Item], Result], items: Iterable[Item]
) -> Generator[Result, None, None]:
    """``map(function, items)``, with a few results computed by threads ahead of their use.

    An exception of ``function`` or ``items`` is raised in its turn, after the results before it.
    """
    source = iter(items)
    ended: Exception | None = None
    with ThreadPoolExecutor(_THREADS) as pool:
        results: deque[Future[Result]] = deque()
        try:
            while ended is None:
                try:
                    results.append(pool.submit(function, next(source)))
                except Exception as error:  # noqa: BLE001 (any; it is raised again below)
                    ended = error
                if len(results) > _AHEAD:
                    yield results.popleft().result()
            while results:
                yield results.popleft().result()
        finally:
            for result in results:
                result.cancel()
    if not isinstance(ended, StopIteration):
        raise ended
