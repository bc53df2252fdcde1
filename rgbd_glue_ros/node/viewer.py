"""The node's optional output to the Rerun viewer."""

from __future__ import annotations

from dataclasses import replace

from rgbd_glue_ros.live.extrinsics import Extrinsics
from rgbd_glue_ros.types import OdometryEstimate, RgbdFrame
from rgbd_glue_ros.viz.rerun_recording import RerunRecording


class NodeViewer:
    """Logs frames to Rerun; does nothing if the parameter ``rerun`` is empty."""

    def __init__(self, target: str) -> None:
        """Opens the file, or connects to the viewer.

        Args:
            target: the parameter ``rerun``: a file or an address; "" for none.

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
        """Logs a frame and its estimate."""
        if self._recording is not None:
            self._recording.place(extrinsics.T_fixed_odom)
            self._recording.add(frame, replace(estimate, is_keyframe=is_keyframe))

    def start_anew(self) -> None:
        """Starts a new trajectory line, as after a reset."""
        if self._recording is not None:
            self._recording.start_anew()

    def close(self) -> None:
        """Finishes the file."""
        if self._recording is not None:
            self._recording.close()
