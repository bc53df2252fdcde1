"""Which time a message is of: its header's, or that of its receipt where this says nothing."""

from __future__ import annotations

from rgbd_glue_ros.messages.synchronizer import Channel
from rgbd_glue_ros.parameters.inputs import RECEIPT
from rgbd_glue_ros.types import NANOSECONDS

# Streams of one clock are never so far apart: that is two clocks.
OTHER_CLOCK_NS = NANOSECONDS

PAIR_BY_RECEIPT = (
    "set stamps to receipt (--set stamps=receipt, of the node -p stamps:=receipt) to pair images "
    "by when they were received"
)
"""What to do about images of two clocks."""


class StampSource:
    """Gives messages their stamps; keeps in mind which streams bear some.

    Attributes:
        unstamped: channels whose messages bear no stamp, by the last of them.
    """

    def __init__(self, source: str) -> None:
        """Takes a source.

        Args:
            source: one of ``InputConfig.stamps``.
        """
        self.unstamped: set[Channel] = set()
        self._is_receipt = source == RECEIPT
        self._newest_ns: dict[Channel, int] = {}

    def is_by_receipt(self, channel: Channel) -> bool:
        """Whether the stamps given for a channel are those of receipt, which jitter."""
        return self._is_receipt or channel in self.unstamped

    def of(self, channel: Channel, stamp_ns: int, receipt_ns: int) -> int:
        """The stamp that a message is paired by, nanoseconds.

        Args:
            channel: what it carries.
            stamp_ns: in its header.
            receipt_ns: when it was received or recorded.
        """
        if self._is_receipt:
            return receipt_ns
        # simulated time may begin with one zero; in a stream that bears stamps, one is wrong
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
        closest_miss_ns: least distance of colour and depth stamps that did not pair, nanoseconds.
        max_interval_ns: distance up to which they pair, nanoseconds.
        with_two_clocks: what to do where the driver cannot stamp both by one clock.
    """
    if closest_miss_ns > OTHER_CLOCK_NS:
        return (
            f"the stamps of colour and depth are {closest_miss_ns / NANOSECONDS:.1f} s apart at "
            "best, so they are of two clocks: have the driver stamp both by one, or "
            f"{with_two_clocks}"
        )
    enough = closest_miss_ns / NANOSECONDS + 0.005
    return (
        f"the stamps of colour and depth are {closest_miss_ns / 1e6:.1f} ms apart at best, and "
        f"pair up to {max_interval_ns / 1e6:.1f} ms: synchronise the camera's streams, or raise "
        f"approx_sync_max_interval (with approx_sync; --set approx_sync_max_interval={enough:.3f}, "
        f"of the node -p approx_sync_max_interval:={enough:.3f})"
    )
