"""Unusable parts of a recording: skipped, counted, and each kind logged once."""

from __future__ import annotations

import logging

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.fault_news import FaultNews

logger = logging.getLogger(__name__)


class Faults:
    """Counts faults, and logs new kinds.

    Attributes:
        count: number of faults.
        first: the first one; None without any.
    """

    def __init__(self) -> None:
        self.count = 0
        self.first: InputError | None = None
        self._news = FaultNews()

    def add(self, error: InputError) -> None:
        """Counts a fault, and logs it unless one of its kind was logged."""
        self.count += 1
        self.first = self.first or error
        if self._news.is_news(error.where, error.cause):
            logger.warning("%s; skipped, as all like it will be", error)
