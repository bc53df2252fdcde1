"""Unusable parts of a recording: skipped, counted, and each kind logged once."""

from __future__ import annotations

import logging

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.fault_news import FaultNews

logger = logging.getLogger(__name__)


class Faults:
    """Counts faults, and logs new kinds once it is known that they are only skipped.

    A recording in which nothing is usable ends with its first fault as an error, which is not to be
    logged before.

    Attributes:
        count: number of faults.
        first: the first one; None without any.
    """

    def __init__(self) -> None:
        self.count = 0
        self.first: InputError | None = None
        self._news = FaultNews()
        self._are_skipped = False
        self._unlogged: list[InputError] = []

    def add(self, error: InputError) -> None:
        """Counts a fault, and logs it unless one of its kind was logged."""
        self.count += 1
        self.first = self.first or error
        if self._news.is_news(error.where, error.cause):
            self._unlogged.append(error)
        self._log()

    def are_skipped(self) -> None:
        """Logs the faults so far, and those to come: the recording is used without them."""
        self._are_skipped = True
        self._log()

    def _log(self) -> None:
        if self._are_skipped:
            for error in self._unlogged:
                logger.warning("%s; skipped, as all like it will be", error)
            self._unlogged.clear()
