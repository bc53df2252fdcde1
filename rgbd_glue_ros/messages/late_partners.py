"""Images whose partner of the same time came, waited and gave way before they came themselves."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable

# Stamps of a stream that are remembered: half a minute of a usual camera.
_REMEMBERED = 1000
# More than what is late now, as delays vary.
_MARGIN = 5


class LatePartners:
    """Learns how long the queues of two streams would have to be.

    Attributes:
        queue_needed: messages that would have to wait for none to be late; 0 while as many as there
            are do.
    """

    def __init__(self, max_interval_ns: int, queue_size: int, backward_jump_ns: int) -> None:
        """Has seen nothing yet.

        Args:
            max_interval_ns: distance up to which stamps pair, nanoseconds.
            queue_size: messages of a stream that wait.
            backward_jump_ns: stamps that go back by more are of another time, as of a bag that
                begins anew, nanoseconds.
        """
        self.queue_needed = 0
        self._backward_jump_ns = backward_jump_ns
        self._max_interval_ns = max_interval_ns
        self._queue_size = queue_size
        self._stamps_ns: dict[Hashable, deque[int]] = {}

    def came(self, stream: Hashable, partner: Hashable, stamp_ns: int) -> None:
        """Takes in the stamp of a message.

        Args:
            stream: that it is of.
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
                return  # the partner is yet to come, or never will
            behind += 1
        else:
            return
        if behind >= self._queue_size:
            self.queue_needed = max(self.queue_needed, behind + 1 + _MARGIN)
