"""How far tracking has come: what one frame leaves for the next."""

from __future__ import annotations

from dataclasses import dataclass, replace

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.odometry.contradiction import Alternative
from rgbd_glue_ros.odometry.motion_filter import Motion
from rgbd_glue_ros.types import Float64, TrackingState, View


@dataclass(frozen=True)
class LastPose:
    """The last frame with a pose.

    Attributes:
        motion: at that frame.
        view: of it.
        alternative: to its pose, if a part of it contradicted.
    """

    motion: Motion
    view: View
    alternative: Alternative | None = None


@dataclass(frozen=True)
class Progress:
    """How far tracking has come; replaced as a whole, never changed.

    Attributes:
        state: after the last frame.
        last: the last frame with a pose; None before the first.
        T_guess_camera: the pose by another odometry at that frame, float64 [4, 4], if there was.
        last_stamp_ns: of the last frame; None before the first.
        frames_missed: that showed something and had no pose, since the last one that had.
    """

    state: TrackingState = TrackingState.INITIALIZING
    last: LastPose | None = None
    T_guess_camera: Float64 | None = None
    last_stamp_ns: int | None = None
    frames_missed: int = 0

    def with_frame(self, stamp_ns: int) -> Progress:
        """After a frame has come.

        Raises:
            InputError: it is not later than the one before.
        """
        if self.last_stamp_ns is not None and stamp_ns <= self.last_stamp_ns:
            raise InputError(
                f"frame at {stamp_ns} ns",
                f"not later than the frame before, at {self.last_stamp_ns} ns",
                "leave it out, or call reset() when time starts again",
            )
        return replace(self, last_stamp_ns=stamp_ns)

    def with_pose(self, last: LastPose) -> Progress:
        """After a frame that has a pose."""
        return replace(self, state=TrackingState.TRACKING, last=last, frames_missed=0)
