"""The topic that the depth of a recording comes from, for messages about it."""

from __future__ import annotations

from rgbd_glue_ros.recordings.bag.recording import BagRecording
from rgbd_glue_ros.recordings.recording import Recording
from rgbd_glue_ros.recordings.wrapped import unwrapped


def depth_topic(recording: Recording) -> str:
    """The depth topic of a bag, whatever its frames went through since; "" of others."""
    source = unwrapped(recording)
    return (source.topics.depth or "") if isinstance(source, BagRecording) else ""
