"""The only owner of background work: a second thread, and the values that it updates."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from threading import Lock
from typing import Concatenate, Generic, ParamSpec, TypeVar

from rgbd_glue_ros.errors import InputError

P = ParamSpec("P")
R = TypeVar("R")
V = TypeVar("V")


class BackgroundThread:
    """One thread for work that the caller does not need at once, done in the order of submission.

    No job waits for another: its inputs are complete before it is submitted.
    """

    def __init__(self) -> None:
        self._is_closed = False
        self._process = os.getpid()
        self._executor = ThreadPoolExecutor(1, thread_name_prefix="odometry_background")

    def submit(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> Future[R]:
        """Calls a function later; the future's ``result`` waits for it.

        Raises:
            InputError: the thread has ended.
        """
        self.check_open()
        return self._executor.submit(function, *args, **kwargs)

    def start(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> Once[R]:
        """As ``submit``; but if the thread has other jobs first, who asks for it does it.

        Raises:
            InputError: the thread has ended.
        """
        once = Once(function, *args, **kwargs)
        self.submit(once.result)
        return once

    def result(self, job: Future[R]) -> R:
        """The result of a submitted job; waits for it.

        Raises:
            InputError: the job was left behind by a fork of its process.
        """
        if not job.done():
            self.check_open()
        return job.result()

    def check_open(self) -> None:
        """Checks that jobs can still be submitted.

        Raises:
            InputError: the thread has ended, or was left behind by a fork of its process.
        """
        if self._is_closed:
            raise InputError("the odometry", "was closed", "create another one for more frames")
        if self._process != os.getpid():
            cause = "was created in another process, whose threads are not in this one"
            raise InputError("the odometry", cause, "create one in each process")

    def close(self) -> None:
        """Ends the thread once its jobs are done; nothing can be submitted after that."""
        self._is_closed = True
        self._executor.shutdown()


class Once(Generic[R]):
    """The result of a function that is called once, by the first thread that asks for it.

    Others wait for that call. If it fails, the next to ask calls the function again.
    """

    def __init__(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> None:
        self._call = partial(function, *args, **kwargs)
        self._lock = Lock()
        self._results: list[R] = []

    def result(self) -> R:
        """The result; calls the function if no thread has."""
        with self._lock:
            if not self._results:
                self._results.append(self._call())
            return self._results[0]


class BackgroundValue(Generic[V]):
    """A value that is read on the caller's thread and updated on the background thread."""

    def __init__(self, background: BackgroundThread, value: V) -> None:
        self._background = background
        self._value = value
        self._update: Future[V] | None = None

    def current(self) -> V:
        """The value; waits for a running update.

        A failed update raises once, and leaves the value before it.

        Raises:
            InputError: the update was left behind by a fork of its process.
        """
        if self._update is not None:
            update, self._update = self._update, None
            self._value = self._background.result(update)
        return self._value

    def replace(self, value: V) -> None:
        """Sets another value; a running update is dropped."""
        self._value, self._update = value, None

    def update_later(
        self, update: Callable[Concatenate[V, P], V], *args: P.args, **kwargs: P.kwargs
    ) -> None:
        """Replaces the value by ``update(value, ...)``, on the background thread."""
        self._update = self._background.submit(update, self.current(), *args, **kwargs)
