"""A node's RGB-D camera input: subscriptions, complete frames and diagnosis."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.geometry.reduction import reduced
from rgbd_glue_ros.live import topics
from rgbd_glue_ros.messages.frame import FrameTopics, frame_of_match
from rgbd_glue_ros.messages.reading import stamp_ns
from rgbd_glue_ros.messages.stamps import PAIR_BY_RECEIPT, StampSource
from rgbd_glue_ros.messages.synchronizer import Channel, Match, Synchronizer
from rgbd_glue_ros.messages.used_bits import UsedBits
from rgbd_glue_ros.node.base_node import BaseNode
from rgbd_glue_ros.node.depth_camera import DepthCameraInput
from rgbd_glue_ros.node.input_watch import InputWatch
from rgbd_glue_ros.node.inputs import NodeInput, node_inputs
from rgbd_glue_ros.node.tf import Transforms
from rgbd_glue_ros.parameters import NodeConfig
from rgbd_glue_ros.types import NANOSECONDS, RgbdFrame

ReceiveMatch = Callable[[Match[Any], int], None]
"""Takes matching messages, and when the last one arrived, by the monotonic clock, nanoseconds."""


class RgbdInput(Closing):
    """Subscribes to colour, depth and camera info, and converts them to frames.

    Attributes:
        synchronizer: matches messages by stamp, and counts them.
        watch: diagnoses missing input.
    """

    def __init__(
        self,
        node: BaseNode,
        config: NodeConfig,
        transforms: Transforms | None,
        receive: ReceiveMatch,
        learned: Sequence[str] = (),
        with_two_clocks: str = PAIR_BY_RECEIPT,
    ) -> None:
        """Prepares the input; ``subscribe`` subscribes to the images.

        Args:
            node: subscribes, and provides the log.
            config: how to read images; the parameters used here are fixed while a node runs.
            transforms: where to look up the depth camera's pose; None without TF.
            receive: called from the executor's thread with matching messages.
            learned: parameters that select a learned feature, which may be why frames are slow.
            with_two_clocks: what to do if colour and depth use different clocks.

        Raises:
            InputError: ``depth_camera_pose`` cannot be read.
        """
        self._node = node
        self._config = config
        self._receive_match = receive
        self._stamps = StampSource[Any](config.stamps)
        self.synchronizer: Synchronizer[Any] = Synchronizer(
            round(config.max_interval_s * NANOSECONDS), config.sync_queue_size
        )
        self._used_bits = UsedBits()
        self._depth_camera = DepthCameraInput(node, config, transforms)
        # raw depth is converted sooner than handed to another thread
        self._background = (
            None
            if config.depth_transport == topics.RAW
            else ThreadPoolExecutor(1, thread_name_prefix="depth")
        )
        self._inputs: tuple[NodeInput, ...] = ()
        self.watch = InputWatch(
            node, self.synchronizer, node.monitor, self._stamps, learned, with_two_clocks
        )

    def subscribe(self) -> None:
        """Subscribes to the images, and starts to check what arrives."""
        self._inputs = node_inputs(self._node, self._config, self._receive)
        self.watch.start(self._inputs)

    @property
    def topics(self) -> tuple[str, ...]:
        """Full names of the subscribed topics: colour, depth, info; none before ``subscribe``."""
        return tuple(i.topic for i in self._inputs)

    @property
    def depth_topic(self) -> str:
        """Full name of the topic of depth; only after ``subscribe``."""
        return next(i.topic for i in self._inputs if i.channel is Channel.DEPTH)

    @property
    def has_received(self) -> bool:
        """Whether any image or camera info has arrived."""
        counts = self.synchronizer.counts
        return any(counts[channel].received for channel in Channel)

    @property
    def depth_info_topic(self) -> str:
        """Full name of the topic of the depth camera's info, which need not be published."""
        return self._depth_camera.topic

    @property
    def is_by_receipt(self) -> bool:
        """Whether frames are stamped with the time at which their colour image was received."""
        return self._stamps.is_by_receipt(Channel.COLOR)

    def _receive(self, channel: Channel, message: Any) -> None:
        arrived_ns = time.monotonic_ns()
        receipt_ns = self._node.get_clock().now().nanoseconds
        taken = self._stamps.accept(channel, stamp_ns(message.header.stamp), receipt_ns, message)
        if channel in self._stamps.unstamped:
            topic = next(i.topic for i in self._inputs if i.channel is channel)
            self._node.warn_once(topic, "has no stamp; the time of receipt is used")
        for stamp, item in taken:
            for match in self.synchronizer.add(channel, stamp, item):
                self._receive_match(match, arrived_ns)

    def frame(self, match: Match[Any]) -> RgbdFrame:
        """Converts matching messages to a frame, at most ``max_width`` pixels wide.

        Waits for TF and for the first info of a depth camera, so it must not be called from the
        executor's thread.

        Raises:
            InputError: a message cannot be used, or the depth camera's pose is unknown.
        """
        color, depth, info = self.topics
        names = FrameTopics(color, depth, info, self._depth_camera.topic)
        taken_by = self._depth_camera.of(match, names)
        unit = self._config.metres_per_unit
        to_8_bits = self._used_bits.scaled
        frame = frame_of_match(match, names, taken_by, unit, self._background, to_8_bits)
        frame = reduced(frame, self._config.max_width)
        self._node.monitor.width = frame.intrinsics.width
        return frame

    def close(self) -> None:
        """Ends the thread that decodes depth; ``frame`` must not be called after this."""
        if self._background is not None:
            self._background.shutdown()
