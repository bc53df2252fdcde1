"""What a replay writes for others to look at is what it estimated."""

from __future__ import annotations

import base64
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rigs.pan import Pan
from rosbags.highlevel import AnyReader

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.experiments.replay.bag_sink import BagSink
from rgbd_glue_ros.experiments.replay.outputs import FurtherOutputs
from rgbd_glue_ros.experiments.replay.replay import replay
from rgbd_glue_ros.experiments.replay.run_record import Run
from rgbd_glue_ros.live import topics
from rgbd_glue_ros.live.extrinsics import Extrinsics
from rgbd_glue_ros.messages.images import color_from_message
from rgbd_glue_ros.messages.poses import pose_from_message
from rgbd_glue_ros.messages.reading import stamp_ns
from rgbd_glue_ros.parameters import Config, load_preset

# most share one replay, which takes seconds whichever of them comes first
pytestmark = [pytest.mark.slow, pytest.mark.every_python]

FRAMES = 40


@pytest.fixture(scope="module")
def replayed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Run]:
    folder = tmp_path_factory.mktemp("replay")
    outputs = FurtherOutputs([BagSink(folder / "bag")], folder / "cloud.ply")
    run = replay(Pan(FRAMES), load_preset("live"), folder / "out", outputs=outputs)
    return folder, run


def messages(bag: Path) -> dict[str, list[Any]]:
    found = defaultdict(list)
    with AnyReader([bag]) as reader:
        for connection, at_ns, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found[connection.topic].append(message)
            if hasattr(message, "header"):
                assert stamp_ns(message.header.stamp) == at_ns
    return found


def test_the_bag_has_every_topic_of_the_node(replayed: tuple[Path, Run]) -> None:
    folder, run = replayed
    found = messages(folder / "bag")
    keyframes = sum(frame.is_keyframe for frame in run.frames)
    assert {topic: len(all_of_it) for topic, all_of_it in found.items()} == {
        "/pose": FRAMES,
        "/odom": FRAMES - 1,  # the first frame has no velocity
        "/tf": FRAMES,
        "/path": 1,
        "/keyframe/pose": keyframes,
        # the pose of the first in odom; each other was tracked from an earlier one
        "/keyframe/edges": keyframes,
        "/debug/matches/compressed": FRAMES,
        "/diagnostics": 2,
    }


def test_poses_transforms_and_path_are_those_of_the_run(replayed: tuple[Path, Run]) -> None:
    folder, run = replayed
    found = messages(folder / "bag")
    poses = [Extrinsics.of_camera("body").pose(T) for T in run.trajectory.poses]
    (path,) = found["/path"]
    transforms = [transform for message in found["/tf"] for transform in message.transforms]
    for series in (found["/pose"], transforms, path.poses):
        read = [pose_from_message(message, "bag") for message in series]
        np.testing.assert_allclose(read, poses, atol=1e-12)
    odom = found["/odom"][-1]
    np.testing.assert_allclose(pose_from_message(odom, "odom"), poses[-1], atol=1e-12)
    for covariance in (odom.pose.covariance, odom.twist.covariance):
        assert np.linalg.eigvalsh(np.reshape(covariance, (6, 6))).min() > 0
    # 1.5 cm a frame at 30 Hz, to the right of the camera
    velocity = odom.twist.twist.linear
    np.testing.assert_allclose([velocity.x, velocity.y, velocity.z], [0.45, 0, 0], atol=0.05)


def test_the_edges_join_the_keyframes_of_the_bag(replayed: tuple[Path, Run]) -> None:
    folder, _ = replayed
    found = messages(folder / "bag")
    keyframes = found["/keyframe/pose"]
    start, *edges = found["/keyframe/edges"]
    assert (start.header.frame_id, start.child_frame_id) == ("odom", "keyframe_0")
    assert start.header.stamp == keyframes[0].header.stamp
    assert np.linalg.eigvalsh(np.reshape(start.pose.covariance, (6, 6))).min() > 0
    np.testing.assert_allclose(
        pose_from_message(start, "keyframe/edges"), pose_from_message(keyframes[0], ""), atol=1e-12
    )
    for child, edge in enumerate(edges, 1):
        parent = topics.keyframe_number(edge.header.frame_id)
        assert topics.keyframe_number(edge.child_frame_id) == child
        assert edge.header.stamp == keyframes[child].header.stamp
        T_odom_parent = pose_from_message(keyframes[parent], "keyframe/pose")
        T_odom_child = pose_from_message(keyframes[child], "keyframe/pose")
        T_parent_child = pose_from_message(edge, "keyframe/edges")
        np.testing.assert_allclose(T_odom_parent @ T_parent_child, T_odom_child, atol=0.01)
        assert np.linalg.eigvalsh(np.reshape(edge.pose.covariance, (6, 6))).min() > 0


def test_the_diagnostics_of_the_bag_have_the_names_of_the_nodes(
    replayed: tuple[Path, Run],
) -> None:
    folder, run = replayed
    last = messages(folder / "bag")["/diagnostics"][-1]
    values = {each.key: each.value for each in last.status[0].values}
    (frame,) = (f for f in run.frames if f.stamp_ns == stamp_ns(last.header.stamp))
    assert values["state"] == last.status[0].message == frame.state.value
    assert values["visual_inliers"] == str(frame.visual_inliers)
    assert values["credible_matches"] == str(frame.credible)


def test_the_bag_holds_the_matches_as_images(replayed: tuple[Path, Run]) -> None:
    folder, _ = replayed
    image = messages(folder / "bag")["/debug/matches/compressed"][-1]
    assert color_from_message(image, "matches").shape == (240, 320, 3)


def test_another_reader_of_mcap_reads_it(replayed: tuple[Path, Run]) -> None:
    reader = pytest.importorskip("mcap_ros2.reader", reason="mcap-ros2-support is not installed")
    folder, run = replayed
    (file,) = (folder / "bag").glob("*.mcap")
    read = [m.ros_msg for m in reader.read_ros2_messages(str(file), topics=["/odom"])]
    at = read[-1].pose.pose.position
    expected = Extrinsics.of_camera("body").pose(run.trajectory.poses[-1])[:3, 3]
    np.testing.assert_allclose([at.x, at.y, at.z], expected, atol=1e-12)
    edges = reader.read_ros2_messages(str(file), topics=["/keyframe/edges"])
    assert {m.ros_msg.header.frame_id for m in edges} >= {"keyframe_0"}


def test_a_bag_that_is_there_is_not_overwritten(replayed: tuple[Path, Run]) -> None:
    folder, _ = replayed
    with pytest.raises(InputError, match="exists already"):
        BagSink(folder / "bag")


def test_the_cloud_is_a_wall_at_its_distance_and_the_report_shows_it(
    replayed: tuple[Path, Run],
) -> None:
    folder, run = replayed
    header, _, data = (folder / "cloud.ply").read_bytes().partition(b"end_header\n")
    points = np.frombuffer(data, [("points", "<f4", 3), ("colors", "u1", 3)])["points"]
    assert f"element vertex {len(points)}\n".encode() in header
    assert len(points) > 1000
    np.testing.assert_allclose(points[:, 2], 1.5, atol=0.02)
    # what two keyframes saw: each sees 1.6 m, and they are 25 cm apart
    assert 1.3 < np.ptp(points[:, 0]) < 2.1
    assert run.map_jpeg.startswith(b"\xff\xd8")
    report = (folder / "out" / "report.html").read_text(encoding="utf-8")
    assert base64.b64encode(run.map_jpeg).decode() in report


def test_where_time_goes_back_the_bag_has_all_poses_and_the_path_of_the_last_part(
    tmp_path: Path,
) -> None:
    outputs = FurtherOutputs([BagSink(tmp_path / "bag")])
    replay(Pan(4, rounds=(6,)), Config(), tmp_path / "out", outputs=outputs)
    found = messages(tmp_path / "bag")
    assert len(found["/pose"]) == 10
    assert len(found["/path"][-1].poses) == 6
    assert len(found["/diagnostics"]) == 2


def test_where_time_goes_back_the_cloud_is_that_of_the_longest_part(tmp_path: Path) -> None:
    for name, pan in (("alone", Pan(20)), ("among", Pan(4, rounds=(20, 6)))):
        outputs = FurtherOutputs(cloud=tmp_path / f"{name}.ply")
        replay(pan, Config(), tmp_path / name, outputs=outputs)
    clouds = [(tmp_path / f"{name}.ply").read_bytes() for name in ("alone", "among")]
    assert clouds[0] == clouds[1]
