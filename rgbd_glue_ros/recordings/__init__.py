"""Sources of recorded frames; the format of a recording is detected."""

from __future__ import annotations

from rgbd_glue_ros.recordings.bag.recording import Topics
from rgbd_glue_ros.recordings.calibration import Calibration, read_calibration
from rgbd_glue_ros.recordings.collection import recordings, split
from rgbd_glue_ros.recordings.formats import FORMATS, Format, open_recording, refuse_recording
from rgbd_glue_ros.recordings.recording import Recording, imu_of

__all__ = [
    "FORMATS",
    "Calibration",
    "Format",
    "Recording",
    "Topics",
    "imu_of",
    "open_recording",
    "read_calibration",
    "recordings",
    "refuse_recording",
    "split",
]
