"""ScanNet's sensor streams and exported folders give the same frames; a broken one says so."""

from __future__ import annotations

import logging
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rigs.scan import DEPTH, Scan

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.parameters import InputConfig
from rgbd_glue_ros.recordings import open_recording
from rgbd_glue_ros.recordings.calibration import Calibration
from rgbd_glue_ros.recordings.left_out import left_out_of
from rgbd_glue_ros.types import CameraIntrinsics


def summary(sequence: Any) -> Iterator[tuple[Any, ...]]:
    for frame in sequence:
        yield frame.stamp_ns, frame.color.tobytes(), frame.depth.tobytes()


def test_a_stream_gives_aligned_frames_of_the_size_of_depth_in_metres(tmp_path: Path) -> None:
    with open_recording(Scan().write(tmp_path / "scene0707_00.sens")) as sequence:
        assert sequence.name == "scene0707_00"
        assert sequence.frame_count == 5
        frames = list(sequence)
    assert [frame.stamp_ns for frame in frames] == [
        33333333,
        66666666,
        100000000,
        133333333,
        166666666,
    ]
    frame = frames[2]
    assert (frame.intrinsics.width, frame.intrinsics.height) == DEPTH
    assert frame.intrinsics.fy == pytest.approx(57.9)
    assert frame.color.shape == (48, 64, 3)
    np.testing.assert_allclose(frame.color[20, 30], (200, 80, 0), atol=3)
    assert frame.depth[1, 1] == np.float32(1.502)
    assert np.isnan(frame.depth[0, 0])


@pytest.mark.parametrize("kind", ["stream", "export"])
def test_a_given_unit_of_depth_is_taken_in_place_of_the_scans(tmp_path: Path, kind: str) -> None:
    scan = Scan()
    path = scan.write(tmp_path / "a.sens") if kind == "stream" else scan.export(tmp_path / "a")
    with (
        open_recording(path) as as_told,
        open_recording(path, inputs=InputConfig(depth_scale=0.0005)) as given,
    ):
        for usual, other in zip(as_told, given, strict=True):
            np.testing.assert_allclose(other.depth, usual.depth / 2, rtol=1e-6)


@pytest.mark.parametrize("kind", ["stream", "export"])
def test_the_unit_of_a_given_calibration_is_taken_and_logged_unless_another_is_given(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, kind: str
) -> None:
    scan = Scan()
    path = scan.write(tmp_path / "a.sens") if kind == "stream" else scan.export(tmp_path / "a")
    calibration = Calibration(CameraIntrinsics(*DEPTH, 60, 60, 32, 24), 0.0005, "camera.yaml")
    caplog.set_level(logging.INFO)
    with open_recording(path, calibration=calibration) as by_file:
        assert next(iter(by_file)).depth[1, 1] == np.float32(0.75)
    assert "a: depth is in units of 1/2000 m by the factor in camera.yaml" in caplog.text
    inputs = InputConfig(depth_scale=0.002)
    with open_recording(path, calibration=calibration, inputs=inputs) as given_both:
        assert next(iter(given_both)).depth[1, 1] == 3


def test_frames_without_a_pose_are_given_and_have_no_ground_truth(tmp_path: Path) -> None:
    scan = Scan(lost=(1, 3))
    for path in (scan.write(tmp_path / "a.sens"), scan.export(tmp_path / "a")):
        with open_recording(path) as sequence:
            assert len(list(sequence)) == 5
            truth = sequence.ground_truth
            assert truth is not None
            assert list(truth.stamps_ns) == [33333333, 100000000, 166666666]
            np.testing.assert_array_equal(truth.poses[:, 0, 3], [0, 0.25, 0.5])


def test_a_stream_a_folder_with_one_and_its_export_are_the_same_recording(tmp_path: Path) -> None:
    scan = Scan()
    folder = tmp_path / "scene0707_00"
    folder.mkdir()
    stream = scan.write(folder / "scene0707_00.sens")
    exported = scan.export(tmp_path / "exported" / "scene0707_00")
    with open_recording(stream) as a, open_recording(folder) as b, open_recording(exported) as c:
        assert a.name == b.name == c.name
        assert list(summary(a)) == list(summary(b)) == list(summary(c))
        assert next(iter(c)).intrinsics == replace(next(iter(a)).intrinsics, fx=57.8, fy=57.9), (
            "but for the four decimals of an exported matrix"
        )


def test_colour_is_averaged_and_not_sampled(tmp_path: Path) -> None:
    stripes = np.zeros((96, 128), np.uint8)
    stripes[:, ::2] = 255
    scan = Scan(frames=1).export(tmp_path / "scan")
    cv2.imwrite(str(scan / "color/0.jpg"), stripes, [cv2.IMWRITE_JPEG_QUALITY, 100])
    (frame,) = open_recording(scan)
    np.testing.assert_allclose(frame.color, 127.5, atol=3)


@pytest.mark.parametrize("kind", ["stream", "export"])
def test_chosen_frames_alone_are_read(tmp_path: Path, kind: str) -> None:
    damaged = Scan(depth_data={2: b"damaged"})
    if kind == "stream":
        path = damaged.write(tmp_path / "a.sens")
    else:
        path = damaged.export(tmp_path / "a")
        (path / "depth/2.png").write_bytes(b"damaged")
    with open_recording(path) as sequence:
        frames = list(sequence.select([1, 3, 4, 9]))
        assert [frame.depth[1, 1] for frame in frames] == [
            np.float32(1.501),
            np.float32(1.503),
            np.float32(1.504),
        ]


def test_depth_that_is_not_compressed_is_read_too(tmp_path: Path) -> None:
    with open_recording(Scan(depth_compression=0).write(tmp_path / "a.sens")) as sequence:
        assert next(iter(sequence)).depth[1, 1] == 1.5


# what goes wrong


def test_a_stream_that_is_cut_off_gives_its_whole_frames_first(tmp_path: Path) -> None:
    path = Scan().write(tmp_path / "a.sens")
    path.write_bytes(path.read_bytes()[:-20])
    frames = iter(open_recording(path))
    assert len([next(frames) for _ in range(4)]) == 4
    with pytest.raises(InputError, match=r"a\.sens: is truncated after 4 of 5 frames"):
        next(frames)


@pytest.mark.parametrize(
    ("scan", "cause"),
    [
        (Scan(version=3), "is of version 3, not 4"),
        (Scan(version=0x53414E52), "is of version"),
        (Scan(frames=0), "holds no complete frame"),
        (Scan(frames=0, announced=2**60), "holds no complete frame"),
        (Scan(sensor=b"x" * 5000), "has a sensor name of 5000 bytes"),
        (Scan(color_compression=0), "types 0 and 1"),
        (Scan(depth_compression=2), "types 2 and 2"),
        (Scan(depth_size=(2**31, 2**31)), "pixels"),
        (Scan(color_size=(0, 968)), "pixels"),
        (Scan(depth_shift=0.0), "no calibration"),
        (Scan(depth_shift=float("nan")), "no calibration"),
    ],
)
def test_a_header_that_cannot_be_is_refused(tmp_path: Path, scan: Scan, cause: str) -> None:
    with pytest.raises(InputError, match=cause) as error:
        open_recording(scan.write(tmp_path / "a.sens"))
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("data", "cause"),
    [
        (b"nonsense", "damaged depth image"),
        (zlib.compress(bytes(100)), "damaged depth image"),
        (zlib.compress(bytes(10_000_000)), "damaged depth image"),
    ],
)
def test_depth_that_is_damaged_or_unpacks_to_too_much_is_skipped_and_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, data: bytes, cause: str
) -> None:
    with open_recording(Scan(depth_data={1: data}).write(tmp_path / "a.sens")) as sequence:
        assert [frame.depth[1, 1] for frame in sequence] == [
            np.float32(1.5),
            np.float32(1.502),
            np.float32(1.503),
            np.float32(1.504),
        ]
    assert f"frame 1: {cause}" in caplog.text
    assert "a: 1 frames skipped of 5" in caplog.text


def test_a_damaged_frame_that_is_asked_for_alone_is_refused(tmp_path: Path) -> None:
    with (
        open_recording(Scan(depth_data={1: b"damaged"}).write(tmp_path / "a.sens")) as sequence,
        pytest.raises(InputError, match="frame 1: damaged depth image"),
    ):
        list(sequence.select([1]))


def test_a_stream_of_which_no_frame_can_be_read_is_refused(tmp_path: Path) -> None:
    scan = Scan(frames=2, announced=3, depth_data={0: b"damaged", 1: b"damaged"})
    with (
        open_recording(scan.write(tmp_path / "a.sens")) as sequence,
        pytest.raises(InputError, match="frame 0: damaged depth image"),
    ):
        next(iter(sequence))


def test_colour_of_another_size_than_announced_is_refused(tmp_path: Path) -> None:
    path = Scan(color_size=(1296, 968)).write(tmp_path / "a.sens")
    with pytest.raises(InputError, match="its colour is 130x97"):
        next(iter(open_recording(path)))


WHOLE = Scan(frames=2)


@given(st.integers(0, 2**31), st.integers(0, 255))
def test_a_stream_with_a_wrong_byte_is_read_or_refused_and_nothing_else(
    tmp_path_factory: pytest.TempPathFactory, position: int, value: int
) -> None:
    path = WHOLE.write(tmp_path_factory.getbasetemp() / "wrong.sens")
    content = bytearray(path.read_bytes())
    content[position % len(content)] = value
    path.write_bytes(content)
    try:
        with open_recording(path) as sequence:
            list(sequence)
    except InputError:
        pass


def test_of_an_export_frames_without_depth_are_left_out_and_damaged_ones_skipped(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = Scan().export(tmp_path / "scan")
    (folder / "depth/3.png").unlink()
    (folder / "color/0.jpg").write_bytes((folder / "color/0.jpg").read_bytes()[:300])
    with open_recording(folder) as scan:
        assert [frame.stamp_ns for frame in scan] == [66666666, 100000000, 166666666]
        assert left_out_of(scan).unpaired == {"color": 1, "depth": 0}
    assert "1 of 5 color images have no partner" in caplog.text
    assert "1 frames skipped of 4" in caplog.text


def test_an_export_without_depth_numbers_or_camera_is_refused(tmp_path: Path) -> None:
    folder = Scan().export(tmp_path / "scan")
    (folder / "depth").rename(tmp_path / "elsewhere")
    (folder / "depth").mkdir()
    with pytest.raises(InputError, match="scan: has no colour image with depth of its number"):
        open_recording(folder)
    (folder / "depth").rmdir()
    (tmp_path / "elsewhere").rename(folder / "depth")
    (folder / "color/1.jpg").rename(folder / "color/one.jpg")
    with pytest.raises(InputError, match="is not a number"):
        open_recording(folder)
    (folder / "color/one.jpg").unlink()
    (folder / "intrinsic/intrinsic_depth.txt").unlink()
    with pytest.raises(InputError, match=r"intrinsic_depth\.txt: cannot be read"):
        open_recording(folder)
    camera = CameraIntrinsics(*DEPTH, 60, 60, 32, 24)
    assert len(list(open_recording(folder, calibration=camera))) == 4
