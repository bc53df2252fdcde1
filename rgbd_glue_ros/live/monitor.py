"""State of a live odometry: counts, rate, latency and faults."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from rgbd_glue_ros.live.blind_restarts import BlindRestarts
from rgbd_glue_ros.live.evidence_values import evidence_values, imu_values
from rgbd_glue_ros.live.frame_counts import Drop, FrameCounts, Summary
from rgbd_glue_ros.live.load import Load, LoadCount
from rgbd_glue_ros.live.refusals import Refusals
from rgbd_glue_ros.live.unseen_motion import UnseenMotion
from rgbd_glue_ros.messages.fault_news import FaultNews
from rgbd_glue_ros.types import (
    NANOSECONDS,
    ImuCalibration,
    OdometryEstimate,
    TrackingState,
)

# Seconds without a pose after which it is overdue.
NO_POSE_S = 2.0


class Monitor:
    """Counts processed and dropped frames; thread-safe.

    Attributes:
        is_paused: whether frames are skipped until the user resumes.
        preparing: what keeps the node from subscribing yet; "" once it has.
        width: width of the last frame's colour image, pixels; 0 before the first.
        guess_fault: why frames are tracked without the guess that was asked for; "" if they are
            not.
        waited_ns: how long frames waited for TF so far, nanoseconds.
        waited_for: the transform that the last of them waited for; "" before the first.
        restarts: of the odometry at the last pose.
        unseen_motion: how far the pose is off by motion that images did not show.
    """

    def __init__(self, clock: Callable[[], int] = time.monotonic_ns) -> None:
        """Starts to count.

        Args:
            clock: a monotonic clock, nanoseconds; all times passed to the methods are of it.
        """
        self.is_paused = False
        self.width = 0
        self.preparing = self.guess_fault = self.waited_for = ""
        self.waited_ns = 0
        self.restarts, self.unseen_motion = BlindRestarts(), UnseenMotion()
        self._lock = threading.Lock()
        now_ns = clock()
        self._counts, self._load, self._refusals = FrameCounts(), LoadCount(), Refusals(now_ns)
        self._faults = FaultNews(clock)
        self._evidence: dict[str, str] = {}
        self._imu: ImuCalibration | None = None
        self._last_pose_ns = now_ns
        self._why_no_pose = ""

    def processed(
        self, estimate: OdometryEstimate, arrived_ns: int, published_ns: int, why_no_pose: str = ""
    ) -> None:
        """Records an estimate, which was published if it has a pose.

        Args:
            estimate: the estimate of a frame.
            arrived_ns: when the frame's last message arrived.
            published_ns: when its pose was published.
            why_no_pose: why it has no pose, as text; "" if it has one.
        """
        with self._lock:
            self._why_no_pose = why_no_pose
            self.restarts.take(estimate)
            self.unseen_motion.take(estimate)
            self._counts.processed(estimate, arrived_ns, published_ns)
            self._load.processed(estimate.state)
            self._refusals.processed(published_ns)
            self._evidence |= evidence_values(estimate)
            if estimate.T_odom_camera is not None:
                self._last_pose_ns = published_ns

    @property
    def load(self) -> Load:
        """Frames that were processed and left out, but for a search for a lost camera."""
        with self._lock:
            return self._load.load

    def start_anew(self) -> None:
        """Forgets what no longer holds after a reset of the odometry."""
        with self._lock:
            self.restarts, self.unseen_motion = BlindRestarts(), UnseenMotion()

    def learnt(self, imu: ImuCalibration) -> None:
        """Records the current calibration of the IMU."""
        with self._lock:
            self._imu = imu

    def waited(self, transform: str, duration_ns: int) -> None:
        """Records that a frame waited for a transform on TF, nanoseconds."""
        with self._lock:
            self.waited_for = transform
            self.waited_ns += duration_ns

    def dropped(self, reason: Drop, error: str = "") -> None:
        """Records a frame without an estimate, and the error that caused this; "" if none did."""
        with self._lock:
            self._counts.dropped(reason)
            self._refusals.dropped(reason, error)
            if reason is Drop.SUPERSEDED:
                self._load.left_out()

    def is_news(self, where: str, cause: str) -> bool:
        """As ``FaultNews.is_news``."""
        return self._faults.is_news(where, cause)

    def values(self, now_ns: int) -> dict[str, str]:
        """Name and value of everything, for diagnostics."""
        summary = self.summary(now_ns).values()
        with self._lock:
            return {
                **summary,
                "without_pose_s": f"{self.without_pose_ns(now_ns) / NANOSECONDS:.3f}",
                "why_no_pose": self._why_no_pose,
                **self.restarts.values(),
                **self._evidence,
                **imu_values(self._imu),
                "last_error": self._faults.last,
            }

    def why_refused(self, now_ns: int) -> str:
        """Why arriving frames are not processed; "" while they are."""
        with self._lock:
            return self._refusals.why(now_ns)

    def is_overdue(self, now_ns: int) -> bool:
        """Whether the last pose is more than ``NO_POSE_S`` old."""
        return self.without_pose_ns(now_ns) > NO_POSE_S * NANOSECONDS

    def without_pose_ns(self, now_ns: int) -> int:
        """Time since the last pose; before the first one, since counting began."""
        return max(now_ns - self._last_pose_ns, 0)

    @property
    def why_no_pose(self) -> str:
        """Why the last frame had no pose; "" if it had one."""
        return self._why_no_pose

    @property
    def last_error(self) -> str:
        """The last fault, new or not; "" before the first."""
        return self._faults.last

    @property
    def state(self) -> TrackingState:
        """Tracking state after the last frame."""
        return self._counts.state

    def summary(self, now_ns: int) -> Summary:
        """The counts at ``now_ns``."""
        with self._lock:
            return self._counts.summary(now_ns)
