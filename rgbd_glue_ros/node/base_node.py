"""What the nodes of this package share: the log, the monitor and an orderly shutdown."""

from __future__ import annotations

import logging
from abc import abstractmethod

from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.live.monitor import Monitor
from rgbd_glue_ros.node.log import LoggedNode, RosLogHandler
from rgbd_glue_ros.parameters import PACKAGE

logger = logging.getLogger(__name__)

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

    def report(self, fault: InputError) -> None:
        """Logs that something cannot be used as an error, if ``monitor.is_news``."""
        if self.monitor.is_news(fault.where, fault.cause):
            self.get_logger().error(f"{fault} (logged once)")

    def report_failure(self, what_failed: str, error: Exception) -> None:
        """Logs an exception of this code with its traceback, if it is news.

        Args:
            what_failed: what it prevented.
            error: the exception, which is being handled.
        """
        if self.monitor.is_news(what_failed, repr(error)):
            logger.exception("%s; continuing", what_failed)

    def warn_once(self, where: str, cause: str | None) -> bool:
        """Logs a warning if it is news, and returns whether it was; None and "" are none."""
        if not (cause and self.monitor.is_news(where, cause)):
            return False
        self.get_logger().warning(f"{where}: {cause} (logged once)")
        return True

    @abstractmethod
    def _finish(self) -> bool:
        """Ends the threads within ``CLOSE_S``; returns whether all have ended."""

    def close(self) -> None:
        """Ends the threads, then destroys the node; if a thread still runs, the node is kept."""
        has_ended = self._finish()
        logging.getLogger(PACKAGE).removeHandler(self._log_handler)
        if has_ended:
            self.destroy_node()
