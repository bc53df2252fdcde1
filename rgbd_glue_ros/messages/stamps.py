"""The stamp of a message: from its header, or the time of receipt if the header has none."""

from __future__ import annotations

from typing import Generic, TypeVar

from rgbd_glue_ros.messages.synchronizer import Channel
from rgbd_glue_ros.parameters.inputs import RECEIPT
from rgbd_glue_ros.types import NANOSECONDS

Item = TypeVar("Item")

# A larger interval between streams means that they use different clocks.
OTHER_CLOCK_NS = NANOSECONDS

PAIR_BY_RECEIPT = (
    "set stamps to receipt (--set stamps=receipt, for the node -p stamps:=receipt) to pair "
    "images by the time of receipt"
)
"""What to do if images use different clocks."""


class StampSource(Generic[Item]):
    """Selects the stamps of messages, and remembers which channels have none.

    A first stamp of zero means that a channel has none, or that its time begins at zero, as in
    simulation. So an image with such a stamp is held back until the next one shows which it is. A
    camera info, which may be the only one, is not.

    Attributes:
        unstamped: channels whose messages have no stamp, according to the last one.
    """

    def __init__(self, source: str) -> None:
        """Sets the source.

        Args:
            source: one of ``InputConfig.stamps``.
        """
        self.unstamped: set[Channel] = set()
        self._is_receipt = source == RECEIPT
        self._newest_ns: dict[Channel, int] = {}
        # times of receipt and images
        self._held: dict[Channel, list[tuple[int, Item]]] = {}

    def is_by_receipt(self, channel: Channel) -> bool:
        """Whether the stamps of a channel are times of receipt, which jitter."""
        return self._is_receipt or channel in self.unstamped

    def accept(
        self, channel: Channel, stamp_ns: int, receipt_ns: int, item: Item
    ) -> list[tuple[int, Item]]:
        """Takes a message, and returns what can be paired now.

        Args:
            channel: the message's channel.
            stamp_ns: stamp in its header, nanoseconds.
            receipt_ns: when it was received or recorded, nanoseconds.
            item: the message.

        Returns:
            The stamps to pair messages by, nanoseconds, each with its message: none if this one is
            held back, also the one before if that was.
        """
        if self._is_receipt:
            return [(receipt_ns, item)]
        is_first = channel not in self._newest_ns
        newest_ns = self._newest_ns.get(channel, 0)
        self._newest_ns[channel] = max(stamp_ns, newest_ns)
        held = self._held.pop(channel, [])
        if stamp_ns:
            self.unstamped.discard(channel)
            return [*((0, first) for _, first in held), (stamp_ns, item)]
        if is_first and channel is not Channel.INFO:
            self._held[channel] = [(receipt_ns, item)]
            return []
        if is_first or newest_ns > 0:
            # among stamps a zero is an error
            return [(0, item)]
        self.unstamped.add(channel)
        return [*held, (receipt_ns, item)]

    def flush(self) -> list[tuple[Channel, int, Item]]:
        """The images still held back, with channel and stamp; when no more messages will come."""
        left = [(channel, 0, item) for channel, held in self._held.items() for _, item in held]
        self._held.clear()
        return left


def explain_miss(
    closest_miss_ns: int, max_interval_ns: int, with_two_clocks: str = PAIR_BY_RECEIPT
) -> str:
    """Why no images pair, and what to do.

    Args:
        closest_miss_ns: smallest interval between colour and depth stamps that did not pair,
            nanoseconds.
        max_interval_ns: interval up to which they pair, nanoseconds.
        with_two_clocks: what to do if the driver cannot stamp both with one clock.
    """
    if closest_miss_ns > OTHER_CLOCK_NS:
        return (
            f"the stamps of colour and depth are {closest_miss_ns / NANOSECONDS:.1f} s apart at "
            "best, so they come from two clocks: make the driver stamp both with one clock, or "
            f"{with_two_clocks}"
        )
    enough = closest_miss_ns / NANOSECONDS + 0.005
    return (
        f"the stamps of colour and depth are {closest_miss_ns / 1e6:.1f} ms apart at best, and "
        f"pair up to {max_interval_ns / 1e6:.1f} ms: synchronise the camera's streams, or raise "
        f"approx_sync_max_interval (with approx_sync; --set approx_sync_max_interval={enough:.3f}, "
        f"for the node -p approx_sync_max_interval:={enough:.3f})"
    )
