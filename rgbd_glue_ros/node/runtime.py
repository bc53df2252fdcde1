"""What runs a node and outlives its faults: start of ROS, executor, log."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Any, Protocol

import rclpy
from rclpy._rclpy_pybind11 import RCLError, UnknownROSArgsError
from rclpy.clock import Clock, ClockType
from rclpy.executors import ConditionReachedException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from rgbd_glue_ros.errors import InputError, MissingExtraError
from rgbd_glue_ros.live.end_signals import EndSignals

# DDS tells of a node's topics before it tells its name.
NAMES_S = 1.0

logger = logging.getLogger(__name__)


def init(args: list[str] | None) -> None:
    """Starts ROS, with the signals left to the process.

    rclpy's handlers would take the context away from a frame that is still in work.

    Raises:
        InputError: the ROS arguments make no sense.
    """
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except (RCLError, UnknownROSArgsError) as error:
        # what follows are places in rcl's source
        cause = str(error).partition(", at /")[0]
        raise InputError("ROS arguments", cause, "give --ros-args -p name:=value") from error


class NodeExecutor(SingleThreadedExecutor):  # type: ignore[misc]
    """Goes on after an exception, as of a message that cannot be deserialised."""

    def __init__(self, node: Node, is_news: Callable[[str, str], bool]) -> None:
        """Takes a node.

        Args:
            node: the node.
            is_news: whether a fault, given by its place and cause, deserves a line in the log.
        """
        super().__init__()
        self.add_node(node)
        self._is_news = is_news

    def spin_until(self, is_over: Callable[[], bool]) -> None:
        """Runs callbacks until ``is_over``, which is looked at after each and after ``wake``.

        To end this by ``shutdown`` from another thread is a race: it takes away what is waited on.
        """
        while not is_over():
            self._run_one(is_over)

    def _run_one(self, is_over: Callable[[], bool]) -> None:
        try:
            callback, _, _ = self.wait_for_ready_callbacks(condition=is_over)
            callback()
            callback.result()
        except ConditionReachedException:
            pass
        except Exception as error:
            if self._is_news("a callback", repr(error)):
                logger.exception("A callback failed; going on")


class RunningNode(Protocol):
    """A node that ends in order when it is left."""

    def is_news(self, where: str, cause: str) -> bool:
        """Whether a fault deserves a line in the log."""

    def __enter__(self) -> RunningNode: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...


def run_node(
    name: str,
    create: Callable[[Callable[[], None]], RunningNode],
    args: list[str] | None,
    end_signals: EndSignals | None = None,
) -> int:
    """Runs a node until SIGINT or SIGTERM, or until it cannot go on.

    Args:
        name: of the node, for what goes wrong before there is one.
        create: makes it, given what it calls, from any thread, when it cannot go on.
        args: ROS arguments; None takes the process's.
        end_signals: where they were taken over before; None takes them over here.

    Returns:
        The exit code: 0, or 2 when an argument or parameter has a value that it cannot have, or 1
        when it could not go on.
    """
    end_signals = end_signals or EndSignals()
    told_to_end, has_failed = threading.Event(), threading.Event()

    def give_up() -> None:
        has_failed.set()
        end_signals.end()

    try:
        init(args)
        with create(give_up) as node:
            executor = NodeExecutor(node, node.is_news)
            spinning = threading.Thread(
                target=executor.spin_until, args=[told_to_end.is_set], daemon=True
            )
            spinning.start()
            end_signals.wait()
            told_to_end.set()
            executor.wake()
            spinning.join()
            executor.shutdown()
    except (InputError, MissingExtraError) as error:
        rclpy.logging.get_logger(name).fatal(str(error))
        return 2
    finally:
        rclpy.try_shutdown()
    return 1 if has_failed.is_set() else 0


def say_later(node: Node, line: Callable[[], str]) -> None:
    """Logs an error after ``NAMES_S``, when the names of nodes just met are known."""

    def say() -> None:
        timer.cancel()
        node.destroy_timer(timer)
        node.get_logger().error(line())

    timer = node.create_timer(NAMES_S, say, clock=Clock(clock_type=ClockType.STEADY_TIME))


class RosLogHandler(logging.Handler):
    """Sends what the library logs to the node's logger, and so to /rosout."""

    def __init__(self, logger: Any) -> None:
        super().__init__(logging.INFO)
        self._logger = logger

    def emit(self, record: logging.LogRecord) -> None:
        """Logs a record; each severity from a line of its own, as rclpy demands."""
        text = self.format(record)
        if record.levelno >= logging.ERROR:
            self._logger.error(text)
        elif record.levelno >= logging.WARNING:
            self._logger.warning(text)
        else:
            self._logger.info(text)
