"""A node that refuses what it is given, in this process: one of its own takes a second to start."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from rgbd_glue_ros.errors import BAD_INPUT
from rgbd_glue_ros.experiments.demo.node_process import ros_environment
from rgbd_glue_ros.live.end_signals import EndSignals
from rgbd_glue_ros.node.base_node import BaseNode
from rgbd_glue_ros.parameters import PACKAGE, Value
from rigs.ros import PATIENCE_S

Main = Callable[[list[str], EndSignals, dict[str, Value]], int]


class _NoSignals(EndSignals):
    """Leaves this process's handlers as they are, and a node that refuses nothing has to end."""

    def __init__(self) -> None:
        self._is_over = threading.Event()

    def end(self) -> None:
        self._is_over.set()

    def wait(self) -> None:
        self._is_over.wait(PATIENCE_S)


@contextmanager
def _nothing_left() -> Iterator[None]:
    """Destroys nodes that are refused while they are made: else the end of their process does."""
    made: list[BaseNode] = []
    package = logging.getLogger(PACKAGE)
    handlers, original = package.handlers[:], BaseNode.__init__

    def make(node: BaseNode, name: str) -> None:
        original(node, name)
        made.append(node)

    try:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(BaseNode, "__init__", make)
            yield
    finally:
        package.handlers[:] = handlers
        for node in made:
            node.destroy_node()


def refusal(
    main: Main,
    domain: int,
    capfd: pytest.CaptureFixture[str],
    parameters: dict[str, object],
    camera: dict[str, Value] | None = None,
) -> str:
    """The only fatal line of a node that ends with exit code 2, without what is before its text.

    Args:
        main: that of the node's module.
        domain: a ROS domain for it alone.
        capfd: has nothing else to read; what a node says is written by C.
        parameters: its ROS parameters, by name, as YAML.
        camera: what a camera preset sets.
    """
    words = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
    with pytest.MonkeyPatch.context() as patch, _nothing_left():
        for name, text in ros_environment(domain).items():
            patch.setenv(name, text)
        assert main(["--ros-args", *words], _NoSignals(), camera or {}) == BAD_INPUT
    lines = capfd.readouterr().err.splitlines()
    assert not [line for line in lines if "Traceback" in line]
    (fatal,) = [line for line in lines if "[FATAL]" in line]
    return fatal.partition("]: ")[2]
