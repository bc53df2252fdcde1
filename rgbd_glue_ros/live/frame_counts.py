"""Counts of processed and dropped frames, their rate and latency."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np

from rgbd_glue_ros.types import NANOSECONDS, OdometryEstimate, TrackingState

# Frames that latency percentiles are computed from: the last half minute.
LATENCY_WINDOW = 1000
RATE_WINDOW_NS = 5 * NANOSECONDS


class Drop(Enum):
    """Why a complete frame (colour, depth and camera info) got no estimate."""

    SUPERSEDED = "a newer frame came while the odometry was busy"
    TOO_SOON = "it came sooner than max_update_rate allows"
    PAUSED = "the odometry was paused"
    UNPLACED = "the camera's pose on the robot was not known yet"
    UNUSABLE = "a message could not be used"
    FAILED = "of an internal error"


@dataclass(frozen=True)
class Summary:
    """The counts at one moment.

    Attributes:
        state: tracking state after the last frame.
        frames: frames with an estimate.
        tracked: frames whose estimate has a pose.
        drops: frames without an estimate, by reason.
        rate_hz: estimates per second, over the last ``RATE_WINDOW_NS``.
        latency_p50_ms: median time from the arrival of a frame's last message to the publication
            of its pose, milliseconds; NaN before the first frame.
        latency_p95_ms: 95th percentile of these times, milliseconds.
    """

    state: TrackingState
    frames: int
    tracked: int
    drops: dict[Drop, int]
    rate_hz: float
    latency_p50_ms: float
    latency_p95_ms: float

    def values(self) -> dict[str, str]:
        """Name and value of every count, for diagnostics; ``parse`` reads them back."""
        return {
            "state": self.state.value,
            "frames": str(self.frames),
            "tracked": str(self.tracked),
            **{f"dropped_{drop.name.lower()}": str(n) for drop, n in self.drops.items()},
            "rate_hz": f"{self.rate_hz:.3f}",
            "latency_p50_ms": f"{self.latency_p50_ms:.3f}",
            "latency_p95_ms": f"{self.latency_p95_ms:.3f}",
        }

    @staticmethod
    def parse(values: Mapping[str, str]) -> Summary:
        """Reads a summary from its ``values``; others are ignored."""
        return Summary(
            TrackingState(values["state"]),
            int(values["frames"]),
            int(values["tracked"]),
            {drop: int(values[f"dropped_{drop.name.lower()}"]) for drop in Drop},
            float(values["rate_hz"]),
            float(values["latency_p50_ms"]),
            float(values["latency_p95_ms"]),
        )

    def __str__(self) -> str:
        drops = ", ".join(f"{n} because {drop.value}" for drop, n in self.drops.items() if n)
        latency = (
            f", latency p50 {self.latency_p50_ms:.0f} ms, p95 {self.latency_p95_ms:.0f} ms"
            if self.frames
            else ""
        )
        return f"{self.frames} frames, {self.tracked} tracked{latency}; dropped {drops or 'none'}"


class FrameCounts:
    """Counts frames; not thread-safe.

    Attributes:
        state: tracking state after the last frame.
    """

    def __init__(self) -> None:
        """Begins before the first frame."""
        self.state = TrackingState.INITIALIZING
        self._frames = self._tracked = 0
        self._drops: Counter[Drop] = Counter()
        self._latencies_ns: deque[int] = deque(maxlen=LATENCY_WINDOW)
        self._published_ns: deque[int] = deque(maxlen=LATENCY_WINDOW)

    def processed(self, estimate: OdometryEstimate, arrived_ns: int, published_ns: int) -> None:
        """As ``Monitor.processed``."""
        self.state = estimate.state
        self._frames += 1
        self._tracked += estimate.T_odom_camera is not None
        self._latencies_ns.append(published_ns - arrived_ns)
        self._published_ns.append(published_ns)

    def dropped(self, reason: Drop) -> None:
        """Counts a frame without an estimate."""
        self._drops[reason] += 1

    def summary(self, now_ns: int) -> Summary:
        """The counts at ``now_ns``."""
        latencies = np.array(self._latencies_ns or [np.nan]) / 1e6
        p50, p95 = np.percentile(latencies, [50, 95])
        recent = [t for t in self._published_ns if t > now_ns - RATE_WINDOW_NS]
        return Summary(
            self.state,
            self._frames,
            self._tracked,
            {reason: self._drops[reason] for reason in Drop},
            len(recent) * NANOSECONDS / RATE_WINDOW_NS,
            float(p50),
            float(p95),
        )
