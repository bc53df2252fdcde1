"""State of a live odometry: counts, rate, latency and faults."""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np

from rgbd_glue_ros.live.blind_restarts import BlindRestarts
from rgbd_glue_ros.live.unseen_motion import UnseenMotion
from rgbd_glue_ros.messages.fault_news import FaultNews
from rgbd_glue_ros.types import (
    NANOSECONDS,
    ImuCalibration,
    ImuUse,
    OdometryEstimate,
    RegistrationResult,
    TrackingState,
)

# Frames that latency percentiles are computed from: the last half minute.
LATENCY_WINDOW = 1000
RATE_WINDOW_NS = 5 * NANOSECONDS
# Seconds without a pose after which it is overdue, and seconds without an estimate after which the
# last drop is reported as the node's fault.
NO_POSE_S = 2.0


class Drop(Enum):
    """Why a complete frame (colour, depth and camera info) got no estimate."""

    SUPERSEDED = "a newer frame came while the odometry was busy"
    TOO_SOON = "it came sooner than max_update_rate allows"
    PAUSED = "the odometry was paused"
    UNPLACED = "the camera's pose on the robot was not known yet"
    UNUSABLE = "a message could not be used"
    FAILED = "of an internal error"


WISHED = {Drop.PAUSED, Drop.TOO_SOON}
"""Reasons that the user has asked for."""


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


@dataclass(frozen=True)
class Load:
    """How many frames this machine keeps up with.

    A search for a lost camera is left out of both: a frame of it takes several times as long.

    Attributes:
        processed: frames with an estimate.
        left_out: frames that a newer one replaced while those were processed.
    """

    processed: int = 0
    left_out: int = 0


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
        self._state = TrackingState.INITIALIZING
        self._frames = self._tracked = 0
        self._drops: Counter[Drop] = Counter()
        self._load = Load()
        self._replaced_before = 0
        self._faults = FaultNews(clock)
        self._latencies_ns: deque[int] = deque(maxlen=LATENCY_WINDOW)
        self._published_ns: deque[int] = deque(maxlen=LATENCY_WINDOW)
        self._evidence: dict[str, str] = {}
        self._imu: ImuCalibration | None = None
        self._last_estimate_ns = self._last_pose_ns = clock()
        self._refused = ""
        self._is_unplaced = False
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
            self._count_load(estimate)
            if estimate.depth is not None:
                self._evidence |= {
                    "depth_known": f"{estimate.depth.known:.3f}",
                    "depth_in_range": f"{estimate.depth.in_range:.3f}",
                    "depth_median_m": f"{estimate.depth.median_m:.3f}",
                }
            self._state = estimate.state
            self._frames += 1
            self._tracked += estimate.T_odom_camera is not None
            self._refused, self._is_unplaced = "", False
            self._last_estimate_ns = published_ns
            if estimate.T_odom_camera is not None:
                self._last_pose_ns = published_ns
            self._latencies_ns.append(published_ns - arrived_ns)
            self._published_ns.append(published_ns)
            if estimate.registration is not None:
                self._evidence |= _evidence(estimate.registration)

    def _count_load(self, estimate: OdometryEstimate) -> None:
        replaced = self._drops[Drop.SUPERSEDED] - self._replaced_before
        self._replaced_before += replaced
        if TrackingState.LOST not in (self._state, estimate.state):
            self._load = Load(self._load.processed + 1, self._load.left_out + replaced)

    @property
    def load(self) -> Load:
        """Frames that were processed and left out, but for a search for a lost camera."""
        with self._lock:
            if self._state is not TrackingState.INITIALIZING:
                return self._load
            # the first frame may take for ever
            replaced = self._drops[Drop.SUPERSEDED] - self._replaced_before
            return Load(self._load.processed, self._load.left_out + replaced)

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
            self._drops[reason] += 1
            # while the camera's pose is awaited, frames are left out because of this wait
            is_effect = reason is Drop.SUPERSEDED and self._is_unplaced
            self._is_unplaced = is_effect or reason is Drop.UNPLACED
            if reason not in WISHED and not is_effect:
                self._refused = f"{reason.value}: {error}" if error else reason.value

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
                **_imu_values(self._imu),
                "last_error": self._faults.last,
            }

    def why_refused(self, now_ns: int) -> str:
        """Why arriving frames are not processed; "" while they are."""
        with self._lock:
            # not since the last pose: a lost camera has none, although its frames are processed
            seconds = (now_ns - self._last_estimate_ns) / NANOSECONDS
            if not self._refused or seconds < NO_POSE_S:
                return ""
            return f"no frame was processed for {seconds:.0f} s, because {self._refused}"

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
        return self._state

    def summary(self, now_ns: int) -> Summary:
        """The counts at ``now_ns``."""
        with self._lock:
            latencies = np.array(self._latencies_ns or [np.nan]) / 1e6
            p50, p95 = np.percentile(latencies, [50, 95])
            recent = [t for t in self._published_ns if t > now_ns - RATE_WINDOW_NS]
            return Summary(
                self._state,
                self._frames,
                self._tracked,
                {reason: self._drops[reason] for reason in Drop},
                len(recent) * NANOSECONDS / RATE_WINDOW_NS,
                float(p50),
                float(p95),
            )


def _imu_values(imu: ImuCalibration | None) -> dict[str, str]:
    if imu is None:
        return {}
    if imu.use is ImuUse.NONE:
        return {"imu_use": imu.use.value}
    return {f"imu_{name}": _rounded(value) for name, value in imu.values().items()}


def _rounded(value: str | float | list[float]) -> str:
    """Numbers with six decimals, separated by blanks."""
    if isinstance(value, str):
        return value
    return " ".join(f"{number:.6f}" for number in np.atleast_1d(value))


def _evidence(result: RegistrationResult) -> dict[str, str]:
    """The matches behind the last pose, and the status of its registration."""
    return {
        "registration": result.status.value,
        "visual_matches": str(len(result.visual)),
        "visual_inliers": str(len(result.visual_inliers)),
        "geometric_matches": str(len(result.geometric)),
        "credible_matches": str(len(result.credible)),
        "sigma_m": f"{result.sigma_m:.5f}",
        "epsilon_m": f"{result.epsilon_m:.5f}",
    }
