"""Why a map does not grow: what is said of the odometry's topics."""

from __future__ import annotations

import pytest

from rgbd_glue_ros.live.odometry_faults import OdometryTopic, explain_no_keyframes

BY = "/rgbd_odometry (reliable)"


def said(*received: int | None) -> str | None:
    """What is said of poses, keyframes and edges; None of a topic is that nobody publishes it."""
    names = ("/pose", "/keyframe/pose", "/keyframe/edges")
    return explain_no_keyframes(
        *(
            OdometryTopic(name, () if count is None else (BY,), count or 0)
            for name, count in zip(names, received, strict=True)
        )
    )


@pytest.mark.parametrize(
    ("received", "line"),
    [
        ((None, None, None), "/pose, /keyframe/pose and /keyframe/edges have no publisher: start"),
        ((150, None, None), "/keyframe/pose and /keyframe/edges have no publisher"),
        ((150, 3, None), "/keyframe/edges has no publisher"),
        ((0, 0, 0), f"no message on /pose arrived from {BY}: the odometry has no pose"),
        ((0, 7, 8), "no message on /pose arrived"),
        (
            (150, 0, 0),
            f"no message on /keyframe/pose arrived from {BY}: they are created as the camera mo",
        ),
        (
            (150, 2, 0),
            f"no message on /keyframe/edges arrived from {BY}: check whether type and QoS",
        ),
    ],
)
def test_the_missing_topic_is_named_with_the_remedy(
    received: tuple[int | None, ...], line: str
) -> None:
    assert line in str(said(*received))


@pytest.mark.parametrize("received", [(150, 7, 20), (150, 1, 0), (1, 7, 20)])
def test_nothing_is_reported_if_poses_arrive_and_the_camera_may_be_at_rest(
    received: tuple[int, ...],
) -> None:
    assert said(*received) is None
