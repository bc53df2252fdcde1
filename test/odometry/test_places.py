"""Places where odometry has little to go by: none is lost, none is off."""

from __future__ import annotations

import numpy as np
import pytest
from rigs.bag_frames import errors
from rigs.scenes import SCENES

from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.types import Float64


@pytest.mark.slow
@pytest.mark.parametrize(
    ("place", "centimetres", "degrees"),
    [
        ("a corridor walked along", 1.0, 0.2),
        ("a corridor at 10 Hz", 2.0, 0.2),
        ("a bare corridor at 10 Hz", 3.0, 0.5),
        ("stairs", 1.0, 0.2),
        ("a blank wall with one poster", 0.5, 0.2),
        ("the depth of a phone", 1.0, 0.3),
        ("the depth of a phone alone", 2.0, 0.6),
        ("five frames a second", 0.5, 0.2),
        ("a narrow field of view", 0.5, 0.2),
        ("a wide field of view", 0.5, 0.2),
    ],
)
def test_a_place_is_walked_without_getting_lost(
    place: str, centimetres: float, degrees: float
) -> None:
    scene = SCENES[place]
    with Odometry(Config()) as odometry:
        estimates = [odometry.process(frame) for frame in scene.frames()]
    metres, radians = errors(estimates, scene.true_poses())
    # NaN where there is no pose is no error that is small enough
    assert 100 * metres.max() < centimetres
    assert np.rad2deg(radians.max()) < degrees


@pytest.mark.slow
@pytest.mark.parametrize(
    ("place", "centimetres"), [("a bare corridor at 10 Hz", 5), ("a bare corridor at 30 Hz", 2)]
)
def test_notices_in_a_corridor_tell_the_position_along_it_whatever_noise_the_walls_have(
    place: str, centimetres: float
) -> None:
    off, said = along_the_corridor(place)
    assert 100 * np.abs(off).max() < centimetres
    assert (np.abs(off) < 3 * said + 0.01).all()


@pytest.mark.slow
@pytest.mark.parametrize("place", ["an empty corridor at 10 Hz", "an empty corridor at 30 Hz"])
def test_in_an_empty_corridor_a_camera_stays_where_it_was_and_says_that_it_may_have_moved(
    place: str,
) -> None:
    off, said = along_the_corridor(place)
    walked = SCENES[place].true_poses()[:, 2, 3]
    np.testing.assert_allclose(off, -walked, atol=0.02)
    assert (np.abs(off) < 1.5 * said + 0.01).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("place", "centimetres"),
    [
        ("a wide field of view", 1.0),
        ("a corridor walked along", 1.0),
        ("a bare corridor at 10 Hz", 3.0),
    ],
)
def test_depth_several_times_as_noisy_as_expected_does_no_harm(
    place: str, centimetres: float
) -> None:
    scene = SCENES[place]
    with Odometry(Config()) as odometry:
        frames = scene.noisy_frames(seed=0, is_stereo=True)
        estimates = [odometry.process(frame) for frame in frames]
    metres, _ = errors(estimates, scene.true_poses())
    assert 100 * metres.max() < centimetres


def along_the_corridor(place: str) -> tuple[Float64, Float64]:
    """Errors of poses along a corridor, and their standard deviations as stated, metres."""
    scene = SCENES[place]
    with Odometry(Config()) as odometry:
        estimates = [odometry.process(frame) for frame in scene.noisy_frames(seed=0)]
    off = np.array([e.T_odom_camera for e in estimates])[:, 2, 3] - scene.true_poses()[:, 2, 3]
    return off, np.sqrt([e.covariance[2, 2] for e in estimates if e.covariance is not None])
