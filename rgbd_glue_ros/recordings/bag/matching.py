"""The messages of a bag -> matches, however far apart those of one time were recorded."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from itertools import islice
from typing import Any

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.fields import CameraInfo
from rgbd_glue_ros.messages.reading import stamp_ns
from rgbd_glue_ros.messages.stamps import StampSource
from rgbd_glue_ros.messages.synchronizer import Channel, Match, Synchronizer
from rgbd_glue_ros.recordings.bag.file import BagFile
from rgbd_glue_ros.recordings.bag.message import RecordedMessage
from rgbd_glue_ros.recordings.faults import Faults

logger = logging.getLogger(__name__)

# Messages of one time that are further apart than these are read topic by topic.
QUEUE_SIZE = 30

# Later than any image: a camera info that no image has to wait for.
_FOREVER_NS = 2**63


class Matching:
    """One pass through a bag.

    Messages are read in the order of recording, as they would arrive over a network. Where those of
    one time are so far apart that a queue is full, as in a bag whose topics were written one after
    the other, the topics are read beside each other from the beginning, each as far as the others
    have come. What the queues hold is bounded either way, and matches do not depend on the order.

    Attributes:
        sync: pairs the messages, and counts them.
    """

    def __init__(
        self,
        bag: BagFile,
        channels: Mapping[str, Channel],
        max_interval_ns: int,
        stamps: str,
        faults: Faults,
        calibration: CameraInfo | None = None,
    ) -> None:
        """Prepares the pass.

        Args:
            bag: the bag.
            channels: what its topics carry.
            max_interval_ns: interval up to which colour and depth pair, nanoseconds.
            stamps: one of ``InputConfig.stamps``.
            faults: takes messages that cannot be read.
            calibration: an info for all images; None if a topic has them.
        """
        self._bag = bag
        self._channels = channels
        self._max_interval_ns = max_interval_ns
        self._source = stamps
        self._faults = faults
        self._calibration = calibration
        # of each topic; when messages are read a second time, so are these
        self._known_unreadable: Counter[str] = Counter()
        self._is_unstamped_said = False
        self.sync = self._new_synchronizer()

    def __iter__(self) -> Iterator[Match[Any]]:
        """The matches, in order of time as from ``Synchronizer``."""
        given = 0
        unreadable: Counter[str] = Counter()
        stamps = StampSource[Any](self._source)
        self._add_calibration()
        for recorded in self._bag.messages(self._channels):
            for match in self._matches(stamps, recorded, unreadable):
                given += 1
                yield match
            if self.sync.is_full or (self.sync.lacks_infos and self._has_many_infos):
                break
        else:
            yield from self._rest(stamps)
            return
        logger.debug("%s: its topics are read beside each other", self._bag.path)
        self.sync = self._new_synchronizer()
        yield from islice(self._beside(), given, None)

    def _beside(self) -> Iterator[Match[Any]]:
        """All matches, from topics that are read beside each other."""
        unreadable: Counter[str] = Counter()
        stamps = StampSource[Any](self._source)
        self._add_calibration()
        with ExitStack() as opened:
            streams = {}
            for topic, channel in self._channels.items():
                bag = opened.enter_context(self._bag.reopened())
                streams[channel] = bag, bag.messages([topic])
            while streams:
                channel = min(streams, key=self.sync.reached)
                bag, messages = streams[channel]
                recorded = next(messages, None)
                if recorded is None:
                    self._bag.damage = self._bag.damage or bag.damage
                    del streams[channel]
                else:
                    yield from self._matches(stamps, recorded, unreadable)
        yield from self._rest(stamps)

    def _matches(
        self, stamps: StampSource[Any], recorded: RecordedMessage, unreadable: Counter[str]
    ) -> Iterator[Match[Any]]:
        """The matches that a message completes; one that cannot be read is a fault, but once.

        Args:
            stamps: of this reading of the bag.
            recorded: its next message.
            unreadable: how many messages of each topic it could not read; this one is added.
        """
        try:
            message = self._bag.deserialize(recorded)
        except InputError as error:
            topic = recorded.topic
            unreadable[topic] += 1
            if unreadable[topic] > self._known_unreadable[topic]:
                self._known_unreadable[topic] = unreadable[topic]
                self._faults.add(error)
            return
        channel = self._channels[recorded.topic]
        in_header_ns = stamp_ns(message.header.stamp)
        for stamp, item in stamps.accept(channel, in_header_ns, recorded.stamp_ns, message):
            yield from self.sync.add(channel, stamp, item)
        if Channel.INFO in stamps.unstamped and not self._is_unstamped_said:
            self._is_unstamped_said = True
            logger.warning(
                "%s: camera infos have no stamp, though images do; their time of recording is used",
                recorded.topic,
            )

    @property
    def _has_many_infos(self) -> bool:
        """Whether there are infos for all times; a few may be as late as they were recorded."""
        infos = [topic for topic, c in self._channels.items() if c is Channel.INFO]
        return any(self._bag.topics[topic].message_count > QUEUE_SIZE for topic in infos)

    def _rest(self, stamps: StampSource[Any]) -> Iterator[Match[Any]]:
        for channel, stamp, item in stamps.flush():
            yield from self.sync.add(channel, stamp, item)
        yield from self.sync.flush()

    def _add_calibration(self) -> None:
        if self._calibration is not None:
            self.sync.add(Channel.INFO, _FOREVER_NS, self._calibration)

    def _new_synchronizer(self) -> Synchronizer[Any]:
        return Synchronizer(self._max_interval_ns, QUEUE_SIZE)
