"""The log of a node: non-printable characters are escaped, so no text can break or forge a line."""

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

# rclpy attributes a line to the function that logged it. To find it, it skips its own modules and
# those in this list.
rcutils_logger._internal_callers.append(str(Path(__file__).resolve()))  # noqa: SLF001


WITHOUT_FILE = ("--ros-args", "--disable-external-lib-logs")
"""ROS arguments that disable the log file; the console and /rosout remain."""


def explain_no_file() -> str | None:
    """Why ROS has no folder for log files, without which it does not start; None if it has one.

    Raises:
        InputError: ``ROS_LOG_DIR`` is set, and no file can be written there.
    """
    told = os.environ.get("ROS_LOG_DIR")
    folder = _log_folder()
    cause = "HOME is not set" if folder is None else _why_not_written(folder)
    if cause and told:
        raise InputError("ROS_LOG_DIR", cause, "set it to a writable folder")
    if cause:
        return f"The log is not written to a file: {cause}; set ROS_LOG_DIR to a writable folder"
    return None


def _log_folder() -> Path | None:
    """Where ROS keeps logs (rcl_logging_get_logging_directory); None if HOME is not set."""
    told, ros_home = os.environ.get("ROS_LOG_DIR"), os.environ.get("ROS_HOME")
    folder = Path(told or Path(ros_home or "~/.ros") / "log")
    if folder.parts[:1] != ("~",):
        return folder
    # ROS looks for no other home
    home = os.environ.get("HOME")
    return Path(home, *folder.parts[1:]) if home else None


def _why_not_written(folder: Path) -> str:
    """Why no file can be created in a folder, which is created if necessary; "" if one can."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return ""
    except OSError as error:
        return f"{folder}: {error.strerror}"


class PrintableLogger(rcutils_logger.RcutilsLogger):  # type: ignore[misc]
    """Escapes non-printable characters: names of frames, topics and types come from others."""

    def log(self, message: object, severity: Any, **kwargs: Any) -> bool:
        """Logs a line as rclpy's logger does."""
        return bool(super().log(printable(str(message)), severity, **kwargs))


class LoggedNode(Node):  # type: ignore[misc]
    """A node whose log contains only printable characters."""

    def get_logger(self) -> PrintableLogger:
        """The node's logger."""
        return self._printable_logger

    @cached_property
    def _printable_logger(self) -> PrintableLogger:
        return PrintableLogger(super().get_logger().name)


class RosLogHandler(logging.Handler):
    """Sends the library's log messages to a node's log, and so to /rosout."""

    def __init__(self, node: Node) -> None:
        super().__init__(logging.INFO)
        self.setFormatter(PrintableFormatter())
        # a PrintableLogger would join the lines of a traceback
        self._logger = rclpy.logging.get_logger(node.get_logger().name)

    def emit(self, record: logging.LogRecord) -> None:
        """Logs a record; rclpy requires a separate line of code for each severity."""
        text = self.format(record)
        if record.levelno >= logging.ERROR:
            self._logger.error(text)
        elif record.levelno >= logging.WARNING:
            self._logger.warning(text)
        else:
            self._logger.info(text)
