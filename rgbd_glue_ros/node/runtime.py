"""Starts ROS, and keeps a node running whatever it receives."""

from __future__ import annotations

import logging
import os
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import rclpy
from rclpy._rclpy_pybind11 import RCLError, UnknownROSArgsError
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import ConditionReachedException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from rgbd_glue_ros.errors import BAD_INPUT, InputError, MissingExtraError
from rgbd_glue_ros.live.end_signals import EndSignals
from rgbd_glue_ros.live.remappings import explain_misspelt
from rgbd_glue_ros.live.shared_memory import SHARED_MEMORY, explain_shared_memory
from rgbd_glue_ros.node.base_node import BaseNode
from rgbd_glue_ros.node.log import WITHOUT_FILE, PrintableLogger, explain_no_file
from rgbd_glue_ros.parameters import PROFILES_VARIABLE

# Time until the name of a newly discovered node is known: DDS announces its topics first.
NAMES_S = 1.0
# How long the current callback may still take at shutdown.
END_S = 2.0
# The highest ROS domain that has ports (RTPS 2.2, 9.6.1.1).
LAST_DOMAIN = 232
# What keeps a node from running, for a user to correct.
_UNUSABLE = (
    InputError,
    MissingExtraError,
    ParameterException,
    NameValidationException,
    RCLError,
)


class GiveUp(Protocol):
    """A function that ends the node; any thread may call it."""

    def __call__(self, fault: InputError | MissingExtraError | None = None) -> None:
        """Ends the node, because of invalid input, or because of what has been logged already."""


def init(name: str, args: list[str] | None) -> None:
    """Starts ROS without its signal handlers, which would end the context during a frame.

    Args:
        name: name of the node, for messages that are logged before it exists.
        args: ROS arguments; None uses those of the process.

    Raises:
        InputError: the ROS arguments or environment variables are invalid.
    """
    check_domain(os.environ.get("ROS_DOMAIN_ID", ""))
    no_file = explain_no_file()
    if no_file is not None:
        args = [*(sys.argv if args is None else args), *WITHOUT_FILE]
    init_context(args, signal_handler_options=SignalHandlerOptions.NO)
    if no_file is not None:
        PrintableLogger(name).warning(no_file)


def init_context(args: list[str] | None, **options: Any) -> None:
    """Initialises a ROS context, as ``rclpy.init`` does.

    Args:
        args: ROS arguments; None uses those of the process.
        options: of ``rclpy.init``.

    Raises:
        InputError: the ROS arguments are invalid.
    """
    try:
        rclpy.init(args=args, **options)
    except (RuntimeError, UnknownROSArgsError) as error:
        raise _init_fault(error) from error


def check_domain(domain: str) -> None:
    """Refuses a ROS domain without ports, for which DDS would only say that ports are too high.

    Args:
        domain: the environment variable ``ROS_DOMAIN_ID``; "" if it is not set.

    Raises:
        InputError: it is not a whole number from 0 to 232.
    """
    if domain and not (domain.isdecimal() and int(domain) <= LAST_DOMAIN):
        remedy = f"set it to a whole number from 0 to {LAST_DOMAIN}, or unset it"
        raise InputError("ROS_DOMAIN_ID", f"is {domain!r}", remedy)


def _init_fault(error: Exception) -> InputError:
    """Why ROS did not start, as an error that says what to correct."""
    # cut off the places in rcl's source that follow
    cause = str(error).partition(", at /")[0]
    cause = cause.removeprefix("failed to initialize rcl: ")
    if "remap rule" in cause:
        remedy = "give -r FROM:=TO, with names of letters, digits, _ and /, as in -r __ns:=/robot"
    elif "opening YAML file" in cause:
        remedy = "check the path"
    elif "params file" in cause:
        remedy = "give a file as `rgbd-glue params` prints it"
    else:
        remedy = "give --ros-args -p name:=value"
    return InputError("ROS arguments", cause, remedy)


def _warn_of_shared_memory(name: str) -> None:
    """Warns if there is too little shared memory to pass images between processes."""
    try:
        profiles = Path(os.environ.get(PROFILES_VARIABLE, "")).read_text(encoding="utf-8")
        memory = os.statvfs(SHARED_MEMORY)
    except (OSError, UnicodeDecodeError):
        return
    doubt = explain_shared_memory(profiles, memory.f_blocks * memory.f_frsize)
    if doubt:
        PrintableLogger(name).warning(doubt)


class NodeExecutor(SingleThreadedExecutor):  # type: ignore[misc]
    """An executor that continues after exceptions, for example of a malformed message."""

    def __init__(self, node: BaseNode) -> None:
        """Adds a node, which reports the exceptions of its callbacks."""
        super().__init__()
        self.add_node(node)
        self._node = node

    def spin_until(self, is_over: Callable[[], bool]) -> None:
        """Runs callbacks until ``is_over``, which is checked after each and after ``wake``.

        Calling ``shutdown`` from another thread instead is a race: it destroys what is waited on.
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
        except InputError as fault:
            self._node.report(fault)
        except Exception as error:
            self._node.report_failure("A callback failed", error)


def run_node(
    name: str,
    create: Callable[[GiveUp], BaseNode],
    args: list[str] | None,
    end_signals: EndSignals | None = None,
) -> int:
    """Runs a node until SIGINT, SIGTERM or SIGHUP, or until it gives up.

    Args:
        name: name of the node, for errors that occur before it exists.
        create: creates the node; its argument is a function that the node calls, from any thread,
            to give up.
        args: ROS arguments; None uses those of the process.
        end_signals: the signal handlers, if installed already; None installs them here.

    Returns:
        The exit code: 0 after a signal, 1 if the node gave up, 2 if an argument or parameter is
        invalid or ROS does not start.
    """
    end_signals = end_signals or EndSignals()
    has_failed = threading.Event()
    faults: list[InputError | MissingExtraError] = []

    def give_up(fault: InputError | MissingExtraError | None = None) -> None:
        has_failed.set()
        if fault is not None:
            faults.append(fault)
        end_signals.end()

    try:
        init(name, args)
        _warn_of_shared_memory(name)
        with create(give_up) as node:
            for line in explain_misspelt(sys.argv if args is None else args, node.get_name()):
                node.get_logger().warning(line)
            _spin_until_end(node, end_signals)
        if faults:
            raise faults[0]
    except _UNUSABLE as error:
        PrintableLogger(name).fatal(_explained(error))
        return BAD_INPUT
    finally:
        rclpy.try_shutdown()
    return _end_process(1 if has_failed.is_set() else 0)


def _spin_until_end(node: BaseNode, end_signals: EndSignals) -> None:
    """Calls the node's callbacks on another thread until a signal, or until the node gives up."""
    told_to_end = threading.Event()
    executor = NodeExecutor(node)
    spinning = threading.Thread(target=executor.spin_until, args=[told_to_end.is_set], daemon=True)
    spinning.start()
    end_signals.wait()
    told_to_end.set()
    executor.wake()
    spinning.join(END_S)
    if not spinning.is_alive():  # else a callback waits for the worker, closed next
        executor.shutdown()


def _explained(error: Exception) -> str:
    """Why a node cannot run, and what to do about it."""
    if isinstance(error, (ParameterException, NameValidationException)):
        # from a parameter that rclpy itself declares, such as use_sim_time
        return f"ROS arguments: {error}; correct it"
    if isinstance(error, RCLError):
        cause = str(error).partition(", at /")[0]
        return f"ROS does not start: {cause}; see the lines of the middleware above"
    return str(error)


def _end_process(code: int) -> int:
    """Returns the exit code, or ends the process with it here if a daemon thread still runs.

    The interpreter's shutdown would stop such a thread in the middle of C++ code, for example of
    PyTorch, and that aborts the process.
    """
    if any(thread.daemon for thread in threading.enumerate()):
        logging.shutdown()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    return code


def say_later(node: Node, line: Callable[[], str]) -> None:
    """Logs an error after ``NAMES_S``, when the names of newly discovered nodes are known."""

    def say() -> None:
        timer.cancel()
        node.destroy_timer(timer)
        node.get_logger().error(line())

    timer = node.create_timer(NAMES_S, say, clock=Clock(clock_type=ClockType.STEADY_TIME))
