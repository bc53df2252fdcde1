"""What is known of an odometry from its topics, in one line."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rgbd_glue_ros.live.frame_counts import Summary
from rgbd_glue_ros.live.monitor import NO_POSE_S
from rgbd_glue_ros.live.watched_poses import ReceivedPose, WatchedPoses
from rgbd_glue_ros.types import NANOSECONDS, TrackingState

# The node says its state once a second.
_REPORT_NS = 3 * NANOSECONDS


@dataclass(frozen=True)
class Report:
    """What the node says of itself on /diagnostics.

    Attributes:
        summary: its counts.
        reason: what is wrong; "" if nothing is.
        gets_nothing: whether that is that no frame arrives.
        arrived_ns: when that arrived, by the monotonic clock.
    """

    summary: Summary
    reason: str
    gets_nothing: bool
    arrived_ns: int

    @staticmethod
    def parse(
        message: str, values: Mapping[str, str], arrived_ns: int, *, is_stale: bool = False
    ) -> Report | None:
        """Reads a status of /diagnostics; None if it is not that of this package's odometry.

        Args:
            message: its text.
            values: its values by name.
            arrived_ns: when it arrived, by the monotonic clock.
            is_stale: whether its level is STALE.
        """
        try:
            summary = Summary.parse(values)
        except (KeyError, ValueError):
            return None
        state = summary.state.value
        reason = "" if message == state else message.removeprefix(f"{state}: ")
        return Report(summary, reason, is_stale, arrived_ns)


class WatchedOdometry:
    """An odometry that may not be there yet, and may end and begin anew.

    Attributes:
        poses: of its present run.
        count: number of poses, of all runs.
        silence: why no pose arrives, as far as another program can tell; "" if it cannot, or one
            does.
        doubt: what is wrong with poses that arrive; "" if nothing is.
    """

    def __init__(self) -> None:
        """Begins before anything has arrived."""
        self.poses = WatchedPoses()
        self.count = 0
        self.silence = self.doubt = ""
        self._report: Report | None = None
        self._last: tuple[int, int | None] | None = None

    def follows(self, stamp_ns: int, sequence: int | None) -> bool:
        """Whether a message is of the same run as the one before; to be called with each.

        Args:
            stamp_ns: its stamp, nanoseconds.
            sequence: its number among those of its publisher; None if the middleware gives none.
        """
        before, self._last = self._last, (stamp_ns, sequence)
        if before is None or not _is_back(before, self._last):
            return True
        self.poses, self._report = WatchedPoses(), None
        return False

    def take_pose(self, pose: ReceivedPose) -> None:
        """Takes a pose of the present run."""
        self.poses.add(pose)
        self.count += 1
        self.silence = ""

    def take_report(self, report: Report) -> None:
        """Takes what the node says of itself."""
        self._report = report

    def reason(self, now_ns: int) -> str:
        """What is wrong, by the monotonic clock; "" if nothing is known to be."""
        report = self._recent_report(now_ns)
        if report is None:
            return self.doubt or self.silence
        is_outdated = self._is_tracking(now_ns) and (
            report.gets_nothing or report.summary.state is not TrackingState.TRACKING
        )
        # the node knows best, and says why nothing arrives from five seconds after it is ready
        is_early = report.summary.state is TrackingState.INITIALIZING
        said = "" if is_outdated else report.reason
        return said or self.doubt or ("" if is_early else self.silence)

    def line(self, now_ns: int) -> str:
        """State and pose, by the monotonic clock."""
        last, report = self.poses.last, self._recent_report(now_ns)
        if last is None:
            return f"no pose yet, {report.summary.state.value}" if report else "no pose yet"
        # no -0.000
        x, y, z = np.round(last.T_odom_child[:3, 3], 3) + 0.0
        at = f"x {x:.3f} y {y:.3f} z {z:.3f} m"
        if self._is_tracking(now_ns):
            words = [TrackingState.TRACKING.value, *self._timing(now_ns), at]
        else:
            is_lost = report is not None and report.summary.state is TrackingState.LOST
            seconds = (now_ns - last.arrived_ns) / NANOSECONDS
            words = [f"{'lost' if is_lost else 'no pose'} for {seconds:.0f} s", f"last at {at}"]
        turn = math.degrees(self.poses.turn_rad)
        return ", ".join([*words, f"path {self.poses.path_m:.1f} m", f"turn {turn:.0f}°"])

    def _recent_report(self, now_ns: int) -> Report | None:
        """What the node has said lately; None if it is silent."""
        report = self._report
        is_recent = report is not None and now_ns - report.arrived_ns < _REPORT_NS
        return report if is_recent else None

    def _is_tracking(self, now_ns: int) -> bool:
        """Whether poses arrive, and the node has not said since that there is none."""
        last, report = self.poses.last, self._report
        if last is None or now_ns - last.arrived_ns > NO_POSE_S * NANOSECONDS:
            return False
        if report is None or report.arrived_ns < last.arrived_ns:
            return True
        return report.summary.state is not TrackingState.LOST

    def _timing(self, now_ns: int) -> list[str]:
        """Rate and latency; the node's own latency where stamps are of another clock."""
        rate, latency = self.poses.rate_hz(now_ns), self.poses.latency_ms(now_ns)
        words = [] if rate is None else [f"{rate:.1f} Hz"]
        if latency is not None:
            words.append(f"latency {latency:.0f} ms")
        elif self._report is not None and math.isfinite(self._report.summary.latency_p50_ms):
            words.append(f"node latency {self._report.summary.latency_p50_ms:.0f} ms")
        return words


def _is_back(before: tuple[int, int | None], now: tuple[int, int | None]) -> bool:
    """Whether a message, by stamp and number, cannot follow another of the same publisher."""
    if now[0] < before[0]:
        return True
    return now[1] is not None and before[1] is not None and now[1] <= before[1]
