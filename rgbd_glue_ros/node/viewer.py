"""What the node sees, for the Rerun viewer, where that is asked for."""

from __future__ import annotations

from dataclasses import replace

from rgbd_glue_ros.live.extrinsics import Extrinsics
from rgbd_glue_ros.types import OdometryEstimate, RgbdFrame
from rgbd_glue_ros.viz.rerun_recording import RerunRecording


class NodeViewer:
    """Logs frames; does nothing where nobody asked for it."""

    def __init__(self, target: str) -> None:
        """Opens the file, or connects to the viewer.

        Args:
            target: the parameter ``rerun``; "" for none.

        Raises:
            InputError: the file cannot be written.
            MissingExtraError: Rerun is not installed.
        """
        self._recording = RerunRecording(target) if target else None

    def show(
        self,
        frame: RgbdFrame,
        estimate: OdometryEstimate,
        extrinsics: Extrinsics,
        *,
        is_keyframe: bool,
    ) -> None:
        """Logs a frame, and what is known after it."""
        if self._recording is not None:
            self._recording.place(extrinsics.T_fixed_odom)
            self._recording.add(frame, replace(estimate, is_keyframe=is_keyframe))

    def start_anew(self) -> None:
        """Ends the line of the trajectory, as after a reset."""
        if self._recording is not None:
            self._recording.start_anew()

    def close(self) -> None:
        """Finishes the file."""
        if self._recording is not None:
            self._recording.close()
