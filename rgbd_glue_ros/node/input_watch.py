"""Checks which messages arrive, and reports what is wrong with them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from rgbd_glue_ros.live.input_faults import (
    Input,
    explain_gaps,
    explain_interval,
    explain_losses,
    explain_queue,
    explain_rates,
    explain_silence,
    explain_slowness,
    explain_waiting,
)
from rgbd_glue_ros.live.monitor import Monitor
from rgbd_glue_ros.messages.stamps import StampSource
from rgbd_glue_ros.messages.synchronizer import PAIRED, Channel, Synchronizer
from rgbd_glue_ros.node.inputs import NodeInput
from rgbd_glue_ros.node.silence import SilenceLog
from rgbd_glue_ros.parameters import PROFILES_VARIABLE, profiles_file

# Period of the checks.
LOOK_S = 5.0


@dataclass(frozen=True)
class _Counts:
    """Counts of messages and frames: so far, or since the last check.

    Attributes:
        matches: complete frames.
        received: received messages of each channel.
        missing: messages of each channel that are missing, from gaps between the stamps.
        backward: messages of each channel with a stamp before that of an earlier message.
        repeated: messages of each channel with the stamp of an earlier message.
        processed: frames with an estimate, as in ``Load``.
        left_out: frames that were replaced by a newer one, as in ``Load``.
        waited_ns: how long frames waited for TF, nanoseconds.
    """

    matches: int
    received: dict[Channel, int]
    missing: dict[Channel, int]
    backward: dict[Channel, int]
    repeated: dict[Channel, int]
    processed: int
    left_out: int
    waited_ns: int

    def minus(self, before: _Counts) -> _Counts:
        """The counts since earlier ones."""
        return _Counts(
            self.matches - before.matches,
            _difference(self.received, before.received),
            _difference(self.missing, before.missing),
            _difference(self.backward, before.backward),
            _difference(self.repeated, before.repeated),
            self.processed - before.processed,
            self.left_out - before.left_out,
            self.waited_ns - before.waited_ns,
        )


def _difference(now: dict[Channel, int], before: dict[Channel, int]) -> dict[Channel, int]:
    return {channel: count - before[channel] for channel, count in now.items()}


class InputWatch:
    """Checks the input every ``LOOK_S`` once it is started, and logs new problems.

    Attributes:
        drops: why more than a tenth of frames since the last check have no pose; "" otherwise.
    """

    def __init__(
        self,
        node: Node,
        synchronizer: Synchronizer[Any],
        monitor: Monitor,
        stamps: StampSource[Any],
        learned: Sequence[str],
        with_two_clocks: str,
    ) -> None:
        """Prepares the checks; ``start`` starts them.

        Args:
            node: provides the timer and the log.
            synchronizer: counts messages.
            monitor: counts frames.
            stamps: knows which messages use the time of receipt.
            learned: parameters that select a learned feature.
            with_two_clocks: what to do if colour and depth use different clocks.
        """
        self.drops = self._silence = ""
        self._stamps = stamps
        self._learned = learned
        self._with_two_clocks = with_two_clocks
        self._monitor = monitor
        self._node = node
        self._synchronizer = synchronizer
        self._before = self._counts()
        self._warned: set[str] = set()
        self._silence_log = SilenceLog(node, "publishers")

    @property
    def silence(self) -> str:
        """Why no complete frame arrived before the last check, nor since; "" if one did."""
        return "" if self._synchronizer.matches > self._before.matches else self._silence

    def start(self, inputs: Sequence[NodeInput]) -> None:
        """Starts to check subscriptions."""
        # not the node's clock: simulated time may stand still just when silence must be reported
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._node.create_timer(LOOK_S, lambda: self._look(inputs), clock=clock)

    def _counts(self) -> _Counts:
        counts = self._synchronizer.counts
        load = self._monitor.load
        return _Counts(
            self._synchronizer.matches,
            {c: counts[c].received for c in Channel},
            {c: counts[c].missing for c in Channel},
            {c: counts[c].late + counts[c].strays for c in Channel},
            {c: counts[c].duplicates for c in Channel},
            load.processed,
            load.left_out,
            self._monitor.waited_ns,
        )

    def _look(self, inputs: Sequence[NodeInput]) -> None:
        now, before = self._counts(), self._before
        self._before = now
        since, synchronizer = now.minus(before), self._synchronizer
        self._look_for_losses(since)
        self._warn_if_new(
            "interval", explain_interval(synchronizer.interval_ns, synchronizer.period_ns)
        )
        self._warn_if_new("name", explain_namesakes(self._node))
        for each in inputs:
            self._warn_if_new(f"mixture on {each.topic}", each.explain_mixture())
        if since.matches:
            # without matches it is part of the reason for silence
            queue_needed = synchronizer.queue_needed
            self._warn_if_new("queue", explain_queue(queue_needed) if queue_needed else None)
            synchronizer.forget_misses()
        self._silence = "" if since.matches else self._explain_silence(inputs, since)
        self._silence_log.look(
            f"No frame for {LOOK_S:.0f} s: {self._silence}" if self._silence else None,
            has_publishers=any(i.publishers or i.other for i in inputs),
            has_messages=any(since.received.values()),
        )

    def _look_for_losses(self, since: _Counts) -> None:
        """Explains messages and frames that were lost or left out since the last check."""
        received, synchronizer = since.received, self._synchronizer
        # times of receipt jitter, so their gaps say nothing about losses
        missing = {
            c: 0 if self._stamps.is_by_receipt(c) else count for c, count in since.missing.items()
        }
        rates = None if self._stamps.unstamped else explain_rates(received, synchronizer.periods_ns)
        causes = {
            "rates": rates,
            "lost": None if rates else explain_losses(received, missing, _profiles_to_set()),
            "gaps": explain_gaps(received, missing),
            "slow": self._explain_left_out(since),
        }
        for what, line in causes.items():
            self._warn_if_new(what, line)
        self.drops = "; ".join(line for line in causes.values() if line)

    def _explain_left_out(self, since: _Counts) -> str | None:
        # a frame needs both images, so frames may come less often than colour
        matches = max(since.matches, 1)
        received = max(since.received[Channel.COLOR], matches)
        period_ns = self._synchronizer.period_ns * received // matches
        processed, left_out, monitor = since.processed, since.left_out, self._monitor
        return explain_waiting(
            processed, left_out, period_ns, since.waited_ns, monitor.waited_for
        ) or explain_slowness(processed, left_out, period_ns, monitor.width, self._learned)

    def _explain_silence(self, inputs: Sequence[NodeInput], since: _Counts) -> str:
        received = since.received
        seen = [
            Input(
                i.channel,
                i.topic,
                i.publishers,
                received[i.channel],
                received[i.channel] / LOOK_S,
                i.other,
                str(i.arrivals),
            )
            for i in inputs
        ]
        synchronizer = self._synchronizer
        return explain_silence(
            seen,
            synchronizer.closest_miss_ns,
            synchronizer.max_interval_ns,
            synchronizer.queue_needed,
            [c for c in Channel if 2 * since.backward[c] > received[c]],
            self._with_two_clocks,
            # an info may be sent again and again
            [c for c in Channel if c in PAIRED and 2 * since.repeated[c] > received[c]],
        )

    def _warn_if_new(self, what: str, line: str | None) -> None:
        """Logs a problem, unless the last check found one of the same kind."""
        if line is None:
            self._warned.discard(what)
        elif what not in self._warned:
            self._warned.add(what)
            self._node.get_logger().warning(line)


def explain_namesakes(node: Node) -> str | None:
    """A warning if other nodes have the same name as ``node``; None if there are none."""
    own = node.get_fully_qualified_name()
    namesakes = node.get_fully_qualified_node_names().count(own) - 1
    if namesakes < 1:
        return None
    return (
        f"{own} is also the name of {namesakes} other node(s): services and parameters reach only "
        "one of them, and their topics mix; stop the others, or start them with -r __node:=NAME"
    )


def _profiles_to_set() -> Path | None:
    """The DDS profile that loses no image; None if this process has it."""
    profiles = profiles_file()
    return None if os.environ.get(PROFILES_VARIABLE) == str(profiles) else profiles
