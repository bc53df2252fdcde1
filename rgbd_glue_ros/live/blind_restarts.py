"""Restarts at the last pose, of a camera that was not recognised: how far its pose may be off."""

from __future__ import annotations

from rgbd_glue_ros.geometry.se3 import largest_sigmas
from rgbd_glue_ros.types import NANOSECONDS, OdometryEstimate

# A pose is that of the restart still if its standard deviation has at least this share of the
# restart's; at a place that was known before, it is a small fraction.
_STILL_OFF = 0.5


class BlindRestarts:
    """What follows from the restarts since the odometry started; not thread-safe.

    Attributes:
        count: how many there were.
        doubt: that the pose may be off by as much as it may have moved unseen; "" if it may not, or
            no longer.
    """

    def __init__(self) -> None:
        """Begins before the first frame."""
        self.count = 0
        self.doubt = ""
        self._has_started = False
        self._sigma_at_restart_m = 0.0
        self._sigmas: tuple[float, float] | None = None

    def take(self, estimate: OdometryEstimate) -> None:
        """Takes the next estimate."""
        if estimate.T_odom_camera is None or estimate.covariance is None:
            return
        self._sigmas = position_m, rotation_rad = largest_sigmas(estimate.covariance)
        if estimate.is_start and self._has_started:
            self.count += 1
            self._sigma_at_restart_m = position_m
            self.doubt = (
                f"not recognised at {estimate.stamp_ns / NANOSECONDS:.3f}: restarted at the last "
                f"pose, which may be {position_m:.1f} m and {rotation_rad:.1f} rad off"
            )
        elif position_m < _STILL_OFF * self._sigma_at_restart_m:
            self.doubt = ""
        self._has_started = True

    def values(self) -> dict[str, str]:
        """Name and value of everything, for diagnostics."""
        position, rotation = self._sigmas or (float("nan"), float("nan"))
        return {
            "blind_restarts": str(self.count),
            "position_sigma_m": f"{position:.5f}",
            "rotation_sigma_rad": f"{rotation:.5f}",
        }
