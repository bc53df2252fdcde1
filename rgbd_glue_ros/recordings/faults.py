"""Unusable parts of a recording: skipped, counted and logged once per cause."""

from __future__ import annotations

import logging

from rgbd_glue_ros.errors import InputError, without_numbers

logger = logging.getLogger(__name__)


class Faults:
    """Counts faults and logs each kind once; those that differ only in numbers are of one kind.

    Attributes:
        count: number of faults.
        first: the first fault, None without any.
    """

    def __init__(self) -> None:
        self.count = 0
        self.first: InputError | None = None
        self._kinds: set[str] = set()

    def add(self, error: InputError) -> None:
        """Counts a fault; logs it if none of its kind was logged."""
        self.count += 1
        self.first = self.first or error
        kind = without_numbers(str(error))
        if kind not in self._kinds:
            self._kinds.add(kind)
            logger.warning("%s; skipped, as will be all like it", error)
