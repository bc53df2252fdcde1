"""Stamps as drivers leave them: none at all, of another clock, or far apart."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rigs.bags import DEPTH, Recorded, make_frames, recorded, write_rosbag2

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.fields import Image, header
from rgbd_glue_ros.messages.stamps import StampSource, explain_miss
from rgbd_glue_ros.messages.synchronizer import Channel
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
        ("header", [0, 0, 0], [0, 101, 102]),
        # one wrong stamp among right ones
        ("header", [5, 0, 7], [5, 0, 7]),
    ],
)
def test_a_message_has_the_stamp_of_its_header_unless_that_is_zero(
    source: str, stamps: list[int], expected: list[int]
) -> None:
    taken = StampSource(source)
    assert [taken.of(Channel.COLOR, t, 100 + i) for i, t in enumerate(stamps)] == expected
    assert taken.is_by_receipt(Channel.COLOR) is (expected[-1] > 100)


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
