"""What is said of a pose while the images do not show how the camera moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live.monitor import Monitor
from rgbd_glue_ros.live.unseen_motion import UnseenMotion
from rgbd_glue_ros.types import NANOSECONDS, OdometryEstimate, TrackingState

LOST = OdometryEstimate(9 * NANOSECONDS, TrackingState.LOST)


def posed(seconds: float, in_odom_m: float, from_keyframe_m: float) -> OdometryEstimate:
    return OdometryEstimate(
        round(seconds * NANOSECONDS),
        TrackingState.TRACKING,
        np.eye(4),
        np.eye(6) * in_odom_m**2,
        covariance_from_keyframe=np.eye(6) * from_keyframe_m**2,
    )


def after(*estimates: OdometryEstimate) -> UnseenMotion:
    motion = UnseenMotion()
    for estimate in estimates:
        motion.take(estimate)
    return motion


AT_A_WALL = [posed(1, 0.01, 0.01), posed(2, 0.3, 0.3), posed(3, 1.2, 1.2)]


def test_at_a_bare_wall_it_is_said_since_when_and_how_far_the_pose_may_be_off() -> None:
    unseen = after(*AT_A_WALL)
    assert unseen.since_ns == 2 * NANOSECONDS
    assert unseen.doubt.startswith("since 2.000 the images have not shown all of the motion")
    assert "may be 1.2 m off" in unseen.doubt
    assert after(*AT_A_WALL, LOST).doubt == unseen.doubt


def test_a_keyframe_at_the_wall_makes_the_pose_no_better_known() -> None:
    assert "may be 1.2 m off" in after(*AT_A_WALL, posed(4, 1.2, 0.01)).doubt


def test_once_the_place_is_known_again_nothing_is_said() -> None:
    known = after(*AT_A_WALL, posed(5, 0.02, 0.01))
    assert (known.since_ns, known.doubt) == (None, "")


def test_drift_that_has_added_up_over_many_keyframes_is_not_unseen_motion() -> None:
    assert after(posed(1, 0.01, 0.01), posed(900, 2.0, 0.03)).doubt == ""


def test_far_from_the_origin_an_uncertain_rotation_is_no_unseen_motion() -> None:
    far = se3.from_rotation_translation(np.eye(3), np.array([60.0, 0, 0]))
    about_camera = np.diag([0.0, 0, 0, 0, 0.01, 0]) ** 2
    estimate = replace(
        posed(1, 0.5, 0.0),
        T_odom_camera=far,
        covariance_from_keyframe=se3.perturbation_covariance(far, about_camera),
    )
    assert after(estimate).doubt == ""


def test_a_reset_of_the_odometry_ends_the_doubt() -> None:
    monitor = Monitor()
    for estimate in AT_A_WALL:
        monitor.processed(estimate, 0, 0)
    assert monitor.unseen_motion.doubt
    monitor.start_anew()
    assert not monitor.unseen_motion.doubt
