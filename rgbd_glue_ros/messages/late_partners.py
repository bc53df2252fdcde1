"""Detects images that arrive after their partner has already been dropped from a full queue."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable

# Remembered stamps of a stream: half a minute at 30 Hz.
_REMEMBERED = 1000
# Added to the queue size that is needed now, since delays vary.
_MARGIN = 5


class LatePartners:
    """Determines how long the queues of two streams would have to be.

    Attributes:
        queue_needed: the queue size with which no image would have been late since the beginning,
            or since ``forget``; 0 if the present one is enough.
    """

    def __init__(self, max_interval_ns: int, queue_size: int, backward_jump_ns: int) -> None:
        """Starts without stamps.

        Args:
            max_interval_ns: interval up to which stamps pair, nanoseconds.
            queue_size: present queue size of a stream.
            backward_jump_ns: a larger step backward, nanoseconds, means that time has restarted,
                as in a looping bag.
        """
        self.queue_needed = 0
        self._backward_jump_ns = backward_jump_ns
        self._max_interval_ns = max_interval_ns
        self._queue_size = queue_size
        self._stamps_ns: dict[Hashable, deque[int]] = {}

    def came(self, stream: Hashable, partner: Hashable, stamp_ns: int) -> None:
        """Records the stamp of a message.

        Args:
            stream: the stream of the message.
            partner: the stream that it is paired with.
            stamp_ns: its stamp, nanoseconds.
        """
        own = self._stamps_ns.get(stream)
        if own and stamp_ns < own[-1] - self._backward_jump_ns:
            self._stamps_ns.clear()
        self._stamps_ns.setdefault(stream, deque(maxlen=_REMEMBERED)).append(stamp_ns)
        behind = 0
        for other_ns in reversed(self._stamps_ns.get(partner, ())):
            if abs(other_ns - stamp_ns) <= self._max_interval_ns:
                break
            if other_ns < stamp_ns:
                return  # the partner has not arrived yet, or never will
            behind += 1
        else:
            return
        if behind >= self._queue_size:
            self.queue_needed = max(self.queue_needed, behind + 1 + _MARGIN)

    def forget(self) -> None:
        """Forgets what was needed so far, as after a hiccup."""
        self.queue_needed = 0
