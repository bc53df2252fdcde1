"""What runs the node, in this process."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator

import pytest

pytest.importorskip("rclpy", reason="ROS is not installed")

import rclpy
from rclpy.node import Node

from rgbd_glue_ros.node.base_node import BaseNode
from rgbd_glue_ros.node.input_watch import explain_namesakes
from rgbd_glue_ros.node.runtime import NodeExecutor

PATIENCE_S = 10.0


class WorkedNode(BaseNode):
    """Keeps what its callbacks raised."""

    def __init__(self) -> None:
        super().__init__("worked")
        self.failures: list[str] = []

    def report_failure(self, what_failed: str, error: Exception) -> None:
        super().report_failure(what_failed, error)
        self.failures.append(repr(error))

    def _finish(self) -> bool:
        return True


@pytest.fixture
def node(ros_domain: int) -> Iterator[WorkedNode]:
    rclpy.init(domain_id=ros_domain)
    with WorkedNode() as node:
        yield node
    rclpy.shutdown()


def run(node: BaseNode, until: Callable[[], bool]) -> None:
    """Spins on another thread until a condition holds, which this thread notices."""
    over = threading.Event()
    executor = NodeExecutor(node)
    spinning = threading.Thread(target=executor.spin_until, args=[over.is_set], daemon=True)
    spinning.start()
    while not until():
        executor.wake()
    over.set()
    executor.wake()
    spinning.join(PATIENCE_S)
    assert not spinning.is_alive()
    executor.shutdown()


def test_the_executor_ends_without_an_error_however_busy_it_is(node: WorkedNode) -> None:
    calls: list[None] = []
    node.create_timer(1e-4, lambda: calls.append(None))
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)  # so that threads meet at every place
    try:
        for _ in range(50):
            calls.clear()
            run(node, lambda: bool(calls))
    finally:
        sys.setswitchinterval(interval)
    assert not node.failures


def test_the_executor_continues_after_a_failed_callback(node: WorkedNode) -> None:
    calls: list[None] = []

    def fail() -> None:
        calls.append(None)
        raise ValueError("as a callback may")

    node.create_timer(1e-3, fail)
    run(node, lambda: len(calls) > 3)
    assert set(node.failures) == {"ValueError('as a callback may')"}
    assert len(node.failures) == len(calls) > 3


def test_a_second_node_with_the_same_name_is_reported(node: Node) -> None:
    assert explain_namesakes(node) is None
    namesake = Node("worked")
    deadline = time.monotonic() + PATIENCE_S
    while (line := explain_namesakes(node)) is None:
        assert time.monotonic() < deadline
    assert line.startswith("/worked is also the name of 1 other")
    namesake.destroy_node()
