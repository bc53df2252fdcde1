"""Places where odometry has little to go by: none is lost, none is off."""

from __future__ import annotations

import numpy as np
import pytest
from rigs.bag_frames import errors
from rigs.scenes import SCENES, Scene

from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.types import Float64, OdometryEstimate


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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("place", "centimetres", "degrees"),
    [("a bare wall", 0.5, 0.1), ("a bare wall, turning", 2.0, 1.0)],
)
@pytest.mark.parametrize("seed", [0, 1])
def test_at_a_bare_wall_a_camera_that_stays_is_said_to_stay(
    place: str, centimetres: float, degrees: float, seed: int
) -> None:
    scene = SCENES[place]
    metres, radians = errors(tracked(scene, seed), scene.true_poses())
    assert 100 * metres.max() < centimetres
    assert np.rad2deg(radians.max()) < degrees


@pytest.mark.slow
@pytest.mark.parametrize("place", ["a bare floor", "the edge of a bare wall"])
@pytest.mark.parametrize("seed", [0, 1])
def test_along_a_bare_surface_a_camera_says_that_it_may_have_moved(place: str, seed: int) -> None:
    scene = SCENES[place]
    estimates, truth = tracked(scene, seed), scene.true_poses()
    assert all(e.T_odom_camera is not None for e in estimates)
    off = np.array([e.T_odom_camera for e in estimates])[:, :3, 3] - truth[:, :3, 3]
    said = np.sqrt([np.diag(e.covariance)[:3] for e in estimates if e.covariance is not None])
    assert (np.abs(off) < 3 * said + 0.01).all()
    # the distance to the surface is measured
    assert said.min(axis=1).max() < 0.01


def tracked(scene: Scene, seed: int) -> list[OdometryEstimate]:
    """The estimates of a scene's frames, with noise."""
    with Odometry(Config()) as odometry:
        return [odometry.process(frame) for frame in scene.noisy_frames(seed)]


def along_the_corridor(place: str) -> tuple[Float64, Float64]:
    """Errors of poses along a corridor, and their standard deviations as stated, metres."""
    scene = SCENES[place]
    estimates = tracked(scene, seed=0)
    off = np.array([e.T_odom_camera for e in estimates])[:, 2, 3] - scene.true_poses()[:, 2, 3]
    return off, np.sqrt([e.covariance[2, 2] for e in estimates if e.covariance is not None])
