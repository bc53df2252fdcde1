"""Watches what arrives, and says what is wrong with it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from rgbd_glue_ros.live.input_faults import (
    Input,
    explain_gaps,
    explain_interval,
    explain_losses,
    explain_queue,
    explain_silence,
    explain_slowness,
)
from rgbd_glue_ros.live.monitor import Drop, Monitor
from rgbd_glue_ros.messages.fault_news import FaultNews
from rgbd_glue_ros.messages.stamps import StampSource
from rgbd_glue_ros.messages.synchronizer import Channel, Synchronizer
from rgbd_glue_ros.node.inputs import NodeInput
from rgbd_glue_ros.parameters import profiles_file

# Time between two looks at what arrives.
LOOK_S = 5.0


@dataclass(frozen=True)
class _Counts:
    """What became of messages and frames so far.

    Attributes:
        matches: complete frames.
        received: messages of each channel that came.
        missing: messages of each channel that did not come, by gaps in the stamps.
        backward: messages of each channel whose stamp is before that of an earlier message.
        processed: frames with an estimate.
        left_out: frames that gave way to a newer one.
    """

    matches: int
    received: dict[Channel, int]
    missing: dict[Channel, int]
    backward: dict[Channel, int]
    processed: int
    left_out: int


class NodeWatch:
    """Looks every few seconds, once it is started, and logs what is new.

    Attributes:
        silence: why no frame was complete lately; "" if some were.
        drops: why more than a tenth of the frames got no pose lately; "" if fewer got none.
    """

    def __init__(
        self,
        node: Node,
        synchronizer: Synchronizer[Any],
        monitor: Monitor,
        stamps: StampSource,
        learned: Sequence[str],
        with_two_clocks: str,
    ) -> None:
        """Has seen nothing yet.

        Args:
            node: has the timer and the log.
            synchronizer: counts messages.
            monitor: counts frames.
            stamps: tells which messages go by their receipt.
            learned: parameters that choose a learned feature.
            with_two_clocks: what to do where colour and depth are of two clocks.
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
        """Watches subscriptions from now on."""
        # not the node's clock: simulated time may stand still just when silence is to be reported
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
        )

    def _look(self, inputs: Sequence[NodeInput]) -> None:
        now, before = self._counts(), self._before
        self._before = now
        received = {c: now.received[c] - before.received[c] for c in Channel}
        # receipts jitter, so that gaps between them tell nothing
        missing = {
            c: 0 if self._stamps.is_by_receipt(c) else now.missing[c] - before.missing[c]
            for c in Channel
        }
        synchronizer = self._synchronizer
        lost = explain_losses(received, missing, profiles_file())
        gaps = explain_gaps(received, missing)
        slow = explain_slowness(
            now.processed - before.processed,
            now.left_out - before.left_out,
            synchronizer.period_ns,
            self._monitor.width,
            self._learned,
        )
        self._warn_if_new("lost", lost)
        self._warn_if_new("gaps", gaps)
        self._warn_if_new("slow", slow)
        self.drops = "; ".join(line for line in (lost, gaps, slow) if line)
        self._warn_if_new(
            "interval", explain_interval(synchronizer.interval_ns, synchronizer.period_ns)
        )
        queue_needed = synchronizer.queue_needed
        if now.matches > before.matches:  # else it is why there is silence
            self._warn_if_new("queue", explain_queue(queue_needed) if queue_needed else None)
        self._warn_if_new("name", explain_namesakes(self._node))
        if now.matches > before.matches:
            self.silence = ""
            self._silences.forget()
            return
        backward = [c for c in Channel if 2 * (now.backward[c] - before.backward[c]) > received[c]]
        self.silence = self._explain_silence(inputs, received, backward)
        # counts differ from look to look, and are no news
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
        """Logs what is wrong unless the last look found the same kind wrong."""
        if line is None:
            self._warned.discard(what)
        elif what not in self._warned:
            self._warned.add(what)
            self._node.get_logger().warning(line)


def explain_namesakes(node: Node) -> str | None:
    """Warns of other nodes with the name of a node; None where there are none."""
    own = node.get_fully_qualified_name()
    namesakes = node.get_fully_qualified_node_names().count(own) - 1
    if namesakes < 1:
        return None
    return (
        f"{own} is the name of {namesakes} more: services and parameters reach one of these nodes, "
        "and their topics mix; end the others, or start them with -r __node:=NAME"
    )
