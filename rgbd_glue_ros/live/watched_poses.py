"""The poses of an odometry as another program receives them: their rate, latency and path."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.types import NANOSECONDS, Float64

# What rate and latency are of.
WINDOW_NS = 2 * NANOSECONDS
# Motion is counted in steps of this length, so that noise adds nothing to the path of a camera at
# rest.
STEP_M = 0.01
# What moves faster between two poses did not move: the odometry was reset.
_FASTEST_M_S = 20.0
# A stamp that is farther from now is of another clock, as that of a recording.
_OTHER_CLOCK_NS = 10 * NANOSECONDS


@dataclass(frozen=True)
class ReceivedPose:
    """A pose, and when it was received.

    Attributes:
        stamp_ns: its stamp, nanoseconds.
        T_odom_child: the pose [4, 4].
        arrived_ns: when it arrived, by the monotonic clock.
        latency_ns: from its stamp to its arrival, by the clock of the stamps.
    """

    stamp_ns: int
    T_odom_child: Float64
    arrived_ns: int
    latency_ns: int


class WatchedPoses:
    """The poses of one run of an odometry; a new run is another object.

    Attributes:
        first: the first pose; None before it.
        last: the last pose; None before the first.
        path_m: length of the path, metres.
    """

    def __init__(self) -> None:
        """Begins before the first pose."""
        self.first: ReceivedPose | None = None
        self.last: ReceivedPose | None = None
        self.path_m = 0.0
        self._counted_to = np.zeros(3)
        self._recent: deque[ReceivedPose] = deque()

    def add(self, pose: ReceivedPose) -> None:
        """Takes the next pose."""
        position = pose.T_odom_child[:3, 3]
        if self.last is None:
            self.first = pose
            self._counted_to = position
        else:
            self._count(position, self.last, (pose.stamp_ns - self.last.stamp_ns) / NANOSECONDS)
        self.last = pose
        self._recent.append(pose)

    def _count(self, position: Float64, last: ReceivedPose, seconds: float) -> None:
        step = float(np.linalg.norm(position - last.T_odom_child[:3, 3]))
        moved = float(np.linalg.norm(position - self._counted_to))
        if step > _FASTEST_M_S * max(seconds, 0.0):
            self._counted_to = position
        elif moved >= STEP_M:
            self.path_m += moved
            self._counted_to = position

    @property
    def turn_rad(self) -> float:
        """The angle between the first and the last orientation, radians; 0 before the first."""
        if self.first is None or self.last is None:
            return 0.0
        return se3.rotation_angle(se3.inverse(self.first.T_odom_child) @ self.last.T_odom_child)

    def rate_hz(self, now_ns: int) -> float | None:
        """Poses per second, lately; None with fewer than two."""
        arrived = [pose.arrived_ns for pose in self._window(now_ns)]
        if len(arrived) < 2 or arrived[-1] == arrived[0]:
            return None
        return (len(arrived) - 1) * NANOSECONDS / (arrived[-1] - arrived[0])

    def latency_ms(self, now_ns: int) -> float | None:
        """Median time from stamp to arrival, lately; None if the stamps are of another clock."""
        latencies = [pose.latency_ns for pose in self._window(now_ns)]
        if not latencies or abs(median := float(np.median(latencies))) > _OTHER_CLOCK_NS:
            return None
        return median / 1e6

    def _window(self, now_ns: int) -> deque[ReceivedPose]:
        while self._recent and self._recent[0].arrived_ns < now_ns - WINDOW_NS:
            self._recent.popleft()
        return self._recent
