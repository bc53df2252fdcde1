from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from rigs.bags import CAMERA, CODECS, assert_same_frame, make_frames, recorded, write_rosbag2
from rigs.disks import full_after

from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.recordings import open_recording
from rgbd_glue_ros.recordings.convert import convert
from rgbd_glue_ros.recordings.recording import selected
from rgbd_glue_ros.types import RgbdFrame, Trajectory

FRAMES = make_frames(12)
TRUTH = Trajectory(
    # more often than the frames, starting before and ending after them, not in order
    np.array([FRAMES[0].stamp_ns + t * 10_000_000 for t in (3, -1, 0, 9, 40)], np.int64),
    np.stack([se3.exp(0.1 * i * np.ones(6)) for i in range(5)]),
)


@dataclass(frozen=True)
class Listed(Closing):
    """A sequence in memory, which may end in an error."""

    frames: list[RgbdFrame]
    error: BaseException | None = None
    ground_truth: Trajectory | None = TRUTH
    name: str = "listed"

    @property
    def frame_count(self) -> int:
        return len(self.frames)

    def __iter__(self) -> Iterator[RgbdFrame]:
        yield from self.frames
        if self.error is not None:
            raise self.error

    def select(self, indices: Iterable[int]) -> Iterator[RgbdFrame]:
        return selected(self, indices)

    def close(self) -> None: ...


def same(frames: Iterator[RgbdFrame], originals: list[RgbdFrame], codec: str = "raw") -> None:
    for frame, original in zip(frames, originals, strict=True):
        assert_same_frame(replace(frame, frame_id="camera_optical"), original, CODECS[codec])


@pytest.mark.parametrize("codec", CODECS)
def test_a_recording_becomes_a_bag_with_its_frames_and_true_poses(
    codec: str, tmp_path: Path
) -> None:
    convert(Listed(FRAMES), tmp_path / "bag", compressed=codec == "compressed")
    with open_recording(tmp_path / "bag") as bag:
        same(iter(bag), FRAMES, codec)
        truth = bag.ground_truth
    assert truth is not None
    order = np.argsort(TRUTH.stamps_ns)
    assert truth.stamps_ns.tolist() == TRUTH.stamps_ns[order].tolist()
    assert truth.poses == pytest.approx(TRUTH.poses[order], abs=1e-12)


def test_a_bag_becomes_a_folder_and_that_the_same_bag_again(tmp_path: Path) -> None:
    convert(Listed(FRAMES), tmp_path / "bag", compressed=False)
    with open_recording(tmp_path / "bag") as bag:
        convert(bag, tmp_path / "folder", compressed=False)
    with open_recording(tmp_path / "folder") as folder:
        same(iter(folder), FRAMES)
        assert folder.ground_truth is not None
        assert folder.ground_truth.poses[0] == pytest.approx(TRUTH.poses[1], abs=1e-12)
        convert(folder, tmp_path / "again" / "bag", compressed=False)
    with open_recording(tmp_path / "again" / "bag") as bag:
        same(iter(bag), FRAMES)


def test_distortion_survives_the_way_through_a_folder(tmp_path: Path) -> None:
    for count in (5, 8):
        camera = replace(CAMERA, distortion=tuple(0.01 * i for i in range(1, count + 1)))
        frames = [replace(FRAMES[0], intrinsics=camera)]
        bag = write_rosbag2(tmp_path / f"bag{count}", recorded(frames))
        with open_recording(bag) as source:
            convert(source, tmp_path / f"folder{count}", compressed=False)
        with open_recording(tmp_path / f"folder{count}") as folder:
            assert [frame.intrinsics for frame in folder] == [camera]


def test_grey_images_stay_grey_in_a_bag(tmp_path: Path) -> None:
    grey = [replace(f, color=np.ascontiguousarray(f.color[..., 0])) for f in FRAMES]
    convert(Listed(grey), tmp_path / "bag", compressed=False)
    with open_recording(tmp_path / "bag") as bag:
        same(iter(bag), grey)


@pytest.mark.parametrize("error", [InputError("x", "is truncated", "copy it"), KeyboardInterrupt()])
def test_what_was_converted_before_an_error_or_an_interrupt_is_kept(
    error: BaseException, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with pytest.raises(type(error)):
        convert(Listed(FRAMES, error), tmp_path / "bag", compressed=False)
    is_interrupt = isinstance(error, KeyboardInterrupt)
    assert (f"written so far are in {tmp_path / 'bag'}" in caplog.text) == is_interrupt
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]
    with open_recording(tmp_path / "bag") as bag:
        stamps = [frame.stamp_ns for frame in bag]
    assert len(stamps) >= len(FRAMES) - 5
    assert stamps == [frame.stamp_ns for frame in FRAMES[: len(stamps)]]


def test_a_folder_holds_no_half_of_a_frame_when_interrupted(tmp_path: Path) -> None:
    bag = write_rosbag2(tmp_path / "bag", recorded(FRAMES))
    data = (bag / "bag.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: len(data) // 2])
    with open_recording(cut) as source, pytest.raises(InputError, match="truncated"):
        convert(source, tmp_path / "folder", compressed=False)
    with open_recording(tmp_path / "folder") as folder:
        same(iter(folder), FRAMES[: folder.frame_count])
        assert folder.frame_count >= 3


def test_an_existing_target_is_refused_before_anything_is_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="exists already; give a new folder"):
        convert(Listed([], RuntimeError("was read")), tmp_path, compressed=False)


def test_a_source_without_a_frame_leaves_nothing_behind(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no frames"):
        convert(Listed([]), tmp_path / "bag", compressed=False)
    assert list(tmp_path.iterdir()) == []


def test_a_real_sequence_comes_back_from_a_raw_bag_bit_for_bit(
    shared_data: Path, tmp_path: Path
) -> None:
    with open_recording(shared_data / "rgbd_dataset_freiburg1_desk") as source:
        few = Listed([f for f, _ in zip(source, range(10), strict=False)])
        convert(few, tmp_path / "bag", compressed=False)
    with open_recording(tmp_path / "bag") as bag:
        same(iter(bag), [replace(f, frame_id="camera_optical") for f in few.frames])


def test_on_a_full_disk_the_frames_before_can_be_read_and_it_is_said(tmp_path: Path) -> None:
    frames = make_frames(90)
    said = r"File too large.*free some space.*it holds what was written before: remove it first"
    with full_after(1_500_000), pytest.raises(InputError, match=said):
        convert(Listed(frames), tmp_path / "bag", compressed=False)
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]
    found: list[int] = []
    with open_recording(tmp_path / "bag") as bag, pytest.raises(InputError, match="truncated"):
        found.extend(frame.stamp_ns for frame in bag)
    assert found == [frame.stamp_ns for frame in frames[: len(found)]]
    assert len(found) > 30
