"""Where recorded frames come from; the format of a recording is found out by itself."""

from __future__ import annotations

from rgbd_glue_ros.sequences.bag import Topics
from rgbd_glue_ros.sequences.base import Sequence
from rgbd_glue_ros.sequences.calibration import load_calibration
from rgbd_glue_ros.sequences.collection import recordings, split
from rgbd_glue_ros.sequences.formats import FORMATS, Format, open_sequence

__all__ = [
    "FORMATS",
    "Format",
    "Sequence",
    "Topics",
    "load_calibration",
    "open_sequence",
    "recordings",
    "split",
]
