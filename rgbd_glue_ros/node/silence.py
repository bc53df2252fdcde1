"""Logs why nothing complete arrives: each cause once, and as a fault only where it is one."""

from __future__ import annotations

from rclpy.node import Node

from rgbd_glue_ros.live.first_publishers import FirstPublishers, Silence
from rgbd_glue_ros.messages.fault_news import FaultNews


class SilenceLog:
    """Logs silence of a node's input, from one check to the next."""

    def __init__(self, node: Node, source: str) -> None:
        """Begins before the first check.

        Args:
            node: provides the log.
            source: what there must be before silence is a fault, such as ``publishers``.
        """
        self._node = node
        self._source = source
        self._first = FirstPublishers()
        self._news = FaultNews()

    def look(self, line: str | None, *, has_publishers: bool, has_messages: bool) -> None:
        """Logs why nothing arrives, if that is new; to be called at each check.

        Args:
            line: why nothing complete has arrived since the last check; None if something has.
            has_publishers: as for ``FirstPublishers.judge``.
            has_messages: the same.
        """
        verdict = self._first.judge(has_publishers=has_publishers, has_messages=has_messages)
        if line is None:
            self._news.forget()
        # a line that differs only in its counts is not news
        elif verdict is Silence.TOO_EARLY or not self._news.is_news(verdict.name, line):
            return
        elif verdict is Silence.WAITING:
            self._node.get_logger().info(f"Waiting for {self._source}. {line}")
        else:
            self._node.get_logger().warning(line)
