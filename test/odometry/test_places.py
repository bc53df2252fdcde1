"""Places where odometry has little to go by: none is lost, none is off."""

from __future__ import annotations

import numpy as np
import pytest
from rigs.bag_frames import errors
from rigs.scenes import SCENES

from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.parameters import Config


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
    ("place", "centimetres"), [("a bare corridor at 10 Hz", 8), ("an empty corridor at 10 Hz", 125)]
)
def test_along_a_corridor_sensor_noise_causes_only_small_errors_within_the_covariance(
    place: str, centimetres: float
) -> None:
    """Of an empty one nothing is known but that cameras are slow, and that is said."""
    scene = SCENES[place]
    with Odometry(Config()) as odometry:
        estimates = [odometry.process(frame) for frame in scene.noisy_frames(seed=0)]
    along = np.array([e.T_odom_camera for e in estimates])[:, 2, 3] - scene.true_poses()[:, 2, 3]
    said = np.sqrt([e.covariance[2, 2] for e in estimates if e.covariance is not None])
    assert 100 * np.abs(along).max() < centimetres
    assert (np.abs(along) < 3 * said + 0.01).all()
