"""Any recording as the topics of a camera."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rigs.bags import START_NS, make_frames, recorded, write_rosbag1

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.experiments.demo.demo import bundled_bag
from rgbd_glue_ros.experiments.demo.node_process import ros_environment
from rgbd_glue_ros.experiments.demo.played import PlayedRecording, transport
from rgbd_glue_ros.messages.synchronizer import Channel
from rgbd_glue_ros.recordings import open_recording
from rgbd_glue_ros.recordings.bag.writer import COMPRESSED, RAW
from rgbd_glue_ros.types import NANOSECONDS


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Ten frames at 30 Hz in a bag of ROS 1, which no player of ROS 2 plays."""
    return write_rosbag1(tmp_path / "small.bag", recorded(make_frames(10)))


@pytest.mark.parametrize(
    ("start_s", "duration_s", "frames"),
    [
        (0.0, None, range(10)),
        (0.1, None, range(4, 10)),
        (0.0, 0.1, range(4)),
        (0.1, 0.1, range(4, 7)),
    ],
)
def test_the_part_asked_for_is_played(
    bag: Path, start_s: float, duration_s: float | None, frames: range
) -> None:
    with open_recording(bag) as recording:
        played = PlayedRecording(recording, RAW, start_s, duration_s)
        stamps = [m.stamp_ns for m in played.messages if m.channel is Channel.COLOR]
    period_ns = NANOSECONDS / 30
    np.testing.assert_allclose(stamps, [START_NS + i * period_ns for i in frames], rtol=0, atol=9)


def test_a_part_beyond_the_end_is_refused(bag: Path) -> None:
    with open_recording(bag) as recording, pytest.raises(InputError, match="no frame to play"):
        list(PlayedRecording(recording, RAW, 5.0).messages)


def test_the_transport_to_receive_with_follows_from_the_messages(bag: Path) -> None:
    with open_recording(bag) as recording:
        raw, small = PlayedRecording(recording, RAW), PlayedRecording(recording, COMPRESSED)
        channels = (Channel.COLOR, Channel.DEPTH, Channel.INFO)
        assert [transport(raw, c) for c in channels] == ["raw"] * 3
        assert [transport(small, c) for c in channels[:2]] == ["compressed", "compressedDepth"]
        assert sum(len(m.data) for m in small.messages) < sum(len(m.data) for m in raw.messages)


@pytest.mark.slow
def test_a_loop_that_a_node_would_not_see_as_one_is_refused_after_its_first_round(
    bag: Path, ros_domain: int
) -> None:
    pytest.importorskip("rclpy", reason="ROS is not installed")
    done = subprocess.run(
        [sys.executable, "-m", "rgbd_glue_ros", "play", str(bag), "--loop"],
        env={**os.environ, **ros_environment(ros_domain)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "--loop: 0.30 s are too short" in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("option", ["--raw", "--compressed"])
def test_a_node_hears_what_is_played_in_a_loop_until_it_is_interrupted(
    ros_domain: int, option: str
) -> None:
    pytest.importorskip("rclpy", reason="ROS is not installed")
    from rigs.faults import node_in
    from rigs.ros import Rig

    transports = {"image_transport": "compressed", "depth_transport": "compressedDepth"}
    words = ["play", str(bundled_bag()), option, "--loop", "--start", "0.5", "--duration", "1"]
    with (
        node_in(ros_domain, **(transports if option == "--compressed" else {})),
        Rig(ros_domain) as listener,
        subprocess.Popen(
            [sys.executable, "-m", "rgbd_glue_ros", *words],
            env={**os.environ, **ros_environment(ros_domain)},
            stderr=subprocess.PIPE,
            text=True,
        ) as player,
    ):
        for publisher in (listener.color, listener.depth, listener.info):
            listener.node.destroy_publisher(publisher)
        listener.wait(lambda: len(listener.poses) > 35, "poses of a second round")
        player.send_signal(signal.SIGINT)
        assert player.wait() == 130
