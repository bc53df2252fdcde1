"""What a live odometry tells of itself: counts and latency."""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np

from rgbd_glue_ros.messages.fault_news import FaultNews
from rgbd_glue_ros.types import (
    NANOSECONDS,
    ImuCalibration,
    ImuUse,
    OdometryEstimate,
    RegistrationResult,
    TrackingState,
)

# Frames that the latency is taken over: the last half minute.
LATENCY_WINDOW = 1000
RATE_WINDOW_NS = 5 * NANOSECONDS
# Seconds without a pose after which a dropped last frame is told as what is wrong with the node.
NO_POSE_S = 2.0


class Drop(Enum):
    """Why a frame, complete with colour, depth and camera info, got no estimate."""

    SUPERSEDED = "a newer frame came while the odometry was busy"
    TOO_SOON = "it came sooner than max_update_rate allows"
    PAUSED = "the odometry was paused"
    UNPLACED = "where the camera is on the robot was not known yet"
    UNUSABLE = "a message could not be used"
    FAILED = "an error inside"


WISHED = {Drop.PAUSED, Drop.TOO_SOON}
"""Reasons that somebody asked for."""


@dataclass(frozen=True)
class Summary:
    """The counts at one moment.

    Attributes:
        state: tracking state after the last frame.
        frames: frames with an estimate.
        tracked: frames with an estimate that holds a pose.
        drops: frames without an estimate, by reason.
        rate_hz: estimates per second, lately.
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
        """Name and value of every count, as diagnostics want them; ``parse`` reads them back."""
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
        """The summary that has these ``values``, which may hold others as well."""
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


class Monitor:
    """Counts what becomes of frames. Any thread may call it.

    Attributes:
        is_paused: whether frames are left out until somebody says otherwise.
        width: of the last frame's colour image, pixels; 0 before the first.
    """

    def __init__(self, clock: Callable[[], int] = time.monotonic_ns) -> None:
        """Begins to count.

        Args:
            clock: tells the time in nanoseconds and never goes back; all times given are by it.
        """
        self.is_paused = False
        self.width = 0
        self._lock = threading.Lock()
        self._state = TrackingState.INITIALIZING
        self._frames = self._tracked = 0
        self._drops: Counter[Drop] = Counter()
        self._faults = FaultNews(clock)
        self._latencies_ns: deque[int] = deque(maxlen=LATENCY_WINDOW)
        self._published_ns: deque[int] = deque(maxlen=LATENCY_WINDOW)
        self._evidence: dict[str, str] = {}
        self._imu: ImuCalibration | None = None
        self._last_pose_ns = clock()
        self._refused: Drop | None = None
        self._why_no_pose = ""

    def processed(
        self, estimate: OdometryEstimate, arrived_ns: int, published_ns: int, why_no_pose: str = ""
    ) -> None:
        """A frame got an estimate, which was published if it holds a pose.

        Args:
            estimate: of the frame.
            arrived_ns: when its last message came.
            published_ns: when its pose was published.
            why_no_pose: in words; "" if it has one.
        """
        with self._lock:
            self._why_no_pose = why_no_pose
            if estimate.depth is not None:
                self._evidence |= {
                    "depth_known": f"{estimate.depth.known:.3f}",
                    "depth_in_range": f"{estimate.depth.in_range:.3f}",
                    "depth_median_m": f"{estimate.depth.median_m:.3f}",
                }
            self._state = estimate.state
            self._frames += 1
            self._tracked += estimate.T_odom_camera is not None
            self._refused = None
            if estimate.T_odom_camera is not None:
                self._last_pose_ns = published_ns
            self._latencies_ns.append(published_ns - arrived_ns)
            self._published_ns.append(published_ns)
            if estimate.registration is not None:
                self._evidence |= _evidence(estimate.registration)

    def learnt(self, imu: ImuCalibration) -> None:
        """Takes in what is known of the IMU now."""
        with self._lock:
            self._imu = imu

    def dropped(self, reason: Drop) -> None:
        """A frame got no estimate."""
        with self._lock:
            self._drops[reason] += 1
            if reason not in WISHED:
                self._refused = reason

    def is_news(self, where: str, cause: str) -> bool:
        """As of ``FaultNews``."""
        return self._faults.is_news(where, cause)

    def values(self, now_ns: int) -> dict[str, str]:
        """Name and value of all there is to tell, as diagnostics want them."""
        summary = self.summary(now_ns).values()
        with self._lock:
            return {
                **summary,
                "without_pose_s": f"{self._without_pose_ns(now_ns) / NANOSECONDS:.3f}",
                "why_no_pose": self._why_no_pose,
                **self._evidence,
                **_imu_values(self._imu),
                "last_error": self._faults.last,
            }

    def why_refused(self, now_ns: int) -> str:
        """Why the frames that come are not processed; "" while they are."""
        with self._lock:
            refused, seconds = self._refused, self._without_pose_ns(now_ns) / NANOSECONDS
            if refused is None or seconds < NO_POSE_S:
                return ""
            error = f": {self._faults.last}" if refused in {Drop.UNUSABLE, Drop.FAILED} else ""
            return f"no pose for {seconds:.0f} s, since {refused.value}{error}"

    def is_overdue(self, now_ns: int) -> bool:
        """Whether the last pose is older than that of a camera that is tracked."""
        return self._without_pose_ns(now_ns) > NO_POSE_S * NANOSECONDS

    def _without_pose_ns(self, now_ns: int) -> int:
        """Time since the last pose; before the first, since counting began."""
        return max(now_ns - self._last_pose_ns, 0)

    @property
    def why_no_pose(self) -> str:
        """Why the last frame had no pose; "" if it had one."""
        return self._why_no_pose

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
    """Numbers to a part in a million of their unit, several with blanks between."""
    if isinstance(value, str):
        return value
    return " ".join(f"{number:.6f}" for number in np.atleast_1d(value))


def _evidence(result: RegistrationResult) -> dict[str, str]:
    """What the last pose rests on, or why there was none."""
    return {
        "registration": result.status.value,
        "visual_matches": str(len(result.visual)),
        "visual_inliers": str(len(result.visual_inliers)),
        "geometric_matches": str(len(result.geometric)),
        "credible_matches": str(len(result.credible)),
        "sigma_m": f"{result.sigma_m:.5f}",
        "epsilon_m": f"{result.epsilon_m:.5f}",
    }
