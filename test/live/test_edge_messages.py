"""An edge is read as it was written, and refused if it is not one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live.keyframe_edges import (
    begins_graph,
    edge_from_message,
    edge_message,
    start_message,
)
from rgbd_glue_ros.messages import making
from rgbd_glue_ros.types import EdgeOrigin, PoseGraphEdge

ROOT = np.random.default_rng(0).normal(size=(6, 6))
EDGE = PoseGraphEdge(
    3, 7, se3.exp(np.array([0.4, -0.1, 0.2, 0.3, -0.5, 0.1])), ROOT @ ROOT.T, EdgeOrigin.TRACKING
)


def test_an_edge_is_read_as_it_was_written() -> None:
    read = edge_from_message(edge_message(EDGE, 5))
    assert (read.parent, read.child) == (3, 7)
    np.testing.assert_allclose(read.T_parent_child, EDGE.T_parent_child, atol=1e-12)
    np.testing.assert_allclose(read.covariance, EDGE.covariance, atol=1e-9)


def test_only_the_pose_of_the_first_keyframe_in_odom_begins_a_graph() -> None:
    start = start_message(EDGE.T_parent_child, EDGE.covariance, 5, "odom")
    assert begins_graph(start)
    read = edge_from_message(replace(start, header=making.header(5, "keyframe_1")))
    np.testing.assert_allclose(read.T_parent_child, EDGE.T_parent_child, atol=1e-12)
    np.testing.assert_array_equal(start.pose.covariance, EDGE.covariance.ravel())
    assert not begins_graph(replace(start, child_frame_id="keyframe_1"))
    assert not begins_graph(replace(start, child_frame_id="base_link"))
    assert not begins_graph(edge_message(replace(EDGE, parent=4, child=0), 5))


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"child_frame_id": "base_link"}, "'base_link' is no keyframe"),
        ({"covariance": np.zeros(36)}, "not positive definite"),
        ({"covariance": np.full(36, np.nan)}, "not positive definite"),
    ],
)
def test_what_is_no_edge_is_refused(changes: dict[str, Any], says: str) -> None:
    message = edge_message(EDGE, 5)
    if "covariance" in changes:
        changes = {"pose": replace(message.pose, **changes)}
    with pytest.raises(InputError, match=says):
        edge_from_message(replace(message, **changes))
