"""Motion that the images do not show, as along a bare wall: how far the pose may be off."""

from __future__ import annotations

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.pose_covariance import UNKNOWN
from rgbd_glue_ros.types import NANOSECONDS, OdometryEstimate

# The pose is known again when its standard deviation has fallen to this share of the largest.
_KNOWN_AGAIN = 0.5


class UnseenMotion:
    """What follows from the covariances of the poses; not thread-safe.

    Attributes:
        since_ns: stamp of the frame from which on motion was not seen; None while it is.
        doubt: how far the pose may be off; "" while motion is seen.
    """

    def __init__(self) -> None:
        """Begins before the first frame."""
        self.since_ns: int | None = None
        self.doubt = ""
        self._largest_m = 0.0

    def take(self, estimate: OdometryEstimate) -> None:
        """Takes the next estimate."""
        from_keyframe_m = sigma_from_keyframe(estimate)
        if from_keyframe_m is None or estimate.covariance is None:
            return
        if self.since_ns is None and from_keyframe_m < UNKNOWN:
            return
        in_odom_m, _ = se3.largest_sigmas(estimate.covariance)
        if self.since_ns is None:
            self.since_ns, self._largest_m = estimate.stamp_ns, 0.0
        elif in_odom_m < _KNOWN_AGAIN * self._largest_m:
            self.since_ns, self.doubt = None, ""
            return
        self._largest_m = max(self._largest_m, in_odom_m)
        self.doubt = (
            f"since {self.since_ns / NANOSECONDS:.3f} the images have not shown all of the motion, "
            f"as at a bare wall: the pose may be {in_odom_m:.1f} m off; with guess_frame_id it "
            "follows wheels there"
        )


def sigma_from_keyframe(estimate: OdometryEstimate) -> float | None:
    """The standard deviation of the camera's position given that of its keyframe, metres.

    Along the most uncertain direction; None where the covariance is not known.
    """
    T, covariance = estimate.T_odom_camera, estimate.covariance_from_keyframe
    if T is None or covariance is None:
        return None
    return se3.largest_sigmas(se3.pose_covariance(T, covariance))[0]
