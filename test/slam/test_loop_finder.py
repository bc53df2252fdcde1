"""Keyframes are compared with those that the odometry does not know, and with no others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigs.drifted import config, drifted
from rigs.hamming_votes import HammingVotes

from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.slam import loop_finder
from rgbd_glue_ros.slam.loop_finder import LoopFinder
from rgbd_glue_ros.slam.map_file import SavedMap
from rgbd_glue_ros.slam.map_keyframe import MapKeyframe
from rgbd_glue_ros.slam.packed_view import packed
from rgbd_glue_ros.types import PoseGraph, Trajectory


def map_of(count: int) -> SavedMap:
    """A map of the first keyframes, where they were tracked."""
    keyframes = [known.keyframe for known in drifted()[:count]]
    edges = tuple(edge for known in drifted()[:count] for edge in known.edges)
    stamps = np.array([keyframe.stamp_ns for keyframe in keyframes])
    poses = np.array([keyframe.T_odom_camera for keyframe in keyframes])
    views = tuple(packed(keyframe.features.view) for keyframe in keyframes)
    return SavedMap(PoseGraph(Trajectory(stamps, poses), edges), views)


def test_the_first_keyframes_of_a_session_are_compared_with_the_last_of_the_map_near_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    compared: list[tuple[int, int]] = []

    def none_of(parent: MapKeyframe, child: MapKeyframe, *_: object) -> None:
        compared.append((parent.row, child.row))

    monkeypatch.setattr(loop_finder, "loop_edge", none_of)
    window = config().odometry.window
    finder = LoopFinder(config(), Glue(config()), HammingVotes)
    finder.restore(map_of(window + 1))
    known = drifted()[window].keyframe
    session = [replace(known, row=number) for number in (window + 1, window + 2)]
    finder.add([finder.tracked(keyframe) for keyframe in session])
    poses = {keyframe.row: keyframe.T_odom_camera for keyframe in finder.keyframes}
    for stored in finder.keyframes:
        assert finder.loops_near(stored, poses, ()) == ()
    last = window
    assert {(last, last + 1), (last, last + 2)} <= set(compared)
    # within a session are those that the odometry has compared
    assert (last + 1, last + 2) not in compared
    assert not [pair for pair in compared if pair[1] <= last]
