"""Why a map does not grow: what is said of the odometry's topics."""

from __future__ import annotations

import pytest

from rgbd_glue_ros.live.odometry_faults import (
    OdometryTopic,
    describe_network,
    explain_late_start,
    explain_no_keyframes,
    explain_no_poses,
)

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


def test_an_odometry_that_had_poses_is_said_to_have_stopped_and_when() -> None:
    last = "the last of 573 messages came 5 s ago"

    def line(*publishers: str) -> str | None:
        topics = (("/pose", 0), ("/keyframe/pose", 43), ("/keyframe/edges", 42))
        return explain_no_keyframes(*(OdometryTopic(t, publishers, n, last) for t, n in topics))

    assert line(BY) == (
        f"No more keyframes: {last} on /pose from {BY}: the odometry has no pose any more; its log "
        "says why"
    )
    assert line() == (
        "No more keyframes: /pose, /keyframe/pose and /keyframe/edges have no publisher any more; "
        f"{last} on /pose: the odometry node has ended; start it again"
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
            f"no message on /keyframe/pose arrived from {BY}: the odometry creates them only where",
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


def test_where_the_odometry_knows_the_room_new_views_and_its_reset_service_are_named() -> None:
    def line(*nodes: str) -> str:
        topics = (("/pose", 150), ("/keyframe/pose", 0), ("/keyframe/edges", 0))
        return str(
            explain_no_keyframes(*(OdometryTopic(t, (BY,), n, "", nodes) for t, n in topics))
        )

    called = "/a/odo/reset_odom (ros2 service call /a/odo/reset_odom std_srvs/srv/Empty)"
    assert line("/a/odo").endswith(
        "only where the view leaves that of its latest ones, and does not send earlier ones again: "
        f"move the camera to a new view, or call {called}, with which the odometry begins anew"
    )
    for nodes in ((), ("/a", "/b")):
        assert "or call its service ~/reset_odom, with" in line(*nodes)


def test_a_map_that_begins_late_is_said_to_lack_the_earlier_keyframes() -> None:
    said = explain_late_start(12, ["/rgbd_odometry"])
    assert said.startswith("begins with keyframe 12, without 12 earlier ones: the odometry sends")
    assert "call /rgbd_odometry/reset_odom (" in said
    assert "without 1 earlier one:" in explain_late_start(1, [])


@pytest.mark.parametrize("received", [(150, 7, 20), (150, 1, 0), (1, 7, 20)])
def test_nothing_is_reported_if_poses_arrive_and_the_camera_may_be_at_rest(
    received: tuple[int, ...],
) -> None:
    assert said(*received) is None


EXAMPLE = "`odometry --camera realsense_d400`"
NETWORK = "it must have the same ROS_DOMAIN_ID, which is 7 here"


@pytest.mark.parametrize(
    ("publishers", "heard_of", "was_there", "line"),
    [
        (
            (),
            [],
            False,
            f"nobody publishes /odom: start the node, as in {EXAMPLE}. If it runs, {NETWORK}",
        ),
        ((), [], True, "/odom has no publisher any more: the node has ended; start it again"),
        ((), ["/a/x"], True, "nobody publishes /odom, but /a/x runs: give its namespace, as in"),
        (
            (),
            ["/a/x", "/b/x"],
            False,
            "nobody publishes /odom, but /a/x and /b/x run: give the namespace of one, as in",
        ),
        ((BY,), ["/a/x"], False, f"no message on /odom arrived from {BY}: check whether it has"),
        ((BY,), [], True, f"no message on /odom arrived from {BY} lately: it hangs, or was killed"),
    ],
)
def test_what_is_said_of_missing_poses_depends_on_who_is_there(
    publishers: tuple[str, ...], heard_of: list[str], was_there: bool, line: str
) -> None:
    odom = OdometryTopic("/odom", publishers, 0)
    assert explain_no_poses(odom, heard_of, NETWORK, was_there=was_there).startswith(line)


@pytest.mark.parametrize(
    ("environment", "says"),
    [
        ({}, "ROS_DOMAIN_ID, which is 0 here; the network must let multicast through"),
        ({"ROS_DOMAIN_ID": ""}, "which is 0 here"),
        ({"ROS_DOMAIN_ID": "42"}, "which is 42 here"),
        ({"ROS_LOCALHOST_ONLY": "1"}, "only nodes of this machine are found: unset ROS_LOCALHOST"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}, "set ROS_AUTOMATIC_DISCOVERY_RANGE=SUBN"),
    ],
)
def test_where_nodes_are_looked_for_is_said(environment: dict[str, str], says: str) -> None:
    assert says in describe_network(environment)
