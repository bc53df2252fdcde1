"""Where the depth of a recording comes from, in words for messages about it."""

from __future__ import annotations

from rgbd_glue_ros.recordings.bag.recording import BagRecording
from rgbd_glue_ros.recordings.recording import Recording
from rgbd_glue_ros.recordings.wrapped import WrappedRecording


def depth_source(recording: Recording) -> str:
    """The depth topic of a bag, whatever its frames went through since; "depth" of others."""
    while isinstance(recording, WrappedRecording):
        recording = recording.recording
    topic = recording.topics.depth if isinstance(recording, BagRecording) else None
    return topic or "depth"
