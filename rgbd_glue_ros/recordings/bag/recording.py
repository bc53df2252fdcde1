"""Sequences in rosbag2 (MCAP, SQLite; compressed or not) and ROS 1 bags."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator
from functools import cache, cached_property, partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry.depth_registration import DepthCamera
from rgbd_glue_ros.messages.fields import DEPTH_UNITS_PER_METRE
from rgbd_glue_ros.messages.frame import FrameTopics, frame_of_match
from rgbd_glue_ros.messages.images import holds_whole_numbers, in_8_bits
from rgbd_glue_ros.messages.making import camera_info, header
from rgbd_glue_ros.messages.poses import pose_from_message
from rgbd_glue_ros.messages.reading import stamp_ns
from rgbd_glue_ros.messages.stamps import explain_miss
from rgbd_glue_ros.messages.synchronizer import Channel, Match, Synchronizer
from rgbd_glue_ros.messages.used_bits import UsedBits
from rgbd_glue_ros.parameters import InputConfig
from rgbd_glue_ros.parameters.inputs import RECEIPT
from rgbd_glue_ros.recordings.bag import realsense
from rgbd_glue_ros.recordings.bag.depth_camera import RecordedDepthCamera
from rgbd_glue_ros.recordings.bag.file import BagFile
from rgbd_glue_ros.recordings.bag.imu import recorded_imu
from rgbd_glue_ros.recordings.bag.matching import Matching
from rgbd_glue_ros.recordings.bag.topics import (
    Topics,
    find_color,
    find_depth,
    find_depth_info,
    find_ground_truth,
    find_imu,
    find_info,
)
from rgbd_glue_ros.recordings.faults import Faults
from rgbd_glue_ros.recordings.left_out import (
    COLOR,
    DEPTH,
    FrameGaps,
    LeftOut,
    warn_of_left_out,
)
from rgbd_glue_ros.recordings.prefetch import mapped_ahead
from rgbd_glue_ros.recordings.recording import selected
from rgbd_glue_ros.types import NANOSECONDS, CameraIntrinsics, ImuSamples, RgbdFrame, Trajectory

__all__ = ["BagRecording", "Topics"]

logger = logging.getLogger(__name__)

_BY_RECORDING = "if these are different images, give --set stamps=receipt, their time of recording"


class BagRecording(Closing):
    """The frames of a bag, paired and decoded as in the node.

    Unusable messages are skipped, counted and logged once per cause.
    """

    def __init__(
        self,
        path: Path,
        topics: Topics | None = None,
        calibration: CameraIntrinsics | None = None,
        inputs: InputConfig | None = None,
        depth_calibration: CameraIntrinsics | None = None,
        calibration_depth_scale: float | None = None,
    ) -> None:
        """Opens the bag and finds its topics.

        Args:
            path: a rosbag2 folder or storage file, or a ROS 1 bag.
            topics: the topics to use; None, and any that is None, is found by type and name.
            calibration: of the colour camera; None uses the bag's camera info.
            inputs: how images are interpreted and paired; None for the defaults.
            depth_calibration: of the depth camera, if depth is not registered; None uses the bag's.
            calibration_depth_scale: metres per unit of depth according to the file of
                ``calibration``. Images of a bag have the units of REP-118 regardless; a difference
                is logged.

        Raises:
            InputError: the path is not a bag, the bag is empty, or topics are missing or ambiguous.
        """
        self._bag = BagFile(path)
        self._inputs = inputs or InputConfig()
        self._calibration = calibration
        self._calibration_depth_scale = calibration_depth_scale
        self._faults = Faults()
        self._matching: Matching | None = None
        try:
            self._find_topics(topics or Topics(), depth_calibration)
        except BaseException:
            self.close()
            raise

    def _find_topics(self, wanted: Topics, depth_calibration: CameraIntrinsics | None) -> None:
        bag, have, path = self._bag, self._bag.topics, self._bag.path
        encoding = cache(bag.encoding)
        color = find_color(have, wanted.color, path, encoding, wanted.depth or "")
        depth = find_depth(have, wanted.depth, path, encoding, color)
        if self._calibration is None and wanted.info is None and realsense.is_realsense(color):
            self._calibration = realsense.camera_in_text(bag, color)
        info = (
            find_info(have, wanted.info, color, path)
            if self._calibration is None
            else "the given calibration"
        )
        self._imu = find_imu(have, wanted.imu, color, path)
        self._ground_truth = find_ground_truth(have, wanted.ground_truth, path)
        self._depth_camera = RecordedDepthCamera(
            bag,
            FrameTopics(color, depth, info),
            self._inputs,
            depth_calibration,
            find_depth_info(have, wanted.depth_info, path),
        )
        self._topics = self._depth_camera.topics

    @property
    def name(self) -> str:
        """The bag's name."""
        path = self._bag.path.resolve()
        return path.name if path.is_dir() else path.stem

    @property
    def topics(self) -> Topics:
        """The topics of images, camera info and ground truth in use."""
        info = None if self._calibration else self._topics.info
        return Topics(self._topics.color, self._topics.depth, info, self._ground_truth)

    @property
    def frame_count(self) -> int:
        """The maximum number of frames."""
        topics = self._bag.topics
        images = self._topics.color, self._topics.depth
        return min(topics[name].message_count for name in images)

    @cached_property
    def ground_truth(self) -> Trajectory | None:
        """Poses as recorded, without invalid ones; None if the bag has no such topic."""
        if self._ground_truth is None:
            return None
        faults = Faults()
        faults.are_skipped()
        stamps, poses = [], []
        for message in self._bag.messages([self._ground_truth]):
            try:
                fields = self._bag.deserialize(message)
                pose = pose_from_message(fields, message.topic)
            except InputError as error:
                faults.add(error)
                continue
            stamps.append(stamp_ns(fields.header.stamp))
            poses.append(pose)
        if not poses:
            return None
        return Trajectory(np.array(stamps, np.int64), np.array(poses))

    @cached_property
    def imu(self) -> ImuSamples | None:
        """The samples of its IMU; None if it has none or its orientation is not known."""
        if self._imu is None:
            return None
        return recorded_imu(
            *(self._bag, self._imu, self._topics.color, self._inputs),
            by_receipt=self._stamp_source == RECEIPT,
        )

    def __iter__(self) -> Iterator[RgbdFrame]:
        """The frames in order of time; a stamp goes back only if the bag's do.

        Raises:
            InputError: at the end, if the bag is damaged there or gave no frame at all.
        """
        faults, gaps = Faults(), FrameGaps()
        matching = self._matching = self._new_matching(faults)
        self._faults = faults
        yield from faults.without(mapped_ahead(self._frame, self._watched(matching)), gaps)
        if self._bag.damage is not None:
            faults.are_skipped()
            raise InputError(
                self._bag.path,
                f"{self._bag.damage}; what could be read before that was used",
                "copy or record it again",
            )
        if gaps.is_empty:
            raise faults.first or _nothing_paired(self._bag.path, self._topics, matching.sync)
        if faults.count:
            logger.warning("%s: %d messages or frames skipped", self._bag.path, faults.count)
        by_recording = "" if self._stamp_source == RECEIPT else _BY_RECORDING
        warn_of_left_out(self._bag.path, self.left_out, gaps, by_recording)

    @property
    def skipped(self) -> int:
        """Number of messages and frames that the last iteration could not use, so far."""
        return self._faults.count

    @property
    def left_out(self) -> LeftOut:
        """What the last iteration left out, so far."""
        if self._matching is None:
            return LeftOut({COLOR: 0, DEPTH: 0}, {COLOR: 0, DEPTH: 0})
        counts = {
            kind: self._matching.sync.counts[channel]
            for kind, channel in ((COLOR, Channel.COLOR), (DEPTH, Channel.DEPTH))
        }
        return LeftOut(
            images={kind: c.received - c.duplicates for kind, c in counts.items()},
            unpaired={kind: c.left_out for kind, c in counts.items()},
            duplicates=max(c.duplicates for c in counts.values()),
        )

    def _new_matching(self, faults: Faults) -> Matching:
        channels = {self._topics.color: Channel.COLOR, self._topics.depth: Channel.DEPTH}
        given = self._calibration
        if given is None:
            channels[self._topics.info] = Channel.INFO
        return Matching(
            self._bag,
            channels,
            round(self._inputs.max_interval_s * NANOSECONDS),
            self._stamp_source,
            faults,
            None if given is None else camera_info(given, header(0, "")),
        )

    def select(self, indices: Iterable[int]) -> Iterator[RgbdFrame]:
        """The frames with these increasing numbers; all before the last of them are read too."""
        return selected(self, indices)

    def close(self) -> None:
        """Releases the files."""
        self._bag.close()

    @cached_property
    def _stamp_source(self) -> str:
        """The requested source; if the first images have no stamp, their time of recording."""
        first = islice(self._bag.messages([self._topics.color]), 2)
        try:
            stamps = [stamp_ns(self._bag.deserialize(m).header.stamp) for m in first]
        except InputError:
            return self._inputs.stamps
        if any(stamps) or self._inputs.stamps == RECEIPT:
            return self._inputs.stamps
        logger.warning(
            "%s: images have no stamp; their time of recording is used", self._topics.color
        )
        return RECEIPT

    def _watched(
        self, matches: Iterable[Match[Any]]
    ) -> Iterator[tuple[Match[Any], DepthCamera | None, int]]:
        """The matches with what decodes them; anomalies are logged.

        Yields:
            A match, the camera that took its depth, and the bits that colour uses.
        """
        bits = UsedBits()
        taken_by: DepthCamera | None = None
        last_ns: int | None = None
        for match in matches:
            if last_ns is None:
                taken_by = self._depth_camera.of(match)
                self._say_of_unit(match)
            elif match.stamp_ns < last_ns:
                logger.warning("%s: time goes backward to %d ns", self._bag.path, match.stamp_ns)
            last_ns = match.stamp_ns
            yield match, taken_by, bits.of(match.color, self._topics.color)

    def _say_of_unit(self, match: Match[Any]) -> None:
        """Warns if the calibration file gives other units than the bag's images have."""
        unit = self._depth_camera.metres_per_unit
        is_other = self._calibration_depth_scale not in {None, 1 / DEPTH_UNITS_PER_METRE, 1}
        if unit is None and is_other and holds_whole_numbers(match.depth):
            logger.warning(
                "%s: whole numbers are read as millimetres, as in bags (REP-118), though the "
                "calibration gives a unit of %g m; if that is right, give --depth-scale %g",
                self._topics.depth,
                self._calibration_depth_scale,
                self._calibration_depth_scale,
            )

    def _frame(self, paired: tuple[Match[Any], DepthCamera | None, int]) -> RgbdFrame | InputError:
        match, taken_by, bits = paired
        unit = self._depth_camera.metres_per_unit
        to_8_bits = partial(in_8_bits, bits=bits)
        try:
            return frame_of_match(match, self._topics, taken_by, unit, to_8_bits=to_8_bits)
        except InputError as error:
            return error


def _nothing_paired(path: Path, topics: FrameTopics, sync: Synchronizer[Any]) -> InputError:
    if sync.closest_miss_ns is None:
        received = {c.value: counts.received for c, counts in sync.counts.items()}
        return InputError(path, f"no frame is complete (messages: {received})", "record all topics")
    return InputError(
        path,
        f"no image of {topics.color} has one of {topics.depth} close to its stamp",
        explain_miss(sync.closest_miss_ns, sync.max_interval_ns),
    )
