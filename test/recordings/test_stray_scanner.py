"""A phone's video beside depth images: what of it is damaged is skipped, and said."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from rigs.layouts import FRAMES, color, stray_scanner

from rgbd_glue_ros.recordings import open_recording


def shorten_video(folder: Path, frames: int) -> None:
    video = cv2.VideoWriter(str(folder / "rgb.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 60, (128, 96))
    for i in range(frames):
        video.write(np.asarray(color(i, (128, 96)), np.uint8))
    video.release()


def test_a_damaged_odometry_is_said_and_the_recording_has_no_ground_truth(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    stray_scanner(tmp_path)
    (tmp_path / "odometry.csv").write_text("no trajectory\n")
    with open_recording(tmp_path) as recording:
        assert recording.ground_truth is None
        assert len(list(recording)) == FRAMES
    assert "odometry.csv" in caplog.text
    assert "continuing without ground truth" in caplog.text


def test_frames_that_cannot_be_read_are_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    stray_scanner(tmp_path)
    (tmp_path / f"depth/{1:06d}.png").write_bytes(b"no image")
    with open_recording(tmp_path) as recording:
        assert len(list(recording)) == FRAMES - 1
    assert f"1 frames skipped of {FRAMES}" in caplog.text


def test_a_video_that_ends_before_depth_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    stray_scanner(tmp_path)
    shorten_video(tmp_path, FRAMES - 1)
    with open_recording(tmp_path) as recording:
        assert len(list(recording)) == FRAMES - 1
    assert f"has {FRAMES - 1} frames, so 1 of {FRAMES} depth images have none" in caplog.text


def test_of_a_whole_recording_nothing_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    stray_scanner(tmp_path)
    with open_recording(tmp_path) as recording:
        assert len(list(recording)) == FRAMES
    assert caplog.text == ""
