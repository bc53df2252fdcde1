"""The node logs what it sees for the Rerun viewer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rgbd_glue_ros.live.extrinsics import T_BODY_OPTICAL
from rgbd_glue_ros.messages.poses import pose_from_message
from rgbd_glue_ros.types import NANOSECONDS
from rgbd_glue_ros.viz import layout

pytest.importorskip("rclpy", reason="ROS is not installed")

from rigs.faults import running_node
from rigs.rerun_reader import column, rows_of
from rigs.ros import Rig, corner_frame


def test_the_file_contains_every_frame_at_its_published_pose(
    ros_domain: int, tmp_path: Path
) -> None:
    # here, as it takes half a second in every process that collects tests
    pytest.importorskip("rerun.chunk", reason="rerun-sdk is not installed (it needs numpy 2)")
    file = tmp_path / "live.rrd"
    stamps = [i * NANOSECONDS // 30 for i in range(1, 4)]
    with running_node(ros_domain, rerun=str(file)) as node, Rig(ros_domain) as rig:
        rig.wait_until_matched()
        poses = [rig.pose_of(corner_frame(stamp)) for stamp in stamps]
        assert node.stop() == 0
    rows = rows_of(file)
    places = np.concatenate(column(rows[f"/{layout.CAMERA}"], ":translation"))
    in_odom = places @ T_BODY_OPTICAL[:3, :3].T
    published = [pose_from_message(pose, "pose")[:3, 3] for pose in poses]
    np.testing.assert_allclose(in_odom, published, atol=1e-6)
    assert len(column(rows[f"/{layout.COLOR}"], ":blob")) == len(stamps)
    assert f"/{layout.KEYFRAMES}/0/cloud" in rows
