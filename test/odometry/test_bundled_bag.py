"""The bundled recording is what its program makes, and its truth is the truth of its images."""

from __future__ import annotations

import sys
from datetime import date
from functools import lru_cache
from pathlib import Path

import cv2
import make_bag
import numpy as np
import pytest
from raycast_room.living_room import living_room
from raycast_room.render import measure
from rosbags.highlevel import AnyReader

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.camera import back_project
from rgbd_glue_ros.geometry.depth import depth_sigma
from rgbd_glue_ros.messages.images import COLOR_SUFFIX, DEPTH_SUFFIX
from rgbd_glue_ros.recordings import open_recording
from rgbd_glue_ros.recordings.bag.writer import AS_REALSENSE, FrameMessages
from rgbd_glue_ros.types import Float64, RgbdFrame

SAMPLE = (0, 23, 104)

same_encoders = pytest.mark.skipif(
    cv2.__version__ != make_bag.OPENCV,
    reason=f"only OpenCV {make_bag.OPENCV} compresses to the same bytes",
)


@pytest.fixture(scope="module")
def frames() -> list[RgbdFrame]:
    with open_recording(make_bag.FOLDER) as sequence:
        return list(sequence)


@pytest.fixture(scope="module")
def poses() -> Float64:
    with open_recording(make_bag.FOLDER) as sequence:
        assert sequence.ground_truth is not None
        assert list(sequence.ground_truth.stamps_ns) == [
            make_bag.stamp_ns(index) for index in range(make_bag.FRAME_COUNT)
        ]
        return sequence.ground_truth.poses


def test_the_bundled_bag_is_smaller_than_8_megabytes() -> None:
    assert sum(path.stat().st_size for path in make_bag.FOLDER.iterdir()) < 8e6


def test_the_bundled_bag_holds_every_frame_at_30_hertz(frames: list[RgbdFrame]) -> None:
    assert len(frames) == make_bag.FRAME_COUNT
    stamps = np.array([frame.stamp_ns for frame in frames])
    np.testing.assert_allclose(np.diff(stamps), 1e9 / 30, atol=1)
    for frame in frames:
        assert frame.color.shape == (480, 640, 3)
        assert frame.depth.shape == (480, 640)
        assert frame.intrinsics == make_bag.CAMERA


def test_the_ground_truth_of_the_bundled_bag_is_the_path_of_the_camera(poses: Float64) -> None:
    path = [make_bag.true_pose(index) for index in range(make_bag.FRAME_COUNT)]
    np.testing.assert_allclose(poses, path, atol=1e-12)


@pytest.mark.parametrize(("i", "j"), [(0, 5), (20, 40), (104, 0), (70, 50)])
def test_depth_moved_between_frames_by_ground_truth_agrees_within_noise(
    i: int, j: int, frames: list[RgbdFrame], poses: Float64
) -> None:
    source, target = frames[i], frames[j]
    v, u = np.nonzero(np.isfinite(source.depth))
    uv = np.column_stack([u, v]).astype(np.float64)
    points = back_project(uv, source.depth[v, u].astype(np.float64), source.intrinsics)
    x, y, z = se3.transform(se3.inverse(poses[j]) @ poses[i], points).T
    K = target.intrinsics
    column = np.rint(K.fx * x / z + K.cx).astype(int)
    row = np.rint(K.fy * y / z + K.cy).astype(int)
    seen = (column >= 0) & (column < K.width) & (row >= 0) & (row < K.height)
    difference = target.depth[row[seen], column[seen]] - z[seen]
    # what is hidden from either camera, or slopes within a pixel, differs by more than noise
    relative = difference / (np.sqrt(2) * depth_sigma(z[seen]))
    relative = relative[np.isfinite(relative)]
    assert len(relative) > 0.5 * len(z)
    assert abs(np.median(relative)) < 0.2
    assert np.median(np.abs(relative)) < 1.0
    assert (np.abs(relative) < 4).mean() > 0.9


def test_depth_of_the_bundled_bag_has_the_noise_and_holes_of_structured_light(
    frames: list[RgbdFrame], poses: Float64
) -> None:
    for index in SAMPLE:
        true, _ = measure(living_room(), poses[index], 0.0, make_bag.CAMERA)
        relative = (frames[index].depth - true) / np.vectorize(depth_sigma)(true)
        known = np.isfinite(relative)
        assert 0.02 < 1 - known.mean() < 0.15
        assert abs(relative[known].mean()) < 0.1
        assert 0.85 < relative[known].std() < 1.15


@lru_cache(maxsize=len(SAMPLE))
def rendered(index: int) -> RgbdFrame:
    """A frame made again, which takes a second."""
    return make_bag.make_frame(index)


@pytest.mark.slow
def test_a_frame_is_rendered_again_pixel_for_pixel(frames: list[RgbdFrame]) -> None:
    for index in SAMPLE:
        again = rendered(index)
        np.testing.assert_array_equal(again.depth, frames[index].depth)
        # what JPEG costs, and no more
        assert cv2.PSNR(again.color, frames[index].color) > 30


@pytest.fixture(scope="module")
def kept() -> dict[tuple[str, int], bytes]:
    """The serialised messages, by topic and time."""
    with AnyReader([make_bag.FOLDER]) as reader:
        return {(c.topic, stamp): bytes(raw) for c, stamp, raw in reader.messages()}


@same_encoders
@pytest.mark.slow
def test_frames_are_rendered_again_byte_for_byte(
    kept: dict[tuple[str, int], bytes], tmp_path: Path
) -> None:
    # another tenth of them every day
    indices = sorted({*SAMPLE, *range(date.today().toordinal() % 10, make_bag.FRAME_COUNT, 10)})
    sys.stdout.write(f"frames {indices}\n")
    with make_bag.open_writer(tmp_path / make_bag.FOLDER.name) as writer:
        for index in indices:
            frame = rendered(index) if index in SAMPLE else make_bag.make_frame(index)
            writer.write(writer.encode(frame))
            writer.write_pose(make_bag.stamp_ns(index), make_bag.true_pose(index))
    with AnyReader([tmp_path / make_bag.FOLDER.name]) as reader:
        made = {(c.topic, stamp): bytes(raw) for c, stamp, raw in reader.messages()}
    assert len(made) == 4 * len(indices)
    assert made.items() <= kept.items()


# with the locked versions alone: sines of another NumPy may differ in their last bit
@pytest.mark.slow
def test_messages_of_the_bundled_bag_written_again_give_the_same_files(
    kept: dict[tuple[str, int], bytes], tmp_path: Path
) -> None:
    topics = AS_REALSENSE
    names = (topics.color + COLOR_SUFFIX, topics.depth + DEPTH_SUFFIX, topics.info)
    folder = tmp_path / make_bag.FOLDER.name
    with make_bag.open_writer(folder) as writer:
        for index in range(make_bag.FRAME_COUNT):
            stamp_ns = make_bag.stamp_ns(index)
            messages = [memoryview(kept[name, stamp_ns]) for name in names]
            writer.write(FrameMessages(stamp_ns, *messages))
            writer.write_pose(stamp_ns, make_bag.true_pose(index))
    files = {path.name: path.read_bytes() for path in make_bag.FOLDER.iterdir()}
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == files
