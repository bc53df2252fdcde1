"""The messages of one channel that wait for their partners, sorted by stamp."""

from __future__ import annotations

from bisect import insort
from collections import deque
from dataclasses import dataclass, field
from statistics import median
from typing import Generic, TypeVar

from rgbd_glue_ros.types import NANOSECONDS

Item = TypeVar("Item")

# Reordering in a network is shorter than this, the jump of a looping bag longer. A stamp that is
# ahead by less does not look like such a jump once right ones follow it.
BACKWARD_JUMP_NS = NANOSECONDS // 2
# After more periods than this nothing was lost: the camera has paused, or a stamp is wrong.
_PAUSE_PERIODS = 4
# While the period is unknown: a tracked camera does not pause this long between two images.
FORWARD_JUMP_NS = 10 * NANOSECONDS

# Number of gaps between stamps that a channel's period is computed from: enough to bridge lost
# messages, few enough to forget a burst soon.
PERIOD_WINDOW = 8

# A longer gap between stamps is a pause of the camera, not a loss of messages.
LONGEST_LOSS_NS = NANOSECONDS


@dataclass
class ChannelCounts:
    """Counts of the messages of one channel.

    Attributes:
        received: all messages.
        unmatched: dropped because no partner was close enough, or it had a nearer one.
        overflowed: dropped because the queue was full.
        duplicates: dropped because their stamp was seen before.
        late: dropped because a later message had already been used or dropped.
        missing: messages that never arrived, from gaps in the stamps.
        backward_jumps: how often stamps went back by more than ``BACKWARD_JUMP_NS``.
        strays: dropped because their stamp is far from those before and after.
        unfinished: colour and depth images that were still waiting at ``flush``.
    """

    received: int = 0
    unmatched: int = 0
    overflowed: int = 0
    duplicates: int = 0
    late: int = 0
    missing: int = 0
    backward_jumps: int = 0
    strays: int = 0
    unfinished: int = 0

    @property
    def left_out(self) -> int:
        """Messages that are in no match, without duplicates."""
        return self.unmatched + self.overflowed + self.late + self.strays + self.unfinished


@dataclass(frozen=True)
class Stamped(Generic[Item]):
    """A message, its stamp, and the channel's period when it arrived."""

    stamp_ns: int
    # the channel's period when the message arrived; None for its first message
    period_ns: int | None
    item: Item


@dataclass
class ChannelQueue(Generic[Item]):
    """Waiting messages of one channel, sorted by stamp, without duplicates."""

    size: int
    counts: ChannelCounts = field(default_factory=ChannelCounts)
    waiting: list[Stamped[Item]] = field(default_factory=list)
    newest_ns: int | None = None
    passed_ns: int | None = None
    held: tuple[int, Item] | None = None
    gaps_ns: deque[int] = field(default_factory=lambda: deque(maxlen=PERIOD_WINDOW))

    def add(self, stamp_ns: int, item: Item) -> None:
        """Adds a message, unless it is a duplicate, late, or its stamp far from the others.

        A message with such a stamp is held until the next one shows whether time has jumped, or
        the camera has paused, so that a single wrong stamp does no harm. So the first message after
        a pause is late by a period.
        """
        self.counts.received += 1
        held, self.held = self.held, None
        if self._is_of_another_time(stamp_ns):
            if held is None or stamp_ns <= held[0]:
                self.counts.strays += held is not None
                self.held = stamp_ns, item
                return
            self._take_in(*held)
        else:
            self.counts.strays += held is not None
        self._take_in(stamp_ns, item)

    def flush(self) -> None:
        """Adds the held message; to be called when no more messages will come."""
        if self.held is not None:
            self._take_in(*self.held)
            self.held = None

    def confirm_held(self, now_ns: int | None) -> None:
        """Adds the held message if another channel has arrived at its time.

        Args:
            now_ns: newest stamp of the other channel, nanoseconds; None before its first.
        """
        if self.held is None or self.newest_ns is None or now_ns is None:
            return
        stamp_ns, item = self.held
        # after a pause it may have been sent well before the first image; an image from well before
        # it confirms nothing
        is_ahead = stamp_ns > self.newest_ns
        apart_ns = now_ns - stamp_ns if is_ahead else stamp_ns - now_ns
        if -BACKWARD_JUMP_NS <= apart_ns <= FORWARD_JUMP_NS:
            self._take_in(stamp_ns, item)
            self.held = None

    def _is_of_another_time(self, stamp_ns: int) -> bool:
        if self.newest_ns is None:
            return False
        return not -BACKWARD_JUMP_NS <= stamp_ns - self.newest_ns <= self._longest_step_ns

    @property
    def _longest_step_ns(self) -> int:
        """How far a stamp may be ahead of the newest one without a pause, nanoseconds."""
        if len(self.gaps_ns) < PERIOD_WINDOW:
            return FORWARD_JUMP_NS
        return max(BACKWARD_JUMP_NS, _PAUSE_PERIODS * self.period_ns)

    def _take_in(self, stamp_ns: int, item: Item) -> None:
        if self.newest_ns is not None and stamp_ns < self.newest_ns - BACKWARD_JUMP_NS:
            self.counts.backward_jumps += 1
            self.counts.unmatched += len(self.waiting)
            self.waiting.clear()
            self.gaps_ns.clear()
            self.newest_ns = self.passed_ns = None
        known = [stamped.stamp_ns for stamped in self.waiting]
        if stamp_ns == self.passed_ns or stamp_ns in known:
            self.counts.duplicates += 1
            return
        if self.passed_ns is not None and stamp_ns < self.passed_ns:
            self.counts.late += 1
            self._is_not_missing()
            return
        if self.newest_ns is not None and stamp_ns > self.newest_ns:
            self.counts.missing += self._left_out(stamp_ns - self.newest_ns)
            self.gaps_ns.append(stamp_ns - self.newest_ns)
        else:
            self._is_not_missing()
        self.newest_ns = stamp_ns if self.newest_ns is None else max(stamp_ns, self.newest_ns)
        period_ns = min(self.gaps_ns, default=None)
        insort(self.waiting, Stamped(stamp_ns, period_ns, item), key=lambda s: s.stamp_ns)
        if len(self.waiting) > self.size:
            self.counts.overflowed += 1
            self.take()

    def _left_out(self, gap_ns: int) -> int:
        """Number of messages that are missing in a gap between stamps."""
        if len(self.gaps_ns) < PERIOD_WINDOW or gap_ns > LONGEST_LOSS_NS:
            return 0
        return max(round(gap_ns / self.period_ns) - 1, 0)

    def _is_not_missing(self) -> None:
        """Corrects the count of missing messages when one arrives late."""
        self.counts.missing = max(self.counts.missing - 1, 0)

    @property
    def period_ns(self) -> int:
        """Usual time between stamps, nanoseconds; 0 while it is unknown."""
        if not self.gaps_ns:
            return 0
        # median and sum are both off by the jitter of two stamps, but the sum is divided by a count
        usual_ns = median(self.gaps_ns)
        return round(sum(self.gaps_ns) / sum(max(round(g / usual_ns), 1) for g in self.gaps_ns))

    def take(self) -> Stamped[Item]:
        """Removes the oldest message."""
        oldest = self.waiting.pop(0)
        self.passed_ns = oldest.stamp_ns
        return oldest
