"""Which camera took the images, by the name of its optical frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.types import Float64, RgbdFrame

# A rigid mount seems to move by less than this, due to play and encoders of joints; metres and
# radians.
RIGID_M, RIGID_RAD = 0.002, 0.005


class CameraFrame:
    """The camera of the frames; a change is accepted after two consecutive frames of another."""

    def __init__(self) -> None:
        self._name: str | None = None
        self._other: str | None = None

    def named(self, frame: RgbdFrame) -> RgbdFrame:
        """The frame; if its header names no frame, with the name of the last known camera."""
        return frame if frame.frame_id else replace(frame, frame_id=self._name or "")

    def changes_to(self, name: str) -> str | None:
        """Records which camera a frame is from.

        Args:
            name: the camera's optical frame, from the frame's header.

        Returns:
            The previous camera, if the camera changes with this frame; otherwise None.

        Raises:
            InputError: the frame names another camera than the frames before. If the next frame
                names it too, the change is accepted.
        """
        before, other, self._other = self._name, self._other, None
        if before is None or name == before:
            # a header without a name says nothing about the camera
            self._name = name or None
            return None
        if name != other:
            self._other = name
            raise InputError(
                "the images' header",
                f"names the camera frame {name!r}, the images before {before!r}",
                "let only one camera publish on these topics",
            )
        self._name = name
        return before


def explain_moved_camera(T_before: Float64, T_now: Float64) -> str | None:
    """A warning that the camera moves on its robot; None if it is as rigid as a mount.

    Args:
        T_before: pose of the camera on the robot that the odometry uses, float64 [4, 4].
        T_now: its current pose on TF, float64 [4, 4].
    """
    T = se3.inverse(T_before) @ T_now
    metres, radians = float(np.linalg.norm(T[:3, 3])), se3.rotation_angle(T)
    if metres < RIGID_M and radians < RIGID_RAD:
        return None
    return (
        f"moves on the robot, by {metres:.3f} m and {np.degrees(radians):.1f} degrees "
        "since its pose was looked up: it is assumed to be fixed, so the robot's poses are off by "
        "as much. Mount it rigidly, or leave frame_id empty to publish the camera's own pose"
    )
