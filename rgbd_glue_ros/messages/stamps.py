"""The stamp of a message: from its header, or the time of receipt if the header has none."""

from __future__ import annotations

from rgbd_glue_ros.messages.synchronizer import Channel
from rgbd_glue_ros.parameters.inputs import RECEIPT
from rgbd_glue_ros.types import NANOSECONDS

# A larger interval between streams means that they use different clocks.
OTHER_CLOCK_NS = NANOSECONDS

PAIR_BY_RECEIPT = (
    "set stamps to receipt (--set stamps=receipt, for the node -p stamps:=receipt) to pair "
    "images by the time of receipt"
)
"""What to do if images use different clocks."""


class StampSource:
    """Selects the stamps of messages, and remembers which channels have none.

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

    def is_by_receipt(self, channel: Channel) -> bool:
        """Whether the stamps of a channel are times of receipt, which jitter."""
        return self._is_receipt or channel in self.unstamped

    def of(self, channel: Channel, stamp_ns: int, receipt_ns: int) -> int:
        """The stamp to pair a message by, nanoseconds.

        Args:
            channel: the message's channel.
            stamp_ns: stamp in its header, nanoseconds.
            receipt_ns: when it was received or recorded, nanoseconds.
        """
        if self._is_receipt:
            return receipt_ns
        # a single zero is not enough: simulated time may start with one, and in a stream with
        # stamps it is an error
        if not stamp_ns and self._newest_ns.get(channel) == 0:
            self.unstamped.add(channel)
            return receipt_ns
        self._newest_ns[channel] = max(stamp_ns, self._newest_ns.get(channel, 0))
        self.unstamped -= {channel} if stamp_ns else set()
        return stamp_ns


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
