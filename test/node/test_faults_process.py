"""What the node's process does that is told to end, or does not find what it needs to begin."""

from __future__ import annotations

import itertools
import os
import signal
import time
from pathlib import Path

import numba
import pytest

from rgbd_glue_ros.closing import END_SIGNALS
from rgbd_glue_ros.code_cache import CodeCache
from rgbd_glue_ros.experiments.demo.node_process import NodeProcess, ros_environment
from rgbd_glue_ros.geometry.fitting import procrustes
from rgbd_glue_ros.odometry.warm_up import warm_up
from rgbd_glue_ros.parameters import load_preset

pytest.importorskip("rclpy", reason="ROS is not installed")

from rigs.faults import COMPILE_S, rig_node, running_node, shown
from rigs.ros import PATIENCE_S, START_NS, Rig, corner_frame


@pytest.mark.slow
@pytest.mark.parametrize("order", [END_SIGNALS, END_SIGNALS[::-1]], ids=str)
def test_repeated_signals_end_the_node_with_exit_code_0(
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


@pytest.mark.slow
def test_a_node_that_cannot_process_any_frame_ends_with_exit_code_1(ros_domain: int) -> None:
    with rig_node(ros_domain, "unusable_node") as node:
        node.wait_for_line("Warming up failed", PATIENCE_S)
        assert node.wait_for_end(PATIENCE_S) == 1


def test_a_signal_while_pytorch_computes_ends_the_node_with_exit_code_0(
    ros_domain: int,
) -> None:
    pytest.importorskip("torch")
    with rig_node(ros_domain, "busy_node") as node:
        node.wait_for_line("convolving", PATIENCE_S)
        os.kill(node.pid, signal.SIGINT)
        assert node.wait_for_end(PATIENCE_S) == 0
        assert not [line for line in node.lines if "terminate" in line]


def leave_empty(files: list[Path], folder: Path) -> None:
    """Leaves files of these names, as a power cut leaves what was not on the disk yet."""
    for path in files:
        (folder / path.name).write_bytes(b"")


@pytest.mark.slow
@pytest.mark.every_python
def test_with_a_damaged_cache_of_compiled_code_no_pose_is_lost(
    ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    warm_up(load_preset("live"))  # what the private folder lacks comes from beside the sources
    files = [*Path(procrustes.stats.cache_path).glob("*.nb?")]  # type: ignore[attr-defined]
    numba.config.reload_config()  # else the first compilation would, if the environment has changed
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    leave_empty(files, Path(CodeCache(procrustes.py_func).cache_path))  # type: ignore[attr-defined]
    with shown(
        NodeProcess({}, {**ros_environment(ros_domain), "NUMBA_CACHE_DIR": str(tmp_path)})
    ) as node:
        node.wait_for_line("is damaged", COMPILE_S)
        with Rig(ros_domain) as rig:
            rig.wait_until_matched()
            rig.pose_of(corner_frame(START_NS))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("variable", "value", "where"),
    [
        ("ROS_LOG_DIR", f"{__file__}/log", f"ROS_LOG_DIR: {__file__}/log: Not a directory"),
        ("ROS_DOMAIN_ID", "500", "ROS_DOMAIN_ID: is '500'; set it to a whole number from 0 to 232"),
        ("ROS_DOMAIN_ID", "abc", "ROS_DOMAIN_ID: is 'abc'; set it to a whole number from 0 to 232"),
    ],
)
def test_an_environment_variable_that_keeps_ros_from_starting_is_named_with_the_remedy(
    ros_domain: int, variable: str, value: str, where: str
) -> None:
    with shown(NodeProcess({}, {**ros_environment(ros_domain), variable: value})) as node:
        node.wait_for_line(where, PATIENCE_S)
        assert node.wait_for_end(PATIENCE_S) == 2
        assert not [line for line in node.lines if "Traceback" in line]


def test_without_a_home_the_node_runs_and_says_that_there_is_no_log_file(
    ros_domain: int,
) -> None:
    nowhere = dict.fromkeys(("HOME", "ROS_LOG_DIR", "ROS_HOME"), "")
    environment = {**ros_environment(ros_domain), **nowhere}
    with shown(NodeProcess({}, environment)) as node:
        node.wait_for_line("Warming up", PATIENCE_S)
        first, *_ = node.lines
        assert "The log is not written to a file" in first
        assert "set ROS_LOG_DIR" in first
        # neither ROS nor anything else has more to say
        assert all(line.startswith("[") for line in node.lines)


def test_an_invalid_parameter_of_ros_itself_is_named(ros_domain: int) -> None:
    with running_node(ros_domain, use_sim_time="maybe") as node:
        node.wait_for_line("ROS arguments: Trying to set parameter 'use_sim_time'", PATIENCE_S)
        assert node.wait_for_end(PATIENCE_S) == 2
        assert not [line for line in node.lines if "Traceback" in line]
