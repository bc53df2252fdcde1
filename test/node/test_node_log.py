"""The node's log is lines of printable text, whatever it names, through the node over real DDS."""

from __future__ import annotations

import logging
from dataclasses import replace
from itertools import count
from pathlib import Path

import pytest

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.live import topics
from rgbd_glue_ros.types import NANOSECONDS

pytest.importorskip("rclpy", reason="ROS is not installed")

import rclpy
from rcl_interfaces.msg import Log
from rclpy.context import Context
from rigs.faults import running_node
from rigs.ros import PATIENCE_S, START_NS, Rig, corner_frame
from std_srvs.srv import Trigger

from rgbd_glue_ros.node.log import LoggedNode, RosLogHandler, explain_no_file

HOSTILE = "\x1b]0;gone\x07\x1b[2J\r\n[INFO] all is well \u202eexe \x9b31m"
ESCAPED = r"\x1b]0;gone\x07\x1b[2J\r\n[INFO] all is well \u202eexe \x9b31m"
PERIOD_NS = NANOSECONDS // 30


def test_frames_and_files_with_hostile_names_are_logged_in_one_printable_line(
    ros_domain: int,
) -> None:
    graph = '"/proc/\\e[2J\\r\\n[INFO] all is well"'
    heard: list[Log] = []
    with running_node(ros_domain, graph_file=graph) as node, Rig(ros_domain) as rig:
        rig.node.create_subscription(Log, "/rosout", heard.append, 100)
        save = rig.node.create_client(Trigger, f"/rgbd_odometry/{topics.SAVE_GRAPH_SERVICE[2:]}")
        rig.wait_until_matched()
        rig.wait(save.service_is_ready, "the service")
        rig.pose_of(corner_frame(START_NS))
        # of another camera the second frame in turn is believed, and a busy node drops some
        rig.poses.clear()
        later = map(corner_frame, count(START_NS + PERIOD_NS, PERIOD_NS))
        rig.publish_until_posed(replace(frame, frame_id=HOSTILE) for frame in later)
        answer = save.call_async(Trigger.Request())
        rig.wait(answer.done, "the answer")
        rig.wait(lambda: [log for log in heard if "Saving the graph" in log.msg], "the last line")
        node.wait_for_line("Saving the graph", PATIENCE_S)
        switched = node.wait_for_line("The images are now from the camera", PATIENCE_S)
        assert f"publishing {ESCAPED}" in switched
        for line in node.lines:
            assert line.isprintable()
            assert line.startswith("[")
            assert "] [rgbd_odometry]: " in line
        # and is told by whom it is told
        assert {log.file.rpartition("/")[2] for log in heard} >= {"node.py"}
        assert not [log for log in heard if log.file.endswith("/node/log.py") and log.level < 40]


@pytest.mark.parametrize(
    ("told", "home", "why"),
    [
        ("", "", "not written to a file: HOME is not set; set ROS_LOG_DIR"),
        (
            "",
            "/proc/nobody",
            "not written to a file: /proc/nobody/.ros/log: No such file or directory",
        ),
        (
            "/proc",
            "/proc",
            "ROS_LOG_DIR: /proc: No such file or directory; set it to a writable folder",
        ),
        ("~/logs", "", "ROS_LOG_DIR: HOME is not set; set it to a writable folder"),
        (f"{__file__}/log", "/proc", "log: Not a directory"),
    ],
)
def test_the_reason_for_no_log_file_is_known_before_ros_starts(
    monkeypatch: pytest.MonkeyPatch, told: str, home: str, why: str
) -> None:
    for name, value in (("ROS_LOG_DIR", told), ("ROS_HOME", ""), ("HOME", home)):
        monkeypatch.setenv(name, value)
    if told:
        with pytest.raises(InputError) as refused:
            explain_no_file()
        assert why in str(refused.value)
    else:
        assert why in str(explain_no_file())


def test_a_folder_for_the_log_is_created_if_that_is_possible(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name, value in (("ROS_LOG_DIR", ""), ("ROS_HOME", ""), ("HOME", str(tmp_path))):
        monkeypatch.setenv(name, value)
    assert explain_no_file() is None
    assert [*(tmp_path / ".ros/log").iterdir()] == []


def test_a_traceback_keeps_its_lines_and_control_characters_are_escaped(
    ros_domain: int, capfd: pytest.CaptureFixture[str]
) -> None:
    context = Context()
    rclpy.init(context=context, domain_id=ros_domain)
    node = LoggedNode("logged", context=context)
    handler, logger = RosLogHandler(node), logging.getLogger(__name__)
    logger.addHandler(handler)
    try:
        node.get_logger().warning(HOSTILE)
        node.get_logger().error(HOSTILE)
        try:
            int(HOSTILE)
        except ValueError:
            logger.exception("%s failed", HOSTILE)
    finally:
        logger.removeHandler(handler)
        node.destroy_node()
        rclpy.shutdown(context=context)
    lines = capfd.readouterr().err.split("\n")
    assert all(line.isprintable() for line in lines)
    assert [ESCAPED in line for line in lines[:4]] == [True, True, True, False]
    assert "Traceback" in lines[3]
