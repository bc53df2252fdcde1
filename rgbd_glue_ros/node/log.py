"""The log of a node: its lines are lines and steer no terminal, whatever they name."""

from __future__ import annotations

import logging
import os
import tempfile
from functools import cached_property
from pathlib import Path
from typing import Any

import rclpy
from rclpy.impl import rcutils_logger
from rclpy.node import Node

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.printable import PrintableFormatter, printable

# A line is attributed to the function that wrote it. rclpy passes over its own modules, and over
# those that others add to this list.
rcutils_logger._internal_callers.append(str(Path(__file__).resolve()))  # noqa: SLF001


WITHOUT_FILE = ("--ros-args", "--disable-external-lib-logs")
"""ROS arguments that keep ROS from writing its log to a file too."""


def explain_no_file() -> str | None:
    """Why ROS has no folder for files of its log, in which case it does not start; None if it has.

    Raises:
        InputError: ``ROS_LOG_DIR`` says where they belong, and they cannot be there.
    """
    told = os.environ.get("ROS_LOG_DIR")
    folder = _log_folder()
    cause = "HOME is not set" if folder is None else _why_not_written(folder)
    if cause and told:
        raise InputError("ROS_LOG_DIR", cause, "set it to a folder that can be written to")
    if cause:
        return f"The log is kept in no file: {cause}; set ROS_LOG_DIR to a folder for it"
    return None


def _log_folder() -> Path | None:
    """Where ROS keeps logs (rcl_logging_get_logging_directory); None for want of a home."""
    told, ros_home = os.environ.get("ROS_LOG_DIR"), os.environ.get("ROS_HOME")
    folder = Path(told or Path(ros_home or "~/.ros") / "log")
    if folder.parts[:1] != ("~",):
        return folder
    # ROS does not look for another home than this
    home = os.environ.get("HOME")
    return Path(home, *folder.parts[1:]) if home else None


def _why_not_written(folder: Path) -> str:
    """Why no file can be made in a folder, which is made if need be; "" if one can."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return ""
    except OSError as error:
        return f"{folder}: {error.strerror}"


class PrintableLogger(rcutils_logger.RcutilsLogger):  # type: ignore[misc]
    """Writes out what is not printable: others choose the names of frames, topics and types."""

    def log(self, message: object, severity: Any, **kwargs: Any) -> bool:
        """Logs a line as rclpy's logger does."""
        return bool(super().log(printable(str(message)), severity, **kwargs))


class LoggedNode(Node):  # type: ignore[misc]
    """A node whose log is printable."""

    def get_logger(self) -> PrintableLogger:
        """The node's logger."""
        return self._printable_logger

    @cached_property
    def _printable_logger(self) -> PrintableLogger:
        return PrintableLogger(super().get_logger().name)


class RosLogHandler(logging.Handler):
    """Sends what the library logs to a node's log, and so to /rosout."""

    def __init__(self, node: Node) -> None:
        super().__init__(logging.INFO)
        self.setFormatter(PrintableFormatter())
        # a traceback has lines of its own, which a PrintableLogger would make one of
        self._logger = rclpy.logging.get_logger(node.get_logger().name)

    def emit(self, record: logging.LogRecord) -> None:
        """Logs a record; each severity from a line of its own, as rclpy demands."""
        text = self.format(record)
        if record.levelno >= logging.ERROR:
            self._logger.error(text)
        elif record.levelno >= logging.WARNING:
            self._logger.warning(text)
        else:
            self._logger.info(text)
