"""Stamps as drivers leave them: none at all, of another clock, or far apart."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rigs.bags import DEPTH, Recorded, make_frames, recorded, write_rosbag2

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.fields import Image
from rgbd_glue_ros.messages.making import header
from rgbd_glue_ros.messages.stamps import StampSource, explain_miss
from rgbd_glue_ros.messages.synchronizer import Channel, Match, Synchronizer
from rgbd_glue_ros.parameters import InputConfig
from rgbd_glue_ros.recordings import open_recording
from rgbd_glue_ros.types import NANOSECONDS

MS = 1_000_000
START = 1_700_000_000 * NANOSECONDS


@pytest.mark.parametrize(
    ("source", "stamps", "expected"),
    [
        ("header", [5, 6, 7], [5, 6, 7]),
        ("receipt", [5, 6, 7], [100, 101, 102]),
        # simulated time begins at zero
        ("header", [0, 6, 7], [0, 6, 7]),
        ("header", [0, 0, 0], [100, 101, 102]),
        # one wrong stamp among right ones
        ("header", [5, 0, 7], [5, 0, 7]),
    ],
)
def test_a_message_has_the_stamp_of_its_header_unless_that_is_zero(
    source: str, stamps: list[int], expected: list[int]
) -> None:
    source_of = StampSource[int](source)
    taken: list[tuple[int, int]] = []
    for i, stamp in enumerate(stamps):
        taken += source_of.accept(Channel.COLOR, stamp, 100 + i, i)
    assert taken == list(zip(expected, range(3), strict=True))
    assert source_of.is_by_receipt(Channel.COLOR) is (expected[-1] > 100)
    assert source_of.flush() == []


def test_an_only_image_whose_stamp_is_zero_comes_last_and_an_only_info_at_once() -> None:
    source = StampSource[str]("header")
    assert source.accept(Channel.INFO, 0, 100, "info") == [(0, "info")]
    assert source.accept(Channel.COLOR, 0, 101, "color") == []
    assert source.accept(Channel.DEPTH, 0, 102, "depth") == []
    assert source.flush() == [(Channel.COLOR, 0, "color"), (Channel.DEPTH, 0, "depth")]
    assert source.flush() == []


def test_a_stream_that_loses_its_stamps_and_gets_them_back_loses_no_message() -> None:
    source = StampSource[int]("header")
    stamps = [0, 0, 7, 0, 8]
    taken = [pair for i in range(5) for pair in source.accept(Channel.DEPTH, stamps[i], 100 + i, i)]
    assert taken == [(100, 0), (101, 1), (7, 2), (0, 3), (8, 4)]


@pytest.mark.parametrize("first_info", [Channel.INFO, Channel.COLOR])
@pytest.mark.parametrize("period_ns", [0, 33 * MS])
def test_the_first_frame_is_matched_whether_zero_is_its_stamp_or_none(
    period_ns: int, first_info: Channel
) -> None:
    source, sync = StampSource[int]("header"), Synchronizer[int](20 * MS, 10)
    order = sorted(Channel, key=lambda channel: channel is not first_info)
    matches: list[Match[int]] = []
    for i in range(8):
        for channel in order:
            for stamp, item in source.accept(channel, i * period_ns, START + i * 33 * MS, i):
                matches += sync.add(channel, stamp, item)
    start = 0 if period_ns else START
    assert [(m.stamp_ns, m.color, m.depth) for m in matches] == [
        (start + i * 33 * MS, i, i) for i in range(len(matches))
    ]
    assert len(matches) >= 7
    stamps = [match.stamp_ns for match in matches]
    assert stamps == sorted(stamps)


@pytest.mark.parametrize(
    ("distance_ns", "said"),
    [
        (31 * MS, "31.0 ms apart at best, and pair up to 20.0 ms: synchronise"),
        (31 * MS, "raise approx_sync_max_interval"),
        (START, "1700000000.0 s apart at best, so they come from two clocks"),
        (START, "set stamps to receipt"),
    ],
)
def test_far_apart_stamps_and_two_clocks_get_different_diagnoses(
    distance_ns: int, said: str
) -> None:
    assert said in explain_miss(distance_ns, 20 * MS)


FRAMES = make_frames(4)


def stamped(message: Recorded, stamp_ns: int) -> Recorded:
    """A message with another stamp in its header than that of its recording."""
    head = header(stamp_ns, message.message.header.frame_id)
    return replace(message, message=replace(message.message, header=head))


def of_two_clocks() -> list[Recorded]:
    return [
        stamped(m, m.stamp_ns - START // 2) if m.topic == DEPTH else m for m in recorded(FRAMES)
    ]


def test_a_bag_without_stamps_uses_the_times_of_recording(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    bag = write_rosbag2(tmp_path / "bag", [stamped(m, 0) for m in recorded(FRAMES)])
    with open_recording(bag) as recording:
        assert [frame.stamp_ns for frame in recording] == [frame.stamp_ns for frame in FRAMES]
    assert "images have no stamp; their time of recording is used" in caplog.text


def test_where_depth_alone_has_no_stamps_the_first_frame_is_used_too(tmp_path: Path) -> None:
    messages = [stamped(m, 0) if m.topic == DEPTH else m for m in recorded(FRAMES)]
    with open_recording(write_rosbag2(tmp_path / "bag", messages)) as recording:
        assert [frame.stamp_ns for frame in recording] == [frame.stamp_ns for frame in FRAMES]


def test_a_bag_that_begins_at_zero_keeps_its_first_frame(tmp_path: Path) -> None:
    start_ns = FRAMES[0].stamp_ns
    messages = [stamped(m, m.stamp_ns - start_ns) for m in recorded(FRAMES[:2])]
    (last,) = (m for m in messages[3:] if m.topic == DEPTH)
    messages.remove(last)
    with open_recording(write_rosbag2(tmp_path / "bag", messages)) as recording:
        assert [frame.stamp_ns for frame in recording] == [0]


def test_streams_of_two_clocks_pair_by_receipt_on_request(tmp_path: Path) -> None:
    bag = write_rosbag2(tmp_path / "bag", of_two_clocks())
    with open_recording(bag) as recording, pytest.raises(InputError, match="from two clocks"):
        list(recording)
    with open_recording(bag, inputs=InputConfig(stamps="receipt")) as recording:
        assert [frame.stamp_ns for frame in recording] == [frame.stamp_ns for frame in FRAMES]


def test_a_recording_pairs_images_up_to_the_given_interval(tmp_path: Path) -> None:
    late = [
        stamped(m, m.stamp_ns + 30 * MS) if m.topic == DEPTH else m for m in recorded(FRAMES[:1])
    ]
    bag = write_rosbag2(tmp_path / "bag", late)
    with open_recording(bag) as recording, pytest.raises(InputError, match=r"30\.0 ms apart"):
        list(recording)
    with open_recording(bag, inputs=InputConfig(approx_sync_max_interval=0.04)) as recording:
        (frame,) = recording
    assert frame.depth_delay_ns == 30 * MS


def test_frames_of_ros_1_lose_their_leading_slash(tmp_path: Path) -> None:
    slashed = [replace(frame, frame_id="/openni_rgb_optical_frame") for frame in FRAMES]
    with open_recording(write_rosbag2(tmp_path / "bag", recorded(slashed))) as recording:
        assert {frame.frame_id for frame in recording} == {"openni_rgb_optical_frame"}


@pytest.mark.parametrize(("depth_scale", "factor"), [(0.0001, 0.1), (5000, 0.2), (0.0, 1.0)])
def test_the_unit_of_depth_can_be_set_for_a_recording(
    tmp_path: Path, depth_scale: float, factor: float
) -> None:
    def in_millimetres(m: Recorded) -> Recorded:
        if m.topic != DEPTH:
            return m
        values = m.message.data.view(np.float32)
        units = np.nan_to_num(np.rint(values * 1000)).astype("<u2")
        image = Image(m.message.header, 48, 64, "16UC1", 0, 128, units.view(np.uint8))
        return replace(m, message=image)

    bag = write_rosbag2(tmp_path / "bag", map(in_millimetres, recorded(FRAMES[:1])))
    with open_recording(bag, inputs=InputConfig(depth_scale=depth_scale)) as recording:
        (frame,) = recording
    np.testing.assert_allclose(frame.depth, FRAMES[0].depth * factor, rtol=1e-5)
