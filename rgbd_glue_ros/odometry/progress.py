"""The state of tracking: what one frame passes to the next."""

from __future__ import annotations

from dataclasses import dataclass, replace

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.alternative import Alternative
from rgbd_glue_ros.odometry.motion_filter import MEMORY_S, Motion, PredictedMotion
from rgbd_glue_ros.odometry.repeated_images import SOON_NS, is_at_rest, show_the_same
from rgbd_glue_ros.parameters import OdometryConfig
from rgbd_glue_ros.types import NANOSECONDS, Float64, OdometryEstimate, TrackingState, View

# Frames are missing before one whose interval is this many times the previous interval,
_GAP_INTERVALS = 3
# and so long that the motion before says nothing any more.
_GAP_NS = int(MEMORY_S * NANOSECONDS)


@dataclass(frozen=True)
class LastPose:
    """The last frame with a pose.

    Attributes:
        motion: at that frame.
        view: of that frame.
        estimate: the result for that frame.
        alternative: to its pose, if a part of the view contradicted it.
        T_guess_camera: the pose by another odometry at that frame, float64 [4, 4], if any.
    """

    motion: Motion
    view: View
    estimate: OdometryEstimate
    alternative: Alternative | None = None
    T_guess_camera: Float64 | None = None


@dataclass(frozen=True)
class Progress:
    """The state of tracking; replaced as a whole, never changed.

    Attributes:
        state: after the last frame.
        last: the last frame with a pose; None before the first.
        last_stamp_ns: of the last frame; None before the first.
        T_guess_camera: the pose by another odometry at the last frame, float64 [4, 4], if any.
        last_interval_ns: from the frame before it to the last one; None before the second.
        is_after_gap: whether the last frame came so much later than usual that the motion before
            it says little of where the camera is.
        frames_missed: frames that showed something and had no pose, since the last pose.
    """

    state: TrackingState = TrackingState.INITIALIZING
    last: LastPose | None = None
    last_stamp_ns: int | None = None
    T_guess_camera: Float64 | None = None
    last_interval_ns: int | None = None
    is_after_gap: bool = False
    frames_missed: int = 0

    def with_miss(self, *, shows_enough: bool) -> Progress:
        """The state after a frame without a pose; whether it showed enough for one."""
        missed = self.frames_missed + shows_enough
        return replace(self, state=TrackingState.LOST, frames_missed=missed)

    def needs_restart(self, stamp_ns: int, config: OdometryConfig) -> bool:
        """Whether there has been no pose for so long that the frame at a stamp should restart."""
        if self.last is None or config.reset_countdown == 0:
            return False
        seconds = (stamp_ns - self.last.motion.stamp_ns) / NANOSECONDS
        return self.frames_missed >= config.reset_countdown and seconds >= config.reset_delay

    def with_frame(self, stamp_ns: int, T_guess_camera: Float64 | None) -> Progress:
        """The state after a frame has arrived.

        Args:
            stamp_ns: of the frame.
            T_guess_camera: float64 [4, 4], the pose by another odometry at that frame, if any.

        Raises:
            InputError: the frame is not later than the previous one.
        """
        if self.last_stamp_ns is not None and stamp_ns <= self.last_stamp_ns:
            raise InputError(
                f"frame at {stamp_ns} ns",
                f"not later than the frame before, at {self.last_stamp_ns} ns",
                "skip it, or call reset() when time restarts",
            )
        if self.last_stamp_ns is None:
            return replace(self, last_stamp_ns=stamp_ns, T_guess_camera=T_guess_camera)
        interval_ns = stamp_ns - self.last_stamp_ns
        usual_ns = self.last_interval_ns or 0
        return replace(
            self,
            last_stamp_ns=stamp_ns,
            T_guess_camera=T_guess_camera,
            last_interval_ns=interval_ns,
            is_after_gap=interval_ns > max(_GAP_INTERVALS * usual_ns, _GAP_NS),
        )

    def guided(self, predicted: PredictedMotion) -> PredictedMotion:
        """A motion predicted from the last pose, to where another odometry has moved since then.

        Without its pose at both frames the prediction remains.
        """
        if self.last is None or self.last.T_guess_camera is None or self.T_guess_camera is None:
            return predicted
        T_last_camera = se3.inverse(self.last.T_guess_camera) @ self.T_guess_camera
        return predicted.along(T_last_camera, self.last.motion)

    def repeated(self, stamp_ns: int, view: View) -> OdometryEstimate | None:
        """The estimate for a frame that repeats the last one; None if it does not.

        Some drivers send every image twice. The second says nothing about the time in between, and
        would look like a camera that stopped; if the camera is at rest, it may be a new image.
        """
        last = self.last
        if self.state is not TrackingState.TRACKING or last is None:
            return None
        is_soon = stamp_ns - last.motion.stamp_ns <= SOON_NS
        if not is_soon or is_at_rest(last.motion.twist) or not show_the_same(view, last.view):
            return None
        return replace(last.estimate, stamp_ns=stamp_ns, is_keyframe=False)

    def with_pose(
        self,
        motion: Motion,
        view: View,
        estimate: OdometryEstimate,
        alternative: Alternative | None = None,
    ) -> Progress:
        """The state after the last frame got a pose; of the arguments, see ``LastPose``."""
        last = LastPose(motion, view, estimate, alternative, self.T_guess_camera)
        return replace(self, state=TrackingState.TRACKING, last=last, frames_missed=0)

    def at_own_keyframe(self) -> Progress:
        """The state after the last frame has become a keyframe that others are compared with."""
        if self.last is None:
            return self
        return replace(self, last=replace(self.last, motion=self.last.motion.at_own_keyframe()))
