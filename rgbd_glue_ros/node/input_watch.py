"""Checks which messages arrive, and reports what is wrong with them."""

from __future__ import annotations

import os
import time
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
from rgbd_glue_ros.live.monitor import Drop, Monitor
from rgbd_glue_ros.messages.fault_news import FaultNews
from rgbd_glue_ros.messages.stamps import StampSource
from rgbd_glue_ros.messages.synchronizer import Channel, Synchronizer
from rgbd_glue_ros.node.inputs import NodeInput
from rgbd_glue_ros.parameters import PROFILES_VARIABLE, profiles_file

# Period of the checks.
LOOK_S = 5.0


@dataclass(frozen=True)
class _Counts:
    """Counts of messages and frames so far.

    Attributes:
        matches: complete frames.
        received: received messages of each channel.
        missing: messages of each channel that are missing, from gaps between the stamps.
        backward: messages of each channel with a stamp before that of an earlier message.
        processed: frames with an estimate.
        left_out: frames that were replaced by a newer one.
        waited_ns: how long frames waited for TF, nanoseconds.
    """

    matches: int
    received: dict[Channel, int]
    missing: dict[Channel, int]
    backward: dict[Channel, int]
    processed: int
    left_out: int
    waited_ns: int


class NodeWatch:
    """Checks the input every ``LOOK_S`` once it is started, and logs new problems.

    Attributes:
        silence: why no complete frame arrived since the last check; "" if one did.
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
        self.silence = self.drops = ""
        self._stamps = stamps
        self._learned = learned
        self._with_two_clocks = with_two_clocks
        self._monitor = monitor
        self._node = node
        self._synchronizer = synchronizer
        self._before = self._counts()
        self._warned: set[str] = set()
        self._silences = FaultNews()

    def start(self, inputs: Sequence[NodeInput]) -> None:
        """Starts to check subscriptions."""
        # not the node's clock: simulated time may stand still just when silence must be reported
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._node.create_timer(LOOK_S, lambda: self._look(inputs), clock=clock)

    def _counts(self) -> _Counts:
        counts = self._synchronizer.counts
        summary = self._monitor.summary(time.monotonic_ns())
        return _Counts(
            self._synchronizer.matches,
            {c: counts[c].received for c in Channel},
            {c: counts[c].missing for c in Channel},
            {c: counts[c].late + counts[c].strays for c in Channel},
            summary.frames,
            summary.drops[Drop.SUPERSEDED],
            self._monitor.waited_ns,
        )

    def _look(self, inputs: Sequence[NodeInput]) -> None:
        now, before = self._counts(), self._before
        self._before = now
        received = {c: now.received[c] - before.received[c] for c in Channel}
        # times of receipt jitter, so their gaps say nothing about losses
        missing = {
            c: 0 if self._stamps.is_by_receipt(c) else now.missing[c] - before.missing[c]
            for c in Channel
        }
        synchronizer = self._synchronizer
        rates = None if self._stamps.unstamped else explain_rates(received, synchronizer.periods_ns)
        lost = None if rates else explain_losses(received, missing, _profiles_to_set())
        gaps = explain_gaps(received, missing)
        # a frame needs both images, so frames may come less often than colour
        matches = max(now.matches - before.matches, 1)
        period_ns = synchronizer.period_ns * max(received[Channel.COLOR], matches) // matches
        processed, left_out = now.processed - before.processed, now.left_out - before.left_out
        slow = explain_waiting(
            processed,
            left_out,
            period_ns,
            now.waited_ns - before.waited_ns,
            self._monitor.waited_for,
        ) or explain_slowness(
            processed,
            left_out,
            period_ns,
            self._monitor.width,
            self._learned,
        )
        self._warn_if_new("rates", rates)
        self._warn_if_new("lost", lost)
        self._warn_if_new("gaps", gaps)
        self._warn_if_new("slow", slow)
        self.drops = "; ".join(line for line in (rates, lost, gaps, slow) if line)
        self._warn_if_new(
            "interval", explain_interval(synchronizer.interval_ns, synchronizer.period_ns)
        )
        queue_needed = synchronizer.queue_needed
        if now.matches > before.matches:  # otherwise it is part of the reason for silence
            self._warn_if_new("queue", explain_queue(queue_needed) if queue_needed else None)
        self._warn_if_new("name", explain_namesakes(self._node))
        if now.matches > before.matches:
            self.silence = ""
            self._silences.forget()
            self._synchronizer.forget_misses()
            return
        backward = [c for c in Channel if 2 * (now.backward[c] - before.backward[c]) > received[c]]
        self.silence = self._explain_silence(inputs, received, backward)
        # a line that differs only in its counts is not news
        if self._silences.is_news("silence", self.silence):
            self._node.get_logger().warning(f"No frame for {LOOK_S:.0f} s: {self.silence}")

    def _explain_silence(
        self,
        inputs: Sequence[NodeInput],
        received: dict[Channel, int],
        backward: Sequence[Channel],
    ) -> str:
        seen = [
            Input(
                i.channel, i.topic, i.publishers, received[i.channel], received[i.channel] / LOOK_S
            )
            for i in inputs
        ]
        synchronizer = self._synchronizer
        return explain_silence(
            seen,
            synchronizer.closest_miss_ns,
            synchronizer.max_interval_ns,
            synchronizer.queue_needed,
            backward,
            self._with_two_clocks,
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
