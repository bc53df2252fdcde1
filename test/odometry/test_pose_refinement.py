"""What the refinement of a frame's pose makes on the way goes with the frame."""

from __future__ import annotations

import gc

from rigs.bag_frames import recorded_frames

from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.refinement.image_pyramid import ImagePyramid


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
