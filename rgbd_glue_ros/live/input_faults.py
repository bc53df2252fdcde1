"""Messages that say in one line what is wrong with the input and what to do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rgbd_glue_ros.live.transports import OtherTransport, explain_transports
from rgbd_glue_ros.messages.stamps import PAIR_BY_RECEIPT, explain_miss
from rgbd_glue_ros.messages.synchronizer import Channel
from rgbd_glue_ros.parameters import PROFILES_VARIABLE
from rgbd_glue_ros.types import NANOSECONDS

# Fraction of all frames from which drops cause a warning; fewer appear only in the counts.
WORTH_A_WARNING = 0.1
# Images of this width are processed at 30 Hz on two cores.
SMALL_WIDTH = 640
# Ratios of two channels' rates, by their counts and by their stamps, that agree.
_SAME_RATIO = 0.2


@dataclass(frozen=True)
class Input:
    """A subscribed topic since the last check.

    Attributes:
        channel: what it carries.
        topic: its full name.
        publishers: descriptions of its publishers; empty if there are none.
        received: number of received messages.
        rate_hz: messages per second.
        other: where the same image is published in another transport, if it is not here.
        last: when the last message came, of how many, by ``Arrivals``; "" if none ever did.
    """

    channel: Channel
    topic: str
    publishers: tuple[str, ...]
    received: int
    rate_hz: float
    other: OtherTransport | None = None
    last: str = ""

    def __str__(self) -> str:
        what = f"{self.topic} ({self.channel.value})"
        if not self.publishers:
            return f"{what} has no publisher" + (f" any more: {self.last}" if self.last else "")
        has_stopped = self.last and not self.received
        came = self.last if has_stopped else f"{self.received} messages ({self.rate_hz:.1f} Hz)"
        return f"{what} from {', '.join(self.publishers)}: {came}"


def explain_silence(
    inputs: Sequence[Input],
    closest_miss_ns: int | None,
    max_interval_ns: int,
    queue_needed: int = 0,
    backward: Sequence[Channel] = (),
    with_two_clocks: str = PAIR_BY_RECEIPT,
    repeated: Sequence[Channel] = (),
) -> str:
    """Why no frame was complete, as far as is known, and what to do.

    Args:
        inputs: the topics.
        closest_miss_ns: smallest interval between colour and depth stamps that did not pair,
            nanoseconds; None if there was none.
        max_interval_ns: interval up to which they pair, nanoseconds.
        queue_needed: queue size with which images would pair; 0 if the present one is enough.
        backward: channels whose stamps go backward from message to message.
        with_two_clocks: what to do if colour and depth use different clocks.
        repeated: channels whose messages repeat a stamp.
    """
    seen = "; ".join(map(str, inputs))
    others = [i.other for i in inputs if i.other is not None]
    unpublished = [i for i in inputs if not (i.publishers or i.other)]
    silent = [i for i in inputs if not i.received]
    if others or unpublished:
        # camera infos, which have no transports, may be missing too
        remedy = "; ".join(
            [explain_transports(others)] * bool(others)
            + _absence(
                unpublished,
                "start the camera, or remap the topics to the names it uses",
                "the driver has ended: start it again",
            )
        )
    elif silent:
        remedy = "; ".join(
            _absence(
                silent,
                "check whether the camera runs, and whether type and QoS of its topics match",
                "the driver hangs, or was killed and is counted for a while yet: see its log",
            )
        )
    elif repeated:
        remedy = (
            f"the messages of {' and '.join(c.value for c in repeated)} repeat one stamp: make the "
            f"driver stamp each image with its time, or {with_two_clocks}"
        )
    elif backward:
        remedy = (
            f"the stamps of {' and '.join(c.value for c in backward)} go backward from message to "
            "message: play recordings forward, with one publisher and one clock for each topic"
        )
    elif queue_needed:
        remedy = explain_queue(queue_needed)
    elif closest_miss_ns is not None:
        remedy = explain_miss(closest_miss_ns, max_interval_ns, with_two_clocks)
    else:
        remedy = "the stamps of colour, depth and camera info do not match"
    return f"{seen}; {remedy}"


def explain_queue(queue_needed: int) -> str:
    """Why images with matching stamps do not pair, and what to do.

    Args:
        queue_needed: the queue size that would be enough.
    """
    return (
        "Colour and depth images with the same stamp arrive so far apart that the first is dropped "
        f"before the second comes: set sync_queue_size:={queue_needed}, or make the driver send "
        "both together"
    )


def explain_interval(interval_ns: int, period_ns: int) -> str | None:
    """A warning if the stamps of colour and depth are far apart; None if they are not.

    Args:
        interval_ns: usual interval between the stamps of a pair, nanoseconds.
        period_ns: period of the colour images, nanoseconds.
    """
    if 2 * interval_ns <= period_ns:
        return None
    return (
        f"The stamps of colour and depth are {interval_ns / 1e6:.1f} ms apart, more than half of "
        f"the {period_ns / 1e6:.1f} ms between frames: in motion, the two images do not show the "
        "same view. Synchronise the camera's streams"
    )


def explain_rates(received: Mapping[Channel, int], periods_ns: Mapping[Channel, int]) -> str | None:
    """A warning if colour and depth come at different rates, as their stamps say; None otherwise.

    Args:
        received: received messages of each channel since the last check.
        periods_ns: time between the stamps of each channel, nanoseconds; 0 if unknown.
    """
    slow, fast = sorted((Channel.COLOR, Channel.DEPTH), key=lambda c: received[c])
    fewer = received[fast] - received[slow]
    are_known = periods_ns[slow] > 0 and periods_ns[fast] > 0
    if not are_known or fewer <= 1 or fewer < WORTH_A_WARNING * received[fast]:
        return None
    # lost messages leave gaps in the stamps, of which few are as long as the mean
    ratio = periods_ns[slow] / periods_ns[fast] * received[slow] / received[fast]
    if abs(ratio - 1) > _SAME_RATIO:
        return None
    hertz = {channel: NANOSECONDS / periods_ns[channel] for channel in (slow, fast)}
    return (
        f"{slow.value} comes at {hertz[slow]:.0f} Hz and {fast.value} at {hertz[fast]:.0f} Hz, and "
        "a frame needs both: set the camera's streams to one rate"
    )


def explain_losses(
    received: Mapping[Channel, int], missing: Mapping[Channel, int], profiles: object | None
) -> str | None:
    """How many images were lost between camera and node; None if fewer than a tenth.

    Camera infos are small and arrive even when images are lost. So what one channel has received
    was sent on all channels, and what is missing from the stamps of all channels was never sent.
    Jitter of stamps leaves small gaps without any loss. Missing infos do no harm: some are sent
    only once. A channel that delivers nothing at all has lost nothing: its topic or its QoS is
    another, as ``explain_silence`` says.

    Args:
        received: received messages of each channel since the last check.
        missing: missing messages of each channel since the last check, from gaps in the stamps.
        profiles: path of the DDS profile that avoids such losses; None if this node has it.
    """
    most, unsent = max(received.values()), min(missing.values())
    lost = {c: max(missing[c] - unsent, most - received[c]) for c in received}
    words = [
        f"{lost[c]} of {lost[c] + received[c]} {c.value}"
        for c in (Channel.COLOR, Channel.DEPTH)
        if received[c] and lost[c] > 1 and lost[c] >= WORTH_A_WARNING * (lost[c] + received[c])
    ]
    if not words:
        return None
    remedy = (
        f"set for it what this node has: {PROFILES_VARIABLE}"
        if profiles is None
        else f"set for it and for the node: export {PROFILES_VARIABLE}={profiles}"
    )
    return (
        f"{' and '.join(words)} messages never arrived: lost on the way, or skipped by the driver. "
        f"Make the driver publish reliably, and {remedy}"
    )


def explain_gaps(received: Mapping[Channel, int], missing: Mapping[Channel, int]) -> str | None:
    """How many frames the source did not send; None if fewer than a tenth.

    Args:
        received: received messages of each channel since the last check.
        missing: missing messages of each channel since the last check, from gaps in the stamps.
    """
    unsent = min(missing.values())
    frames = unsent + min(received.values())
    if unsent < 2 or unsent < WORTH_A_WARNING * frames:
        return None
    return (
        f"{unsent} of {frames} frames were never sent: colour, depth and camera info have the same "
        "gaps between their stamps. A recording may contain such gaps; a driver skips frames if it "
        "lacks light, USB bandwidth or processor time"
    )


def explain_slowness(
    processed: int, left_out: int, period_ns: int, width: int, learned: Sequence[str] = ()
) -> str | None:
    """A warning that frames come faster than they are processed; None if few were dropped.

    Args:
        processed: frames with an estimate since the last check.
        left_out: frames that a newer one replaced since the last check; the limit is a tenth.
        period_ns: period of the frames, nanoseconds.
        width: width of the processed colour images, pixels; 0 before the first.
        learned: parameters that select a learned feature, such as ``features.visual:=xfeat``.
    """
    frames = processed + left_out
    if not _are_many(left_out, frames):
        return None
    hertz = NANOSECONDS / period_ns if period_ns else 0.0
    rate = f" at {hertz:.0f} Hz" if hertz else ""
    # while the first frame is being processed, only an upper bound of the rate is known
    bound = "" if processed else "below "
    kept = f" ({bound}{hertz * max(processed, 1) / frames:.1f} Hz)" if hertz else ""
    return (
        f"{left_out} of {frames} frames were dropped, since they come faster{rate} than this "
        f"machine processes them{kept} at a width of {width} pixels: {_faster(width, learned)}"
    )


def explain_waiting(
    processed: int, left_out: int, period_ns: int, waited_ns: int, transform: str
) -> str | None:
    """A warning that frames were dropped while others waited for TF.

    Args:
        processed: frames with an estimate since the last check.
        left_out: frames that a newer one replaced since the last check.
        period_ns: period of the frames, nanoseconds.
        waited_ns: how long frames waited for TF since the last check, nanoseconds.
        transform: the transform they waited for.

    Returns:
        The warning; None if few frames were dropped, or most of them for another reason.
    """
    frames = processed + left_out
    is_cause = waited_ns > 0 and 2 * waited_ns >= left_out * period_ns
    if not (_are_many(left_out, frames) and is_cause):
        return None
    return (
        f"{left_out} of {frames} frames were dropped, since others waited "
        f"{waited_ns / NANOSECONDS:.1f} s for {transform} on TF: make sure that it is broadcast "
        "in time, or lower wait_for_transform"
    )


def _are_many(left_out: int, frames: int) -> bool:
    return left_out > 1 and left_out >= WORTH_A_WARNING * frames


def _faster(width: int, learned: Sequence[str]) -> str:
    """What to do so that frames take less time."""
    if learned:
        takes = "takes" if len(learned) == 1 else "take"
        return (
            f"{' and '.join(learned)} {takes} most of the time without a GPU; start the node "
            "with the features of the live preset, or with lower features.matcher_keypoints, "
            f"features.keypoints and features.geometric_keypoints, or max_width:={SMALL_WIDTH // 2}"
        )
    if width > SMALL_WIDTH:
        return f"set max_width:={SMALL_WIDTH}, or make the driver send smaller images"
    return "give the node more processor time, or make the driver send fewer frames"


def _absence(inputs: Sequence[Input], if_never: str, if_stopped: str) -> list[str]:
    """What is missing and what has stopped, with what to do about each."""
    missing = [i.channel.value for i in inputs if not i.last]
    stopped = [i.channel.value for i in inputs if i.last]
    are = "is" if len(missing) == 1 else "are"
    said = [f"{' and '.join(missing)} {are} missing: {if_never}"] * bool(missing)
    return said + [f"{' and '.join(stopped)} stopped: {if_stopped}"] * bool(stopped)
