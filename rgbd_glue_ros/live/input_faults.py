"""What is wrong with what arrives, in one line that says what to do about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rgbd_glue_ros.messages.stamps import explain_miss
from rgbd_glue_ros.messages.synchronizer import Channel


@dataclass(frozen=True)
class Input:
    """A subscribed topic over the last while.

    Attributes:
        channel: what it carries.
        topic: its full name.
        publishers: who publishes it, in words; none if there is no publisher.
        received: messages that came.
        rate_hz: of these.
    """

    channel: Channel
    topic: str
    publishers: tuple[str, ...]
    received: int
    rate_hz: float

    def __str__(self) -> str:
        if not self.publishers:
            return f"{self.topic} ({self.channel.value}) has no publisher"
        by = ", ".join(self.publishers)
        return (
            f"{self.topic} ({self.channel.value}) by {by}: {self.received} messages "
            f"({self.rate_hz:.1f} Hz)"
        )


def explain_silence(
    inputs: Sequence[Input], closest_miss_ns: int | None, max_interval_ns: int
) -> str:
    """Why no frame was complete, as far as can be told, and what to do.

    Args:
        inputs: the topics.
        closest_miss_ns: least distance of colour and depth stamps that did not pair, nanoseconds;
            None if there was none.
        max_interval_ns: distance up to which they pair, nanoseconds.
    """
    seen = "; ".join(map(str, inputs))
    unpublished = _names([i.channel for i in inputs if not i.publishers])
    missing = _names([i.channel for i in inputs if not i.received])
    if unpublished:
        remedy = (
            f"{unpublished} missing: start the camera, or remap the topics to the names it uses"
        )
    elif missing:
        remedy = (
            f"{missing} missing: see whether the camera runs, and whether type and QoS of its "
            "topics fit"
        )
    elif closest_miss_ns is not None:
        remedy = explain_miss(closest_miss_ns, max_interval_ns)
    else:
        remedy = "the stamps of colour, depth and camera info do not meet"
    return f"{seen}; {remedy}"


def explain_interval(interval_ns: int, period_ns: int) -> str | None:
    """What a great distance of colour and depth stamps does; None if it is not great.

    Args:
        interval_ns: usual distance of the stamps of a pair, nanoseconds.
        period_ns: of the colour images, nanoseconds.
    """
    if 2 * interval_ns <= period_ns:
        return None
    return (
        f"The stamps of colour and depth are {interval_ns / 1e6:.1f} ms apart, more than half of "
        f"the {period_ns / 1e6:.1f} ms between frames: what moves is not at one place in both. "
        "Synchronise the camera's streams"
    )


def explain_missing(missing: Mapping[Channel, int], received: Mapping[Channel, int]) -> str | None:
    """Which messages never came, by gaps in the stamps; None if all did.

    Args:
        missing: messages that never came, of each channel.
        received: messages that did.
    """
    gaps = [
        f"{count} of {count + received[channel]} {channel.value}"
        for channel, count in missing.items()
        if count > 0
    ]
    if not gaps:
        return None
    return (
        f"By gaps in their stamps, {' and '.join(gaps)} messages never came: the driver left them "
        "out, or DDS lost them on the way (docs/node.md, Images without loss)"
    )


def _names(channels: Sequence[Channel]) -> str:
    """``depth is`` or ``color and depth are``; empty for none."""
    if not channels:
        return ""
    return " and ".join(c.value for c in channels) + (" is" if len(channels) == 1 else " are")
