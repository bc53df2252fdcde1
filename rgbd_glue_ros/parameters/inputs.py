"""The parameters of what is read, which the node and recordings have alike."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

from rgbd_glue_ros.parameters.checks import POSE, WIDTH, or_nothing
from rgbd_glue_ros.parameters.parameter import parameter

HEADER, RECEIPT = "header", "receipt"

READ_ONCE = "it is read once, when the node starts"

read_once = partial(parameter, fixed=READ_ONCE)


@dataclass(frozen=True)
class InputConfig:
    """How images are understood, and which of them belong together."""

    depth_scale: float = read_once(
        0.0,
        "Metres of one unit of the depth images, as 0.001 for millimetres; what is above 1 counts "
        "units of a metre, as TUM's 5000. 0 takes what a recording says, and else millimetres of "
        "whole numbers and metres of others (REP-118).",
        minimum=0.0,
        maximum=1e6,
    )
    depth_is_registered: bool = read_once(
        False,
        "Depth is registered to colour whatever its frame says, and depth/camera_info of no "
        "interest. Without it, depth in another frame than colour is registered here or refused.",
    )
    depth_camera_pose: str = read_once(
        "",
        "Pose of the depth camera in the colour camera, between the optical frames, for depth that "
        "is not registered.",
        check=or_nothing(POSE),
    )
    imu_pose: str = read_once(
        "",
        "Pose of the IMU in the colour camera's optical frame, of which the rotation counts. "
        "Empty, it is looked up on TF (in a bag on /tf_static), unless both have the same frame.",
        check=or_nothing(POSE),
    )
    max_width: int = read_once(
        0,
        "Wider images are reduced to at most this width, a block of n x n pixels to one: colour by "
        "its mean, depth by that of one surface. 640 lets larger images be processed at 30 Hz "
        "on two cores. 0 leaves them as they are.",
        unit="pixels",
        minimum=0,
        maximum=100000,
        check=WIDTH,
    )
    stamps: str = read_once(
        HEADER,
        "Which stamps images are paired by: those in their headers, or those of their receipt (by "
        "the node, or by the recorder of a bag), for streams with different clocks. Images that "
        "bear no stamp go by their receipt anyway. The mapping node takes header alone.",
        choices=(HEADER, RECEIPT),
    )
    approx_sync: bool = read_once(
        True, "Whether stamps of colour and depth may differ; without it only equal ones pair."
    )
    approx_sync_max_interval: float = read_once(
        0.02,
        "Stamps of colour and depth that are further apart than this do not belong together.",
        unit="s",
        minimum=0.0,
        maximum=60.0,
    )

    @property
    def metres_per_unit(self) -> float | None:
        """``depth_scale`` in metres; None where it is left open."""
        return metres_per_unit(self.depth_scale) if self.depth_scale else None

    @property
    def max_interval_s(self) -> float:
        """How far apart the stamps of a pair are at most, seconds."""
        return self.approx_sync_max_interval if self.approx_sync else 0.0


def metres_per_unit(scale: float) -> float:
    """A depth scale as metres of one unit: some write 0.001 for millimetres, others 1000.

    Raises:
        ValueError: it is not above zero and finite.
    """
    if not 0 < scale < math.inf:
        raise ValueError(f"a depth scale of {scale}")
    return scale if scale <= 1 else 1 / scale
