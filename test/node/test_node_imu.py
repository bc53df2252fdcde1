"""An IMU beside the camera, through the node over real DDS."""

from __future__ import annotations

from dataclasses import replace

import make_bag
import numpy as np
import pytest
from raycast_room.imu import BMI055, simulated_imu
from raycast_room.motion import hand_held
from rigs.bag_frames import recorded_frames

from rgbd_glue_ros.experiments.demo.node_process import NodeProcess
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live.topics import IMU
from rgbd_glue_ros.messages import making
from rgbd_glue_ros.messages.poses import pose_from_message
from rgbd_glue_ros.types import NANOSECONDS, Float64, ImuSamples

pytest.importorskip("rclpy", reason="ROS is not installed")

from rigs.faults import running_node
from rigs.ros import OPTICAL_FRAME, PATIENCE_S, Rig, corner_frame
from sensor_msgs.msg import Imu

PERIOD_NS = NANOSECONDS // 30
START_NS = NANOSECONDS
IMU_FRAME = "camera_imu_frame"
# the camera looks down by some 17 degrees and is turned about its axis
UP = np.array([0.2, -0.9, -0.3]) / np.linalg.norm([0.2, -0.9, -0.3])
# the sensor is turned by a quarter about the camera's z axis
R_CAMERA_IMU = se3.exp(np.array([0, 0, 0, 0, 0, np.pi / 2]))[:3, :3]


def at_rest(up: Float64, angular_velocity: Float64, first_ns: int, last_ns: int) -> ImuSamples:
    stamps = np.arange(first_ns, last_ns, 5_000_000, dtype=np.int64)
    shape = len(stamps), 1
    return ImuSamples(stamps, np.tile(angular_velocity, shape), np.tile(9.81 * up, shape))


def first_pose(
    rig: Rig, samples: ImuSamples, frame_id: str, node: NodeProcess, line: str
) -> Float64:
    """Publishes samples and a frame, and waits for its pose and for a line in the log."""
    imu = rig.publisher(Imu, IMU)
    rig.wait_until_matched()
    rig.wait(imu.get_subscription_count, "the subscription to the IMU")
    rig.wait_for_answer("rgbd_odometry")
    for index in range(len(samples)):
        imu.publish(making.copy_fields(making.imu(samples, index, frame_id), Imu()))
    pose = rig.pose_of(corner_frame(START_NS))
    node.wait_for_line(line, PATIENCE_S)
    return pose_from_message(pose, "pose")


@pytest.mark.slow
def test_odom_starts_level_if_an_imu_measures_which_way_is_up(ros_domain: int) -> None:
    still = at_rest(UP, np.zeros(3), 0, START_NS)
    with running_node(ros_domain) as node, Rig(ros_domain) as rig:
        T = first_pose(rig, still, OPTICAL_FRAME, node, "Gravity: odom is level")
        np.testing.assert_allclose(T[:3, :3] @ UP, [0, 0, 1], atol=1e-6)
        np.testing.assert_allclose(T[:3, 3], 0, atol=1e-6)
        # it goes on in that frame
        T_next = pose_from_message(rig.pose_of(corner_frame(START_NS + PERIOD_NS)), "pose")
        np.testing.assert_allclose(T_next, T, atol=2e-3)


@pytest.mark.slow
def test_the_orientation_of_the_imu_may_come_from_a_parameter(ros_domain: int) -> None:
    still = at_rest(R_CAMERA_IMU.T @ UP, np.zeros(3), 0, START_NS)
    given = {"imu_pose": f"'0 0 0 0 0 {np.pi / 2}'"}
    with running_node(ros_domain, **given) as node, Rig(ros_domain) as rig:
        T = first_pose(rig, still, IMU_FRAME, node, "Gravity: odom is level")
        np.testing.assert_allclose(T[:3, :3] @ UP, [0, 0, 1], atol=1e-6)


@pytest.mark.slow
def test_an_imu_with_unknown_orientation_is_not_used_and_that_is_logged(ros_domain: int) -> None:
    still = at_rest(UP, np.zeros(3), 0, START_NS)
    with running_node(ros_domain) as node, Rig(ros_domain) as rig:
        T = first_pose(rig, still, IMU_FRAME, node, f"no transform from {IMU_FRAME}")
        np.testing.assert_allclose(T[:3, :3] @ [0, -1, 0], [0, 0, 1], atol=1e-6)


@pytest.mark.slow
@pytest.mark.every_python
def test_the_orientation_of_the_imu_may_come_from_tf(ros_domain: int) -> None:
    pytest.importorskip("tf2_msgs", reason="tf2_msgs is not installed (scripts/tf2-msgs builds it)")
    from rigs.tf import Robot, transform

    T_camera_imu = se3.from_rotation_translation(R_CAMERA_IMU, np.zeros(3))
    still = at_rest(R_CAMERA_IMU.T @ UP, np.zeros(3), 0, START_NS)
    with Robot(ros_domain) as rig:
        rig.tell(transform(OPTICAL_FRAME, IMU_FRAME, T_camera_imu))
        with running_node(ros_domain, align_with_gravity=False) as node:
            T = first_pose(rig, still, IMU_FRAME, node, "Using the IMU")
            np.testing.assert_allclose(T[:3, :3] @ [0, -1, 0], [0, 0, 1], atol=1e-6)


@pytest.mark.slow
def test_a_gyroscope_that_rotates_while_the_images_do_not_is_ignored_and_that_is_logged(
    ros_domain: int,
) -> None:
    turning = at_rest(UP, np.array([0.0, 1.0, 0.0]), 0, 2 * NANOSECONDS)
    with running_node(ros_domain) as node, Rig(ros_domain) as rig:
        first_pose(rig, turning, OPTICAL_FRAME, node, "Using the IMU")
        for i in range(1, 28):
            frame = corner_frame(START_NS + i * PERIOD_NS)
            frame.color[0, 0] = i  # no two images of a camera are the same
            pose = rig.pose_of(frame)
        node.wait_for_line("the gyroscope disagrees with the images", PATIENCE_S)
        first = pose_from_message(rig.poses[0], "pose")
        np.testing.assert_allclose(pose_from_message(pose, "pose"), first, atol=5e-3)


@pytest.mark.slow
def test_bias_and_time_offset_of_the_imu_are_on_the_diagnostics(ros_domain: int) -> None:
    frames = recorded_frames()[:30]
    start_ns = frames[0].stamp_ns - round(make_bag.time_s(0) * NANOSECONDS)
    errors = replace(BMI055, time_offset=0.01)
    samples = simulated_imu(lambda time_s: hand_held(time_s).matrix, -0.5, 2.0, errors, start_ns)
    with running_node(ros_domain) as node, Rig(ros_domain) as rig:
        imu = rig.publisher(Imu, IMU)
        rig.wait_until_matched()
        rig.wait(imu.get_subscription_count, "the subscription to the IMU")
        sent = 0
        for frame in frames:
            # as a driver does, a little ahead of the images
            while sent < len(samples) and samples.stamps_ns[sent] < frame.stamp_ns + PERIOD_NS:
                message = making.imu(samples, sent, frame.frame_id)
                imu.publish(making.copy_fields(message, Imu()))
                sent += 1
            rig.pose_of(frame)

        def learnt() -> dict[str, str]:
            pairs = (p for d in rig.diagnostics[-1:] for s in d.status for p in s.values)
            return {pair.key: pair.value for pair in pairs}

        rig.wait(lambda: learnt().get("frames") == str(len(frames)), "diagnostics of all frames")
        told = learnt()
        assert told["imu_use"] == "turns and gravity"
        node.wait_for_line("Using the IMU", PATIENCE_S)
    bias, sigmas = (
        np.array(told[f"imu_{name}_rad_s"].split(), np.float64) for name in ("bias", "bias_sigmas")
    )
    assert (sigmas < 0.025).all()  # from 0.03
    assert (np.abs(bias - errors.bias) < 4 * sigmas).all()
    offset, sigma = (float(told[f"imu_time_offset{name}_s"]) for name in ("", "_sigma"))
    assert sigma < 0.03  # as it began
    assert abs(offset - errors.time_offset) < 4 * sigma
