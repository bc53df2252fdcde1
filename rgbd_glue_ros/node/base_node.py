"""What the nodes of this package have in common: the log, the monitor, and an end in order."""

from __future__ import annotations

import logging
from abc import abstractmethod

from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.live.monitor import Monitor
from rgbd_glue_ros.node.log import LoggedNode, RosLogHandler
from rgbd_glue_ros.parameters import PACKAGE

# How long work may take to end: longer than the slowest frame, and shorter than a launch system
# waits before it kills.
CLOSE_S = 4.0


class BaseNode(Closing, LoggedNode):
    """A node with a thread of its own; a context manager that ends it.

    Attributes:
        monitor: counts what becomes of frames, and remembers the faults that were logged.
    """

    def __init__(self, name: str) -> None:
        """Creates the node; what the library logs goes to its log from now on."""
        super().__init__(name)
        self.monitor = Monitor()
        self._log_handler = RosLogHandler(self)
        logging.getLogger(PACKAGE).addHandler(self._log_handler)

    def is_news(self, where: str, cause: str) -> bool:
        """Whether a fault deserves a line in the log."""
        return self.monitor.is_news(where, cause)

    def warn_once(self, where: str, cause: str | None) -> None:
        """Logs what is doubtful, unless a line that differs in numbers alone was logged before."""
        if cause is not None and self.is_news(where, cause):
            self.get_logger().warning(f"{where}: {cause}")

    @abstractmethod
    def _finish(self) -> bool:
        """Ends the threads, within ``CLOSE_S``; returns whether they have ended."""

    def close(self) -> None:
        """Ends the threads; the node lives on, until the process ends, while one of them does."""
        has_ended = self._finish()
        logging.getLogger(PACKAGE).removeHandler(self._log_handler)
        if has_ended:
            self.destroy_node()
