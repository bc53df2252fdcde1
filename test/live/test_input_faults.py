"""The lines that say what is wrong with what arrives."""

from __future__ import annotations

import pytest

from rgbd_glue_ros.live.input_faults import (
    Input,
    explain_gaps,
    explain_interval,
    explain_losses,
    explain_rates,
    explain_silence,
    explain_slowness,
    explain_waiting,
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
    assert "/color (color) from /camera (best effort): 150 messages (30.0 Hz)" in line
    assert "depth is missing: start the camera, or remap" in line


def test_a_topic_that_is_published_but_does_not_arrive_points_at_type_and_qos() -> None:
    line = silence(color=0, depth=0, info=150)
    assert "color and depth are missing" in line
    assert "type and QoS" in line


def test_a_camera_that_worked_is_said_to_have_stopped_and_when() -> None:
    last = "the last of 573 messages came 5 s ago"

    def line(*publishers: str) -> str:
        inputs = [Input(c, f"/{c.value}", publishers, 0, 0.0, last=last) for c in Channel]
        return explain_silence(inputs, None, 20 * MS)

    hung = line("/driver (best effort)")
    assert hung.startswith(f"/color (color) from /driver (best effort): {last}; /depth")
    assert "color and depth and camera_info stopped: the driver hangs, or was killed" in hung
    ended = line()
    assert ended.startswith(f"/color (color) has no publisher any more: {last}; /depth")
    assert "camera_info stopped: the driver has ended: start it again" in ended
    for said in (hung, ended):
        assert "QoS" not in said
        assert "0 messages" not in said
        assert "remap" not in said


def test_a_stream_that_stopped_is_told_from_one_that_never_came() -> None:
    by = ("/driver",)
    stopped = Input(Channel.COLOR, "/c", by, 0, 0.0, last="the only message came 9 s ago")
    coming = Input(Channel.INFO, "/i", by, 5, 1.0, last="the last of 5 messages came 0 s ago")
    line = explain_silence([stopped, Input(Channel.DEPTH, "/d", by, 0, 0.0), coming], None, 0)
    assert (
        "/d (depth) from /driver: 0 messages (0.0 Hz); /i (camera_info) from /driver: 5 m" in line
    )
    assert "; depth is missing: check whether the camera runs" in line
    assert "; color stopped: the driver hangs" in line


def test_stamps_too_far_apart_are_reported_with_both_intervals() -> None:
    line = silence(closest_miss_ns=31 * MS, color=150, depth=150, info=150)
    assert "31.0 ms apart" in line
    assert "up to 20.0 ms" in line


def test_images_that_miss_each_other_in_a_short_queue_ask_for_a_longer_one() -> None:
    inputs = [Input(c, f"/{c.value}", ("/camera",), 150, 30.0) for c in Channel]
    line = explain_silence(inputs, 160 * MS, 20 * MS, queue_needed=21)
    assert "set sync_queue_size:=21" in line
    assert "approx_sync_max_interval" not in line


def test_images_that_repeat_one_stamp_are_reported_with_the_time_of_receipt_as_remedy() -> None:
    inputs = [Input(c, f"/{c.value}", ("/camera",), 150, 30.0) for c in Channel]
    line = explain_silence(inputs, None, 20 * MS, repeated=[Channel.COLOR, Channel.DEPTH])
    assert "the messages of color and depth repeat one stamp: make the driver stamp" in line
    assert "-p stamps:=receipt" in line


def test_stamps_that_go_backward_from_message_to_message_are_reported() -> None:
    inputs = [Input(c, f"/{c.value}", ("/camera",), 150, 30.0) for c in Channel]
    line = explain_silence(inputs, 160 * MS, 20 * MS, 0, [Channel.COLOR, Channel.DEPTH])
    assert "the stamps of color and depth go backward from message to message" in line


def test_an_interval_above_half_a_period_is_reported_with_both_times() -> None:
    line = explain_interval(18 * MS, 33 * MS)
    assert line is not None
    assert "18.0 ms apart" in line
    assert "33.0 ms between frames" in line
    assert explain_interval(16 * MS, 33 * MS) is None


@pytest.mark.parametrize(
    ("received", "missing", "words"),
    [
        # gaps in the stamps, of colour alone
        ((130, 150, 150), (20, 0, 0), ["20 of 150 color messages never arrived"]),
        # best effort without the profile: infos arrive, and most gaps are too wide to be counted
        (
            (34, 36, 150),
            (24, 20, 0),
            ["116 of 150 color", "114 of 150 depth", "FASTRTPS_DEFAULT_PROFILES_FILE=/p.xml"],
        ),
        # gaps in the stamps of all, and as many of colour's own again
        ((110, 130, 130), (40, 20, 20), ["20 of 130 color messages never arrived"]),
        ((130, 130, 130), (20, 20, 20), None),
        # stamps that jitter look like gaps
        ((150, 150, 150), (7, 5, 0), None),
        ((148, 150, 149), (0, 0, 0), None),
        ((0, 0, 0), (0, 0, 0), None),
        # an info that is latched, or whose stamps are those of receipt
        ((150, 150, 1), (0, 0, 0), None),
        ((150, 150, 150), (0, 0, 38), None),
    ],
)
def test_a_loss_of_more_than_a_tenth_is_reported_with_the_remedy(
    received: tuple[int, ...], missing: tuple[int, ...], words: list[str] | None
) -> None:
    line = explain_losses(
        dict(zip(Channel, received, strict=True)),
        dict(zip(Channel, missing, strict=True)),
        "/p.xml",
    )
    if words is None:
        assert line is None
    else:
        assert line is not None
        assert all(word in line for word in words)


@pytest.mark.parametrize("received", [(0, 150, 150), (150, 0, 150), (0, 0, 101)])
def test_a_channel_that_delivers_nothing_at_all_is_not_called_lost(
    received: tuple[int, ...],
) -> None:
    counts = dict(zip(Channel, received, strict=True))
    assert explain_losses(counts, dict.fromkeys(Channel, 0), "/p.xml") is None


def test_what_this_node_has_set_is_not_recommended_to_it() -> None:
    line = explain_losses(
        dict(zip(Channel, (34, 36, 150), strict=True)), dict.fromkeys(Channel, 0), None
    )
    assert line is not None
    assert "set for it what this node has: FASTRTPS_DEFAULT_PROFILES_FILE" in line


@pytest.mark.parametrize(
    ("received", "periods_ms", "line"),
    [
        ((150, 75, 150), (33, 67, 33), "depth comes at 15 Hz and color at 30 Hz"),
        ((100, 150, 1), (50, 33, 33), "color comes at 20 Hz and depth at 30 Hz"),
        # every other depth image lost at random: some gaps are of one period, some of many
        ((150, 75, 150), (33, 33, 33), None),
        ((150, 148, 150), (33, 33, 33), None),
        ((150, 75, 1), (33, 67, 0), "depth comes at 15 Hz"),
        ((0, 0, 0), (0, 0, 0), None),
    ],
)
def test_a_lower_rate_of_one_stream_is_not_a_loss(
    received: tuple[int, ...], periods_ms: tuple[int, ...], line: str | None
) -> None:
    told = explain_rates(
        dict(zip(Channel, received, strict=True)),
        {c: ms * MS for c, ms in zip(Channel, periods_ms, strict=True)},
    )
    assert (told is None) if line is None else (told is not None and line in told)


def test_gaps_in_all_streams_come_from_the_source_and_are_not_losses() -> None:
    gaps = dict.fromkeys(Channel, 15)
    line = explain_gaps(dict.fromkeys(Channel, 132), gaps) or ""
    assert "15 of 147 frames were never sent" in line
    assert "FASTRTPS" not in line
    assert explain_gaps(dict.fromkeys(Channel, 150), gaps) is None
    assert explain_gaps(dict.fromkeys(Channel, 132), {**gaps, Channel.INFO: 0}) is None
    assert explain_gaps(dict.fromkeys(Channel, 0), dict.fromkeys(Channel, 0)) is None


def test_frames_that_come_too_fast_are_reported_with_the_parameter_that_makes_them_smaller() -> (
    None
):
    line = explain_slowness(67, 83, 33_333_333, 1280)
    assert line is not None
    assert "83 of 150 frames were dropped, since they come faster at 30 Hz" in line
    assert "max_width:=640" in line
    small = explain_slowness(67, 83, 33_333_333, 640)
    assert small is not None
    assert "max_width" not in small
    learned = explain_slowness(20, 130, 33_333_333, 640, ["features.visual:=xfeat"])
    assert learned is not None
    assert "processes them (4.0 Hz)" in learned
    assert "features.visual:=xfeat takes most of the time" in learned
    assert "features.matcher_keypoints" in learned
    assert explain_slowness(140, 10, 33_333_333, 1280) is None
    assert explain_slowness(0, 0, 0, 0) is None


def test_frames_dropped_while_others_waited_for_tf_are_not_blamed_on_the_machine() -> None:
    period_ns, transform = 50 * MS, "the transform from base_link to wheel_odom"
    line = explain_waiting(41, 59, period_ns, 4100 * MS, transform) or ""
    assert "59 of 100 frames were dropped, since others waited 4.1 s for the tr" in line
    assert "base_link to wheel_odom on TF" in line
    assert "machine" not in line
    # most of them came while frames were processed, not while they waited
    assert explain_waiting(41, 59, period_ns, 300 * MS, transform) is None
    assert explain_waiting(99, 1, period_ns, 4100 * MS, transform) is None
    assert explain_waiting(0, 59, 0, 0, "") is None


def test_before_the_first_frame_is_processed_a_bound_of_the_rate_is_reported() -> None:
    learned = "features.visual:=alike", "features.geometric:=fcgf"
    told = explain_slowness(0, 30, 33_333_333, 640, learned) or ""
    assert "processes them (below 1.0 Hz)" in told
    assert "features.visual:=alike and features.geometric:=fcgf take most of the time" in told
