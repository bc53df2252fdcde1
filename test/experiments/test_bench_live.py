"""The node and the replay are the same odometry."""

from __future__ import annotations

from functools import partial
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest

from rgbd_glue_ros.experiments.demo.demo import bundled_bag
from rgbd_glue_ros.experiments.demo.node_process import NodeProcess, ros_environment
from rgbd_glue_ros.experiments.replay.replay import replay
from rgbd_glue_ros.messages.synchronizer import Channel
from rgbd_glue_ros.parameters import load_preset
from rgbd_glue_ros.recordings import open_recording
from rgbd_glue_ros.recordings.first_frames import first_frames

pytest.importorskip("rclpy", reason="ROS is not installed")

from rgbd_glue_ros.experiments.demo.played import PlayedBag, transport
from rgbd_glue_ros.experiments.demo.player import Player

PATIENCE_S = 60.0
FRAMES = 45


@pytest.mark.slow
@pytest.mark.every_python
def test_the_same_bag_gives_the_same_poses_through_the_node_over_dds_and_through_replay(
    ros_domain: int, tmp_path: Path
) -> None:
    with open_recording(bundled_bag()) as sequence:
        offline = replay(first_frames(sequence, FRAMES), load_preset("live"), tmp_path).trajectory
    recording = PlayedBag.load(bundled_bag())
    parameters = {
        "camera_axes": "optical",
        "image_transport": transport(recording, Channel.COLOR),
        "depth_transport": transport(recording, Channel.DEPTH),
    }
    with (
        NodeProcess(parameters, ros_environment(ros_domain)) as node,
        Player(recording, ros_domain) as player,
    ):
        assert player.wait(player.is_matched, PATIENCE_S), node.lines
        for stamp_ns, messages in groupby(recording.messages, key=lambda m: m.stamp_ns):
            if len(player.poses) == FRAMES:
                break
            for message in messages:
                player.publish(message)
            # the next only after this one's pose, so that none is dropped
            assert player.wait(partial(player.poses.__contains__, stamp_ns), PATIENCE_S), node.lines
    assert list(player.poses) == offline.stamps_ns.tolist()
    live = np.stack(list(player.poses.values()))
    np.testing.assert_allclose(live, offline.poses, rtol=0, atol=1e-9)
