"""Any recording as the topics of a camera."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rigs.bag_frames import recorded_frames
from rigs.bags import START_NS, Recorded, make_frames, recorded, write_rosbag1, write_rosbag2

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.experiments.demo.demo import bundled_bag
from rgbd_glue_ros.experiments.demo.node_process import ros_environment
from rgbd_glue_ros.experiments.demo.played import PlayedRecording, Sensor, transport
from rgbd_glue_ros.live import topics
from rgbd_glue_ros.live.camera_presets import load_camera, remappings
from rgbd_glue_ros.messages import making
from rgbd_glue_ros.messages.synchronizer import Channel
from rgbd_glue_ros.recordings import open_recording
from rgbd_glue_ros.recordings.bag.writer import COMPRESSED, RAW
from rgbd_glue_ros.types import NANOSECONDS, ImuSamples, RgbdFrame

IMU_PERIOD_NS = 5_000_000
UP = np.array([0.2, -0.9, -0.3]) / np.linalg.norm([0.2, -0.9, -0.3])


def with_imu_at_rest(folder: Path, frames: list[RgbdFrame]) -> Path:
    """A bag of frames and of an IMU in the camera's axes, a second before to a second after."""
    first_ns, last_ns = frames[0].stamp_ns - NANOSECONDS, frames[-1].stamp_ns + NANOSECONDS
    stamps = np.arange(first_ns, last_ns, IMU_PERIOD_NS, dtype=np.int64)
    samples = ImuSamples(stamps, np.zeros((len(stamps), 3)), np.tile(9.81 * UP, (len(stamps), 1)))
    imu = [
        Recorded("/imu", "sensor_msgs/msg/Imu", at, making.imu(samples, i, frames[0].frame_id))
        for i, at in enumerate(stamps.tolist())
    ]
    return write_rosbag2(folder, sorted([*recorded(frames), *imu], key=lambda m: m.stamp_ns))


@contextmanager
def playing(domain: int, *words: str) -> Iterator[subprocess.Popen[str]]:
    """The command in a process of its own, whose lines come as they are written."""
    with subprocess.Popen(
        [sys.executable, "-u", "-m", "rgbd_glue_ros", "play", *words],
        env={**os.environ, **ros_environment(domain)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            process.kill()  # where it has not ended


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
def test_only_the_requested_part_is_played(
    bag: Path, start_s: float, duration_s: float | None, frames: range
) -> None:
    with open_recording(bag) as recording:
        played = PlayedRecording(recording, RAW, start_s, duration_s)
        stamps = [m.stamp_ns for m in played.messages if m.channel is Channel.COLOR]
    period_ns = NANOSECONDS / 30
    np.testing.assert_allclose(stamps, [START_NS + i * period_ns for i in frames], rtol=0, atol=9)


def test_a_part_beyond_the_end_is_refused(bag: Path) -> None:
    with open_recording(bag) as recording, pytest.raises(InputError, match="no frames to play"):
        list(PlayedRecording(recording, RAW, 5.0).messages)


def test_the_transport_to_receive_with_follows_from_the_messages(bag: Path) -> None:
    with open_recording(bag) as recording:
        raw, small = PlayedRecording(recording, RAW), PlayedRecording(recording, COMPRESSED)
        channels = (Channel.COLOR, Channel.DEPTH, Channel.INFO)
        assert [transport(raw, c) for c in channels] == ["raw"] * 3
        assert [transport(small, c) for c in channels[:2]] == ["compressed", "compressedDepth"]
        assert sum(len(m.data) for m in small.messages) < sum(len(m.data) for m in raw.messages)


def test_the_samples_of_an_imu_are_played_between_the_frames_in_order(tmp_path: Path) -> None:
    path = with_imu_at_rest(tmp_path / "bag", list(make_frames(10)))
    with open_recording(path) as recording:
        played = PlayedRecording(recording, RAW)
        messages = list(played.messages)
    stamps = [m.stamp_ns for m in messages]
    assert stamps == sorted(stamps)
    imu = [m.stamp_ns for m in messages if m.channel is Sensor.IMU]
    # half a second before the first frame, by which a node finds out which way is up
    assert imu[0] == START_NS - NANOSECONDS // 2
    assert set(np.diff(imu)) == {IMU_PERIOD_NS}
    assert 0 <= messages[-1].stamp_ns - imu[-1] < IMU_PERIOD_NS


def test_a_recording_without_an_imu_is_played_without_one(bag: Path) -> None:
    with open_recording(bag) as recording:
        assert Sensor.IMU not in PlayedRecording(recording, RAW).types


def test_in_a_loop_time_goes_on_by_a_period_for_frames_and_imu(tmp_path: Path) -> None:
    path = with_imu_at_rest(tmp_path / "bag", list(make_frames(10)))
    frames: list[int] = []
    imu: list[int] = []
    with open_recording(path) as recording:
        played = PlayedRecording(recording, RAW)
        for _ in range(3):
            messages = list(played.messages)
            imu += [m.stamp_ns for m in messages if m.channel is Sensor.IMU]
            stamps = [m.stamp_ns for m in messages if m.channel is Channel.COLOR]
            frames += stamps
            played = played.next_round(stamps)
    assert len(frames) == 30
    np.testing.assert_allclose(np.diff(frames), NANOSECONDS / 30, rtol=0, atol=9)
    assert all(0 < b - a < 2 * IMU_PERIOD_NS for a, b in pairwise(imu))


def test_a_single_frame_is_played_again_at_a_later_time(bag: Path) -> None:
    with open_recording(bag) as recording:
        played = PlayedRecording(recording, RAW, duration_s=0.01)
        (first,) = {m.stamp_ns for m in played.messages}
        (again,) = {m.stamp_ns for m in played.next_round([first]).messages}
    assert again - first == NANOSECONDS // 30


@pytest.mark.slow
@pytest.mark.parametrize("camera", [None, "oak_d"])
def test_the_first_frame_reaches_a_node_that_was_there_before(
    tmp_path: Path, ros_domain: int, camera: str | None
) -> None:
    pytest.importorskip("rclpy", reason="ROS is not installed")
    from rigs.faults import running_node
    from rigs.ros import START_S, Rig

    frames = recorded_frames()[:10]
    path = write_rosbag2(tmp_path / "bag", recorded(frames))
    named = remappings(load_camera(camera), {}) if camera else []
    remapped = [word for own, topic in named for word in ("-r", f"{own}:={topic}")]
    with running_node(ros_domain, *remapped) as node, Rig(ros_domain) as listener:
        for publisher in (listener.color, listener.depth, listener.info):
            listener.node.destroy_publisher(publisher)
        node.wait_for_line("Subscribed", START_S)
        listener.wait(lambda: listener.node.count_publishers(topics.POSE), "the node's poses")
        with playing(ros_domain, str(path), *(["--camera", camera] if camera else [])) as player:
            listener.wait(lambda: listener.poses, "a pose")
            said, faults = player.communicate()
            assert player.returncode == 0, faults
    assert "received by /rgbd_odometry\n" in said
    assert f"odometry{f' --camera {camera}' if camera else ''}\n" in said
    stamp = making.header(frames[0].stamp_ns, "").stamp
    first = listener.poses[0].header.stamp
    assert (first.sec, first.nanosec) == (stamp.sec, stamp.nanosec)


def test_subscribers_that_come_late_are_not_waited_for_longer_than_nodes_wait_for_a_message(
    bag: Path, ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("rclpy", reason="ROS is not installed")
    from rgbd_glue_ros.experiments.demo import player
    from rgbd_glue_ros.node.input_watch import LOOK_S

    now_s = 0.0

    def wait(_condition: object, timeout_s: float) -> bool:
        """The first subscriber comes after three seconds, and others never do."""
        nonlocal now_s
        is_first = now_s == 0
        now_s += 3.0 if is_first else timeout_s
        return is_first

    with open_recording(bag) as recording:
        camera = player.Camera(PlayedRecording(recording, RAW), ros_domain)
        with camera:
            monkeypatch.setattr(player, "time", SimpleNamespace(monotonic=lambda: now_s))
            monkeypatch.setattr(camera, "wait", wait)
            camera.wait_for_listeners()
    assert now_s <= LOOK_S


@pytest.mark.slow
def test_where_nobody_listens_it_is_said_and_played_all_the_same(
    bag: Path, ros_domain: int
) -> None:
    pytest.importorskip("rclpy", reason="ROS is not installed")
    with playing(ros_domain, str(bag), "--camera", "realsense_d400") as player:
        said, faults = player.communicate()
    assert player.returncode == 0, faults
    assert "publishing /camera/camera/color/camera_info, /camera/camera/color/image_raw, " in said
    assert "no subscriber; playing anyway\n" in said
    assert said.endswith("played 10 frames of small\n")


@pytest.mark.slow
def test_a_recording_is_played_into_a_namespace_and_arguments_of_ros_come_before_the_camera(
    bag: Path, ros_domain: int
) -> None:
    pytest.importorskip("rclpy", reason="ROS is not installed")
    ros = ["--ros-args", "-r", "__ns:=/r1", "-r", "rgb/image:=color"]
    cases: tuple[tuple[list[str], str], ...] = (
        ([], "/r1/rgb/camera_info, /r1/color/compressed, /r1/depth/image/compressedDepth"),
        (
            ["--camera", "oak_d"],
            "/oak/rgb/camera_info, /r1/color/compressed, /oak/stereo/image_raw/compressedDepth",
        ),
    )
    with ExitStack() as players:
        # at the same time: each waits for subscribers that do not come
        started = [
            players.enter_context(
                playing(ros_domain, str(bag), "--compressed", "--start", "0", *camera, *ros)
            )
            for camera, _ in cases
        ]
        for player, (_, topics_said) in zip(started, cases, strict=True):
            said, faults = player.communicate()
            assert player.returncode == 0, faults
            assert f"publishing {topics_said}\n" in said
            assert "--ros-args -r __ns:=/r1 -r rgb/image:=color -p image_transport" in said


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (["--start", "100"], "small: has no frames to play from 100 s on; start earlier"),
        (["--ros-args", "-r", "nonsense"], "ROS arguments: "),
        (["--start", "-1"], "'-1' is not a number from zero on"),
    ],
)
def test_what_cannot_be_played_is_refused_before_anything_is_published(
    bag: Path, ros_domain: int, words: list[str], fault: str
) -> None:
    pytest.importorskip("rclpy", reason="ROS is not installed")
    with playing(ros_domain, str(bag), *words) as player:
        said, faults = player.communicate()
    assert player.returncode == 2
    assert fault in faults
    assert "publishing" not in said


@pytest.mark.slow
def test_topics_that_nobody_listens_to_are_named(bag: Path, ros_domain: int) -> None:
    pytest.importorskip("rclpy", reason="ROS is not installed")
    from rigs.ros import Rig
    from sensor_msgs.msg import Image

    with Rig(ros_domain) as viewer:
        images: list[Image] = []
        for publisher in (viewer.color, viewer.depth, viewer.info):
            viewer.node.destroy_publisher(publisher)
        viewer.node.create_subscription(Image, "rgb/image", images.append, 10)
        with playing(ros_domain, str(bag)) as player:
            viewer.wait(lambda: len(images) == 10, "all images")
            said, _ = player.communicate()
    assert "received by /rig; no subscriber of /rgb/camera_info, /depth/image\n" in said


@pytest.mark.slow
def test_a_node_finds_out_which_way_is_up_by_the_imu_that_is_played(
    tmp_path: Path, ros_domain: int
) -> None:
    pytest.importorskip("rclpy", reason="ROS is not installed")
    from rigs.faults import node_in
    from rigs.ros import PATIENCE_S

    path = with_imu_at_rest(tmp_path / "bag", list(recorded_frames()[:10]))
    with node_in(ros_domain) as node, playing(ros_domain, str(path)) as player:
        node.wait_for_line("Gravity: odom is level", PATIENCE_S)
        node.wait_for_line("Using the IMU on /imu", PATIENCE_S)
        said, faults = player.communicate()
        assert player.returncode == 0, faults
    assert "/depth/image, /imu\n" in said


@pytest.mark.slow
@pytest.mark.parametrize("option", ["--raw", "--compressed"])
def test_a_node_hears_what_is_played_in_a_loop_until_it_is_interrupted(
    ros_domain: int, option: str
) -> None:
    pytest.importorskip("rclpy", reason="ROS is not installed")
    from rigs.faults import node_in
    from rigs.ros import Rig

    transports = {"image_transport": "compressed", "depth_transport": "compressedDepth"}
    words = [str(bundled_bag()), option, "--loop", "--start", "0.5", "--duration", "1"]
    with (
        node_in(ros_domain, **(transports if option == "--compressed" else {})) as node,
        Rig(ros_domain) as listener,
        playing(ros_domain, *words) as player,
    ):
        for publisher in (listener.color, listener.depth, listener.info):
            listener.node.destroy_publisher(publisher)

        def stamps() -> list[float]:
            return [p.header.stamp.sec + 1e-9 * p.header.stamp.nanosec for p in listener.poses]

        listener.wait(lambda: max(stamps(), default=0) - min(stamps(), default=0) > 2, "rounds")
        assert stamps() == sorted(stamps())
        player.send_signal(signal.SIGINT)
        assert player.wait() == 130
        assert not [line for line in node.lines if "Time went back" in line]
