"""What a recording holds that cannot be used: skipped, counted and said once per cause."""

from __future__ import annotations

import logging

from rgbd_glue_ros.errors import InputError, without_numbers

logger = logging.getLogger(__name__)


class Faults:
    """Counts faults and logs each kind once; those that differ in numbers alone are of a kind.

    Attributes:
        count: of faults.
        first: fault of all, None without any.
    """

    def __init__(self) -> None:
        self.count = 0
        self.first: InputError | None = None
        self._kinds: set[str] = set()

    def add(self, error: InputError) -> None:
        """Counts one; says it if none of its kind was said."""
        self.count += 1
        self.first = self.first or error
        kind = without_numbers(str(error))
        if kind not in self._kinds:
            self._kinds.add(kind)
            logger.warning("%s; skipped, as will be all like it", error)
