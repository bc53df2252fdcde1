"""What is wrong with what arrives, in one line that says what to do about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rgbd_glue_ros.messages.stamps import PAIR_BY_RECEIPT, explain_miss
from rgbd_glue_ros.messages.synchronizer import Channel
from rgbd_glue_ros.types import NANOSECONDS

# Part of all frames from which on drops are worth a warning; fewer are told in the counts alone.
WORTH_A_WARNING = 0.1
# Images of this width are processed at 30 Hz on two cores.
SMALL_WIDTH = 640


@dataclass(frozen=True)
class Input:
    """A subscribed topic over the last while.

    Attributes:
        channel: what it carries.
        topic: its full name.
        publishers: who publishes it, in words; none if there is no publisher.
        received: messages that came.
        rate_hz: messages a second.
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
    inputs: Sequence[Input],
    closest_miss_ns: int | None,
    max_interval_ns: int,
    queue_needed: int = 0,
    backward: Sequence[Channel] = (),
    with_two_clocks: str = PAIR_BY_RECEIPT,
) -> str:
    """Why no frame was complete, as far as can be told, and what to do.

    Args:
        inputs: the topics.
        closest_miss_ns: least distance of colour and depth stamps that did not pair, nanoseconds;
            None if there was none.
        max_interval_ns: distance up to which they pair, nanoseconds.
        queue_needed: messages that would have to wait for images to meet; 0 where enough do.
        backward: channels whose stamps go back from message to message.
        with_two_clocks: what to do where colour and depth are of two clocks.
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
    elif backward:
        remedy = (
            f"the stamps of {' and '.join(c.value for c in backward)} go back from message to "
            "message: play recordings forward, and let one publisher with one clock fill a topic"
        )
    elif queue_needed:
        remedy = explain_queue(queue_needed)
    elif closest_miss_ns is not None:
        remedy = explain_miss(closest_miss_ns, max_interval_ns, with_two_clocks)
    else:
        remedy = "the stamps of colour, depth and camera info do not meet"
    return f"{seen}; {remedy}"


def explain_queue(queue_needed: int) -> str:
    """Why images of one time miss each other though their stamps are equal, and what to do.

    Args:
        queue_needed: messages that would have to wait.
    """
    return (
        "Images of colour and depth with the same stamps come so long after one another that the "
        f"first gives way before: set sync_queue_size:={queue_needed}, or have the driver send "
        "both at once"
    )


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


def explain_losses(
    received: Mapping[Channel, int], missing: Mapping[Channel, int], profiles: object
) -> str | None:
    """What images were lost between camera and node; None while it is less than a tenth.

    Camera infos are small and arrive where images are lost: what one channel has received, all were
    sent, and what the stamps of all of them leave out never was. Stamps that jitter leave small
    gaps and lose nothing. Infos that are missing do no harm: some are sent only once.

    Args:
        received: messages of each channel, lately.
        missing: messages that never came, by gaps in the stamps of each channel, lately.
        profiles: the DDS profile that loses no image.
    """
    most, unsent = max(received.values()), min(missing.values())
    lost = {c: max(missing[c] - unsent, most - received[c]) for c in received}
    words = [
        f"{lost[c]} of {lost[c] + received[c]} {c.value}"
        for c in (Channel.COLOR, Channel.DEPTH)
        if lost[c] > 1 and lost[c] >= WORTH_A_WARNING * (lost[c] + received[c])
    ]
    if not words:
        return None
    return (
        f"{' and '.join(words)} messages never came: lost on the way, or left out by the driver. "
        "Let the driver publish reliably, and set for it and for the node: "
        f"export FASTRTPS_DEFAULT_PROFILES_FILE={profiles}"
    )


def explain_gaps(received: Mapping[Channel, int], missing: Mapping[Channel, int]) -> str | None:
    """What the source left out; None while it is less than a tenth.

    Args:
        received: messages of each channel, lately.
        missing: messages that never came, by gaps in the stamps of each channel, lately.
    """
    unsent = min(missing.values())
    frames = unsent + min(received.values())
    if unsent < 2 or unsent < WORTH_A_WARNING * frames:
        return None
    return (
        f"{unsent} of {frames} frames were never sent: colour, depth and camera info have the same "
        "gaps between their stamps. A recording may have them; a driver leaves frames out for want "
        "of light, USB bandwidth or processor time"
    )


def explain_slowness(
    processed: int, left_out: int, period_ns: int, width: int, learned: Sequence[str] = ()
) -> str | None:
    """That frames come faster than they are processed; None while it is less than a tenth.

    Args:
        processed: frames with an estimate, lately.
        left_out: frames that gave way to a newer one, lately.
        period_ns: between colour images, nanoseconds.
        width: of the colour images as they are processed, pixels; 0 if none came yet.
        learned: parameters that choose a learned feature, as ``features.visual:=xfeat``.
    """
    frames = processed + left_out
    if left_out <= 1 or left_out < WORTH_A_WARNING * frames:
        return None
    hertz = NANOSECONDS / period_ns if period_ns else 0.0
    rate = f" at {hertz:.0f} Hz" if hertz else ""
    # while the first frame is in work, it is only known that less than one is processed in the time
    bound = "" if processed else "below "
    kept = f" ({bound}{hertz * max(processed, 1) / frames:.1f} Hz)" if hertz else ""
    return (
        f"{left_out} of {frames} frames were left out, since they come faster{rate} than this "
        f"machine processes them{kept} at {width} pixels of width: {_faster(width, learned)}"
    )


def _faster(width: int, learned: Sequence[str]) -> str:
    """What makes frames take less time."""
    if learned:
        takes = "takes" if len(learned) == 1 else "take"
        return (
            f"{' and '.join(learned)} {takes} most of it unless there is a GPU; start the node "
            "with the features of the live preset, or with lower features.matcher_keypoints, "
            f"features.keypoints and features.geometric_keypoints, or max_width:={SMALL_WIDTH // 2}"
        )
    if width > SMALL_WIDTH:
        return f"set max_width:={SMALL_WIDTH}, or have the driver send smaller images"
    return "give the node more of the processor, or have the driver send fewer frames"


def _names(channels: Sequence[Channel]) -> str:
    """``depth is`` or ``color and depth are``; empty for none."""
    if not channels:
        return ""
    return " and ".join(c.value for c in channels) + (" is" if len(channels) == 1 else " are")
