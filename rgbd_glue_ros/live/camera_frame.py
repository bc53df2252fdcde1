"""Which camera the images are of, by the name of its optical frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.types import Float64, RgbdFrame

# A rigid mount seems to move by less than this, for the play and the encoders of joints; metres and
# radians.
RIGID_M, RIGID_RAD = 0.002, 0.005


class CameraFrame:
    """The camera that frames are of; another one is believed when two frames in turn are of it."""

    def __init__(self) -> None:
        self._name: str | None = None
        self._other: str | None = None

    def named(self, frame: RgbdFrame) -> RgbdFrame:
        """The frame; if it names no camera, with the name of the camera before it."""
        return frame if frame.frame_id else replace(frame, frame_id=self._name or "")

    def changes_to(self, name: str) -> str | None:
        """Takes in which camera a frame is of.

        Args:
            name: the camera's optical frame, as the frame names it.

        Returns:
            The camera before, where from this frame on they are of another; else None.

        Raises:
            InputError: the frame names another camera than those before. If the next one names it
                too, it is believed.
        """
        before, other, self._other = self._name, self._other, None
        if before is None or name == before:
            self._name = name
            return None
        if name != other:
            self._other = name
            raise InputError(
                "the images' header",
                f"names the camera frame {name!r}, and those before {before!r}",
                "let one camera publish on these topics",
            )
        self._name = name
        return before


def explain_moved_camera(T_before: Float64, T_now: Float64) -> str | None:
    """That a camera moves on its robot; None where it is as rigid as mounts are.

    Args:
        T_before: pose of the camera on the robot as the odometry takes it, float64 [4, 4].
        T_now: as TF has it now.
    """
    T = se3.inverse(T_before) @ T_now
    metres, radians = float(np.linalg.norm(T[:3, 3])), se3.rotation_angle(T)
    if metres < RIGID_M and radians < RIGID_RAD:
        return None
    return (
        f"The camera moves on the robot, by {metres:.3f} m and {np.degrees(radians):.1f} degrees "
        "since it was looked up: it is taken for fixed, and the robot's poses are off by as much. "
        "Mount it rigidly, or leave frame_id empty and publish the camera's own pose"
    )
