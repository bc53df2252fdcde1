"""What the nodes of this package share: the log, the monitor and an orderly shutdown."""

from __future__ import annotations

import logging
from abc import abstractmethod

from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.live.monitor import Monitor
from rgbd_glue_ros.node.log import LoggedNode, RosLogHandler
from rgbd_glue_ros.parameters import PACKAGE

# How long a worker may take to finish: longer than the slowest frame, and shorter than a launch
# system waits before it kills the process.
CLOSE_S = 4.0


class BaseNode(Closing, LoggedNode):
    """A node with worker threads; use it as a context manager, which ends them.

    Attributes:
        monitor: counts processed and dropped frames, and remembers which faults were logged.
    """

    def __init__(self, name: str) -> None:
        """Creates the node, and sends the library's log messages to the node's log."""
        super().__init__(name)
        self.monitor = Monitor()
        self._log_handler = RosLogHandler(self)
        logging.getLogger(PACKAGE).addHandler(self._log_handler)

    def is_news(self, where: str, cause: str) -> bool:
        """Whether a fault is new and should be logged."""
        return self.monitor.is_news(where, cause)

    def warn_once(self, where: str, cause: str | None) -> None:
        """Logs a warning, unless one was logged before that differs only in its numbers."""
        if cause is not None and self.is_news(where, cause):
            self.get_logger().warning(f"{where}: {cause}")

    @abstractmethod
    def _finish(self) -> bool:
        """Ends the threads within ``CLOSE_S``; returns whether all have ended."""

    def close(self) -> None:
        """Ends the threads, then destroys the node; if a thread still runs, the node is kept."""
        has_ended = self._finish()
        logging.getLogger(PACKAGE).removeHandler(self._log_handler)
        if has_ended:
            self.destroy_node()
