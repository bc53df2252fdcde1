"""Matches colour images, depth images and camera infos by their stamps; does not depend on ROS.

The node and the replay of bags use the same class, so that both see the same frames.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import Enum
from statistics import median
from typing import Generic, TypeVar

from rgbd_glue_ros.messages.channel_queue import (
    BACKWARD_JUMP_NS,
    ChannelCounts,
    ChannelQueue,
    Stamped,
)
from rgbd_glue_ros.messages.late_partners import LatePartners

Item = TypeVar("Item")

# Number of pairs that the usual interval is computed from.
INTERVAL_WINDOW = 31

# A partner is clearly nearer if it is nearer by the maximum interval divided by this. Otherwise, in
# streams half a period apart, jitter would keep dropping images or delaying them until the next
# one. The odometry knows by how many milliseconds depth is late anyway.
NEARER_FRACTION = 2


class Channel(Enum):
    """One of the three streams."""

    COLOR = "color"
    DEPTH = "depth"
    INFO = "camera_info"


_PARTNERS = {Channel.COLOR: Channel.DEPTH, Channel.DEPTH: Channel.COLOR}

PAIRED = tuple(_PARTNERS)
"""The channels of images."""


@dataclass(frozen=True)
class Match(Generic[Item]):
    """A colour image with its depth image and camera info.

    Attributes:
        stamp_ns: stamp of the colour image, nanoseconds.
        interval_ns: stamp of the depth image minus that of the colour image, nanoseconds.
        color: colour image, as passed to ``add``.
        depth: depth image, as passed to ``add``.
        info: camera info, as passed to ``add``; the one with the stamp of ``color``, otherwise the
            nearest.
    """

    stamp_ns: int
    interval_ns: int
    color: Item
    depth: Item
    info: Item


class Synchronizer(Generic[Item]):
    """Pairs colour with depth one to one, and adds the camera info.

    A colour and a depth image are paired if their stamps are at most ``max_interval_ns`` apart and
    neither has a clearly nearer partner. Equal stamps pair immediately. Unequal stamps do so too if
    they are the rule, and the next image cannot be clearly nearer, given the channel's period.
    Otherwise they wait for the next image.

    The camera info is the one with the colour image's stamp, otherwise the nearest. A pair waits
    for it as long as newer infos may arrive. When ``queue_size`` pairs have waited in vain, infos
    are assumed to be sent once or rarely, and pairs no longer wait for them.

    If no queue overflows and no stamp goes backward, the matches do not depend on the order in
    which messages of different channels arrive. A message whose stamp is over half a second before
    the newest one of its channel, or over half a second and four periods after it, is held until
    the next message of its channel. If that has a similar stamp, the camera has paused or time has
    jumped, and pairing continues with the new time, after a jump backward with an empty channel.
    Otherwise the stamp was wrong, and the held message is dropped. A camera info, which may be the
    only one, is held until colour images have arrived at its time. Matches are in order of time,
    except that after a jump backward they start again with the new time. Not thread-safe.

    Attributes:
        max_interval_ns: maximum interval of a pair, nanoseconds.
        matches: number of matches so far.
        closest_miss_ns: smallest interval between images that were too far apart to pair, since
            the beginning or ``forget_misses``, nanoseconds; None if there was none.
    """

    def __init__(self, max_interval_ns: int, queue_size: int) -> None:
        self.max_interval_ns = max_interval_ns
        self._queue_size = queue_size
        self._queues = {c: ChannelQueue[Item](queue_size) for c in Channel}
        self._pairs: deque[tuple[Stamped[Item], Stamped[Item]]] = deque()
        self._infos_are_rare = False
        self._last_interval_ns = 0
        self._intervals_ns: deque[int] = deque(maxlen=INTERVAL_WINDOW)
        self.matches = 0
        self.closest_miss_ns: int | None = None
        self._late = LatePartners(max_interval_ns, queue_size, BACKWARD_JUMP_NS)

    @property
    def queue_needed(self) -> int:
        """The queue size with which no image would have been too late; 0 if this one is enough.

        Counted since the beginning, or since ``forget_misses``.
        """
        return self._late.queue_needed

    @property
    def is_full(self) -> bool:
        """Whether a channel of images has as many waiting as its queue holds."""
        return any(len(self._queues[c].waiting) >= self._queue_size for c in PAIRED)

    @property
    def lacks_infos(self) -> bool:
        """Whether as many pairs as a queue holds wait for the first camera info."""
        return len(self._pairs) >= self._queue_size and not self._queues[Channel.INFO].waiting

    def reached(self, channel: Channel) -> tuple[int, int]:
        """How far a channel has come, to compare with others: jumps backward, and newest stamp."""
        queue = self._queues[channel]
        newest_ns = -1 if queue.newest_ns is None else queue.newest_ns
        return queue.counts.backward_jumps, newest_ns

    @property
    def counts(self) -> dict[Channel, ChannelCounts]:
        """Counts of the messages of each channel; the objects keep counting."""
        return {channel: queue.counts for channel, queue in self._queues.items()}

    @property
    def interval_ns(self) -> int:
        """Median interval of recent pairs, nanoseconds; 0 before the first pair."""
        return int(median(self._intervals_ns)) if self._intervals_ns else 0

    @property
    def periods_ns(self) -> dict[Channel, int]:
        """Recent time between the stamps of each channel, nanoseconds; 0 before there are two."""
        return {channel: queue.period_ns for channel, queue in self._queues.items()}

    @property
    def period_ns(self) -> int:
        """Recent time between the stamps of colour images, nanoseconds; 0 before there are two."""
        return self._queues[Channel.COLOR].period_ns

    def add(self, channel: Channel, stamp_ns: int, item: Item) -> list[Match[Item]]:
        """Adds a message; returns the matches that it completes, in order of time."""
        self._queues[channel].add(stamp_ns, item)
        # an info that is sent once has no successor to show that time has jumped
        self._queues[Channel.INFO].confirm_held(self._queues[Channel.COLOR].newest_ns)
        if channel in _PARTNERS:
            self._late.came(channel, _PARTNERS[channel], stamp_ns)
        self._pair(is_last=False)
        return self._complete(is_last=False)

    def forget_misses(self) -> None:
        """Forgets misses so far: once images pair again, they do not explain a later silence."""
        self.closest_miss_ns = None
        self._late.forget()

    def flush(self) -> list[Match[Item]]:
        """Returns the matches that were waiting; to be called when no more messages will come."""
        for queue in self._queues.values():
            queue.flush()
        self._pair(is_last=True)
        matches = self._complete(is_last=True)
        for channel in _PARTNERS:
            queue = self._queues[channel]
            # single images, or pairs without a camera info
            queue.counts.unfinished += len(queue.waiting) + len(self._pairs)
            queue.waiting.clear()
        self._pairs.clear()
        return matches

    def _pair(self, *, is_last: bool) -> None:
        """Moves colour and depth images that belong together from their queues to the pairs.

        Only the oldest images of both queues are compared, and a decision waits for all messages
        that could change it, so the result does not depend on the order of arrival.
        """
        colors, depths = self._queues[Channel.COLOR], self._queues[Channel.DEPTH]
        while colors.waiting and depths.waiting:
            color, depth = colors.waiting[0], depths.waiting[0]
            interval = abs(color.stamp_ns - depth.stamp_ns)
            earlier, later_queue = (
                (colors, depths) if color.stamp_ns < depth.stamp_ns else (depths, colors)
            )
            first, *rest = earlier.waiting
            later = later_queue.waiting[0]
            if interval > self.max_interval_ns:
                if not is_last and self._may_be_of_another_time(earlier, later_queue):
                    return
                self.closest_miss_ns = min(interval, self.closest_miss_ns or interval)
                earlier.counts.unmatched += 1
                earlier.take()
                continue
            if interval > 0 and not self._is_usual(interval, first.period_ns):
                if not rest and not is_last:
                    return
                if rest and abs(rest[0].stamp_ns - later.stamp_ns) < self._displacing(interval):
                    earlier.counts.unmatched += 1
                    earlier.take()
                    continue
            self._pairs.append((colors.take(), depths.take()))
            self._last_interval_ns = interval
            self._intervals_ns.append(interval)

    def _displacing(self, interval: int) -> int:
        """The interval below which the next image takes the partner of one ``interval`` away."""
        return interval - self.max_interval_ns // NEARER_FRACTION

    @staticmethod
    def _may_be_of_another_time(earlier: ChannelQueue[Item], later: ChannelQueue[Item]) -> bool:
        """Whether it is too early to say which of two images far apart has no partner.

        If time has jumped, one channel shows it before the other; the next message of either
        channel decides.
        """
        distance = later.waiting[0].stamp_ns - earlier.waiting[0].stamp_ns
        if distance <= BACKWARD_JUMP_NS or len(later.waiting) > 1:
            return False
        followers = earlier.waiting[1:]
        return not any(
            s.stamp_ns >= later.waiting[0].stamp_ns - BACKWARD_JUMP_NS for s in followers
        )

    def _is_usual(self, interval: int, period_ns: int | None) -> bool:
        """Whether images this far apart may be paired without waiting for the next one.

        If stamps were equal so far, unequal ones mean that a partner is missing.
        """
        # the next image comes at least one period after the first
        is_near = period_ns is not None and period_ns - interval >= self._displacing(interval)
        return is_near and self._last_interval_ns > 0

    def _complete(self, *, is_last: bool) -> list[Match[Item]]:
        """Completes pairs with their camera info, if it is already certain which one that is."""
        infos = self._queues[Channel.INFO].waiting
        matches = []
        while self._pairs:
            color, depth = self._pairs[0]
            is_overdue = len(self._pairs) > self._queue_size
            # a single info from before a time jump does not mean that this image's will not come
            is_settled = bool(infos) and (
                0 <= infos[-1].stamp_ns - color.stamp_ns <= BACKWARD_JUMP_NS
                or (len(infos) > 1 and infos[-1].stamp_ns >= color.stamp_ns)
            )
            if infos and (is_settled or self._infos_are_rare or is_overdue or is_last):
                self._infos_are_rare |= is_overdue and not is_settled
                matches.append(self._match(color, depth))
            elif is_overdue:
                for channel in (Channel.COLOR, Channel.DEPTH):
                    self._queues[channel].counts.overflowed += 1
            else:
                break
            self._pairs.popleft()
        return matches

    def _match(self, color: Stamped[Item], depth: Stamped[Item]) -> Match[Item]:
        infos = self._queues[Channel.INFO]
        # drop infos older than the last one up to this image: no later image can use them
        while len(infos.waiting) > 1 and infos.waiting[1].stamp_ns <= color.stamp_ns:
            infos.take()
        info = min(infos.waiting[:2], key=lambda s: abs(s.stamp_ns - color.stamp_ns))
        self.matches += 1
        return Match(
            stamp_ns=color.stamp_ns,
            interval_ns=depth.stamp_ns - color.stamp_ns,
            color=color.item,
            depth=depth.item,
            info=info.item,
        )
