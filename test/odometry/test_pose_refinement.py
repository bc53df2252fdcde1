"""The refinement of a frame's pose: where it ends, and what it leaves in memory."""

from __future__ import annotations

import gc

import pytest
from rigs.bag_frames import recorded_frames
from rigs.pose_problems import problem_of
from rigs.scenes import SCENES

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.acceptance import Acceptance
from rgbd_glue_ros.odometry.candidates import refined_candidate
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.odometry.pose_refinement import COARSE_LEVELS
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.refinement.image_pyramid import ImagePyramid


@pytest.mark.parametrize(("seed", "frame"), [(0, 8), (1, 11), (2, 13)])
def test_a_pose_that_slides_along_a_corridor_at_the_coarse_levels_is_refined_without_them(
    seed: int, frame: int
) -> None:
    config, scene = Config(), SCENES["a bare corridor at 10 Hz"]
    before, now = [*scene.noisy_frames(seed)][frame : frame + 2]
    T_before, T_now = scene.true_poses()[frame : frame + 2]
    truth = se3.inverse(T_before) @ T_now
    problem = problem_of(before, now, truth, config)
    slid = problem.refined(truth, COARSE_LEVELS)
    assert se3.difference(slid.T_model_source, truth) > 0.05
    candidate = refined_candidate(truth, problem, Acceptance.of(config.odometry))
    assert se3.difference(candidate.estimate.T_track_camera, truth) < 0.005


def pyramids() -> int:
    """How many there are, in all of the process."""
    gc.collect()
    # isinstance would ask a weak proxy whose object is gone
    return sum(type(thing) is ImagePyramid for thing in gc.get_objects())


def test_no_pyramid_of_an_image_outlives_its_frame() -> None:
    before = pyramids()
    with Odometry(Config()) as odometry:
        for frame in recorded_frames()[:4]:
            assert odometry.process(frame).T_odom_camera is not None
        # asks for what the background thread works out
        odometry.learnt_config()
        odometry.new_edges()
        assert pyramids() == before
