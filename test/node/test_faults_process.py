"""What the node's process does that is told to end, or does not find what it needs to begin."""

from __future__ import annotations

import itertools
import os
import signal
import time

import pytest

from rgbd_glue_ros.live.end_signals import END_SIGNALS

pytest.importorskip("rclpy", reason="ROS is not installed")

from rigs.faults import COMPILE_S, running_node
from rigs.ros import PATIENCE_S


@pytest.mark.parametrize("order", [END_SIGNALS, END_SIGNALS[::-1]], ids=str)
def test_signals_that_keep_coming_end_the_node_with_exit_code_0(
    ros_domain: int, order: tuple[signal.Signals, ...]
) -> None:
    with running_node(ros_domain) as node:
        node.wait_for_line("Subscribed", COMPILE_S)
        deadline = time.monotonic() + PATIENCE_S
        for how in itertools.cycle(order):
            if not node.is_running or time.monotonic() > deadline:
                break
            os.kill(node.pid, how)
        assert node.wait_for_end(0) == 0
        assert not [line for line in node.lines if "Traceback" in line]
