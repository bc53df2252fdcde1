"""The messages of a recording for playing to a node, in the order of recording."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from itertools import chain
from pathlib import Path
from typing import Protocol

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.live import topics
from rgbd_glue_ros.messages.reading import stamp_ns
from rgbd_glue_ros.messages.synchronizer import Channel
from rgbd_glue_ros.recordings import Recording, imu_of
from rgbd_glue_ros.recordings.bag.file import BagFile
from rgbd_glue_ros.recordings.bag.recording import BagRecording
from rgbd_glue_ros.recordings.bag.writer import (
    IMU_TYPE,
    INFO_TYPE,
    ImageCodec,
    encode_frame,
    encode_imu,
)
from rgbd_glue_ros.recordings.prefetch import mapped_ahead
from rgbd_glue_ros.recordings.wrapped import WrappedRecording
from rgbd_glue_ros.types import NANOSECONDS, ImuSamples, RgbdFrame, Trajectory

# Samples of an IMU before the first frame: a node uses their mean as gravity.
_LEAD_NS = NANOSECONDS // 2
# Between two rounds of a single frame.
_USUAL_PERIOD_NS = NANOSECONDS // 30


class Sensor(Enum):
    """What a recording may contain besides the channels of its frames."""

    IMU = "imu"


Stream = Channel | Sensor
"""What is published on a separate topic."""


@dataclass(frozen=True)
class PlayedMessage:
    """A message of a recording.

    Attributes:
        channel: kind of content.
        recorded_ns: when it was recorded, nanoseconds.
        stamp_ns: its header's stamp, nanoseconds.
        data: its CDR.
    """

    channel: Stream
    recorded_ns: int
    stamp_ns: int
    data: bytes


class Played(Protocol):
    """A recording as messages."""

    @property
    def name(self) -> str:
        """Its name in a report."""

    @property
    def types(self) -> Mapping[Stream, str]:
        """Types of the messages of each channel, and of its sensors."""

    @property
    def frame_count(self) -> int:
        """The maximum number of colour images."""

    @property
    def ground_truth(self) -> Trajectory | None:
        """T_world_camera, None if it is not known."""

    @property
    def messages(self) -> Iterable[PlayedMessage]:
        """The messages in the order of recording; can be iterated repeatedly."""

    def sample(self, count: int) -> list[RgbdFrame]:
        """At most ``count`` frames spread over the recording, for viewing."""


def begun(messages: Iterable[PlayedMessage]) -> Iterator[PlayedMessage]:
    """The same messages, of which the first is read at once.

    Raises:
        InputError: it cannot be read, or there is none.
    """
    rest = iter(messages)
    return chain([next(rest)], rest)


def transport(played: Played, channel: Stream) -> str:
    """The value of ``image_transport`` or ``depth_transport`` for receiving a channel."""
    if played.types[channel] != "sensor_msgs/msg/CompressedImage":
        return topics.RAW
    return "compressedDepth" if channel is Channel.DEPTH else "compressed"


@dataclass(frozen=True)
class PlayedBag:
    """A bag in memory, byte for byte; a ``Played``."""

    name: str
    types: Mapping[Stream, str]
    messages: tuple[PlayedMessage, ...]
    ground_truth: Trajectory | None
    path: Path

    @staticmethod
    def load(path: Path) -> PlayedBag:
        """Reads a rosbag2.

        Raises:
            InputError: the bag cannot be read, has no RGB-D sequence, or is from ROS 1.
        """
        with BagRecording(path) as sequence:
            name, found, truth = sequence.name, sequence.topics, sequence.ground_truth
        channels: dict[str | None, Stream] = {
            found.color: Channel.COLOR,
            found.depth: Channel.DEPTH,
            found.info: Channel.INFO,
        }
        with BagFile(path) as bag:
            if bag.is_ros1:
                raise InputError(path, "is a ROS 1 bag", "convert it with `rgbd-glue convert`")
            types = {channel: bag.topics[str(topic)].type for topic, channel in channels.items()}
            messages = tuple(
                PlayedMessage(
                    channels[message.topic],
                    message.stamp_ns,
                    stamp_ns(bag.deserialize(message).header.stamp),
                    bytes(message.data),
                )
                for message in bag.messages([str(topic) for topic in channels])
            )
        return PlayedBag(name, types, messages, truth, path)

    @property
    def frame_count(self) -> int:
        """How many colour images it holds."""
        return sum(message.channel is Channel.COLOR for message in self.messages)

    def sample(self, count: int) -> list[RgbdFrame]:
        """At most ``count`` frames spread over the bag."""
        with BagRecording(self.path) as recording:
            return _sample(recording, count)


@dataclass(frozen=True)
class PlayedRecording(WrappedRecording):
    """Any recording, whose frames are converted to messages while it is played; a ``Played``.

    If only a part is played, it has fewer frames than ``frame_count``.

    Attributes:
        recording: the frames.
        codec: how images are put into messages.
        start_s: skipped at its beginning, seconds.
        duration_s: length of the played part, seconds; None for all the rest.
        later_ns: added to all stamps, nanoseconds.
        lead_ns: time of an IMU's samples before the first frame, nanoseconds.
    """

    codec: ImageCodec
    start_s: float = 0.0
    duration_s: float | None = None
    later_ns: int = 0
    lead_ns: int = _LEAD_NS

    @property
    def types(self) -> Mapping[Stream, str]:
        """Of the messages of each channel, and of the IMU if there is one."""
        types: dict[Stream, str] = {
            Channel.INFO: INFO_TYPE,
            Channel.COLOR: self.codec.type,
            Channel.DEPTH: self.codec.type,
        }
        if self._imu:
            types[Sensor.IMU] = IMU_TYPE
        return types

    @property
    def messages(self) -> Iterator[PlayedMessage]:
        """Camera info, colour and depth of each frame at its stamp, the IMU's samples between.

        Raises:
            InputError: a frame cannot be read, or none is in the part to play.
        """
        is_empty = True
        for messages in mapped_ahead(self._encoded, self._with_imu(self._part())):
            is_empty = False
            yield from messages
        if is_empty:
            after = f" from {self.start_s:g} s on" if self.start_s else ""
            raise InputError(
                self.name, f"has no frames to play{after}", "start earlier, or play for longer"
            )

    def next_round(self, stamps_ns: Sequence[int]) -> PlayedRecording:
        """The recording for the next round, with stamps that continue.

        Args:
            stamps_ns: of the frames of this round.
        """
        first_ns, last_ns = min(stamps_ns), max(stamps_ns)
        gaps = len(stamps_ns) - 1
        period_ns = (last_ns - first_ns) // gaps if last_ns > first_ns else _USUAL_PERIOD_NS
        later_ns = self.later_ns + last_ns - first_ns + period_ns
        return replace(self, later_ns=later_ns, lead_ns=period_ns - 1)

    def sample(self, count: int) -> list[RgbdFrame]:
        """At most ``count`` frames spread over the recording."""
        return _sample(self.recording, count)

    @property
    def _imu(self) -> ImuSamples | None:
        return imu_of(self.recording)

    def _with_imu(self, frames: Iterable[RgbdFrame]) -> Iterator[tuple[ImuSamples, RgbdFrame]]:
        """The frames, each with the samples since the previous one."""
        samples = self._imu or ImuSamples.empty()
        after_ns: int | None = None
        for frame in frames:
            first_ns = frame.stamp_ns - self.lead_ns if after_ns is None else after_ns + 1
            after_ns = frame.stamp_ns
            yield samples.between(first_ns, after_ns), frame

    def _encoded(self, taken: tuple[ImuSamples, RgbdFrame]) -> list[PlayedMessage]:
        samples, frame = taken
        samples = replace(samples, stamps_ns=samples.stamps_ns + self.later_ns)
        stamp = frame.stamp_ns + self.later_ns
        encoded = encode_frame(replace(frame, stamp_ns=stamp), self.codec)
        messages = [
            PlayedMessage(
                Sensor.IMU, int(at), int(at), bytes(encode_imu(samples, i, frame.frame_id))
            )
            for i, at in enumerate(samples.stamps_ns)
        ]
        return [
            *messages,
            PlayedMessage(Channel.INFO, stamp, stamp, bytes(encoded.info)),
            PlayedMessage(Channel.COLOR, stamp, stamp, bytes(encoded.color)),
            PlayedMessage(Channel.DEPTH, stamp, stamp, bytes(encoded.depth)),
        ]

    def _part(self) -> Iterator[RgbdFrame]:
        first_ns: int | None = None
        for frame in self.recording:
            first_ns = frame.stamp_ns if first_ns is None else first_ns
            since_s = (frame.stamp_ns - first_ns) / NANOSECONDS - self.start_s
            if self.duration_s is not None and since_s >= self.duration_s:
                return
            if since_s >= 0:
                yield frame


def _sample(recording: Recording, count: int) -> list[RgbdFrame]:
    rows = np.linspace(0, recording.frame_count - 1, min(count, recording.frame_count))
    return list(recording.select(rows.astype(int).tolist()))
