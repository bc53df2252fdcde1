"""Transforms between frames in a bag."""

from __future__ import annotations

from itertools import islice

from rgbd_glue_ros.messages.poses import pose_from_message
from rgbd_glue_ros.messages.reading import plain_frame
from rgbd_glue_ros.messages.transform_tree import TF, TF_STATIC, TransformTree
from rgbd_glue_ros.recordings.bag.file import BagFile
from rgbd_glue_ros.types import Float64

# ROS 1 repeats static transforms on /tf; all of them occur within this many messages
_FIRST_TRANSFORMS = 500


def recorded_transform(bag: BagFile, target: str, source: str) -> Float64 | None:
    """The constant T_target_source [4, 4] between two frames; None if it is not recorded.

    Raises:
        InputError: a message of transforms cannot be read.
    """
    tree = TransformTree()
    for topic, most in ((TF_STATIC, None), (TF, _FIRST_TRANSFORMS)):
        if topic not in bag.topics:
            continue
        for message in islice(bag.messages([topic]), most):
            for item in bag.deserialize(message).transforms:
                parent = plain_frame(item.header.frame_id)
                T_parent_child = pose_from_message(item, topic)
                tree.add(parent, plain_frame(item.child_frame_id), T_parent_child, None)
        found = tree.lookup(target, source, None, 0)
        if found is not None:
            return found
    return None
