"""The lines that say what is wrong with what arrives."""

from __future__ import annotations

from rgbd_glue_ros.live.input_faults import (
    Input,
    explain_interval,
    explain_missing,
    explain_silence,
)
from rgbd_glue_ros.messages.synchronizer import Channel

MS = 1_000_000


def silence(closest_miss_ns: int | None = None, **received: int | None) -> str:
    inputs = [
        Input(
            Channel[name.upper()],
            f"/{name}",
            () if count is None else ("/camera (best effort)",),
            count or 0,
            (count or 0) / 5,
        )
        for name, count in received.items()
    ]
    return explain_silence(inputs, closest_miss_ns, 20 * MS)


def test_a_topic_without_publisher_is_named_with_the_remedy_to_remap() -> None:
    line = silence(color=150, depth=None, info=150)
    assert "/depth (depth) has no publisher" in line
    assert "/color (color) by /camera (best effort): 150 messages (30.0 Hz)" in line
    assert "depth is missing: start the camera, or remap" in line


def test_a_topic_that_is_published_but_does_not_arrive_points_at_type_and_qos() -> None:
    line = silence(color=0, depth=0, info=150)
    assert "color and depth are missing" in line
    assert "type and QoS" in line


def test_stamps_too_far_apart_are_said_with_both_times() -> None:
    line = silence(closest_miss_ns=31 * MS, color=150, depth=150, info=150)
    assert "31.0 ms apart" in line
    assert "up to 20.0 ms" in line


def test_a_distance_above_half_a_frame_is_said_with_both_times() -> None:
    line = explain_interval(18 * MS, 33 * MS)
    assert line is not None
    assert "18.0 ms apart" in line
    assert "33.0 ms between frames" in line
    assert explain_interval(16 * MS, 33 * MS) is None


def test_messages_that_never_came_are_said_by_channel() -> None:
    received = {Channel.COLOR: 145, Channel.DEPTH: 150, Channel.INFO: 148}
    missing = {Channel.COLOR: 5, Channel.DEPTH: 0, Channel.INFO: 2}
    line = explain_missing(missing, received)
    assert line is not None
    assert "5 of 150 color and 2 of 150 camera_info messages never came" in line
    assert explain_missing(dict.fromkeys(Channel, 0), received) is None
