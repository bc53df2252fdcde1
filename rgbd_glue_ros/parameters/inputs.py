"""The parameters of the input, which the node and recordings share."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

from rgbd_glue_ros.parameters.checks import MOST_WIDTH_PX, POSE, WIDTH, or_nothing
from rgbd_glue_ros.parameters.parameter import parameter

HEADER, RECEIPT = "header", "receipt"

MAP_BY_RECEIPT = "record them and map the recording (rgbd-glue map RECORDING --set stamps=receipt)"
"""What to do about images of two clocks where the mapping node cannot go by their receipt."""

READ_ONCE = "it is read once, when the node starts"

read_once = partial(parameter, fixed=READ_ONCE)


@dataclass(frozen=True)
class InputConfig:
    """How images are understood, and which of them belong together."""

    depth_scale: float = read_once(
        0.0,
        "Metres per unit of the depth images, for example 0.001 for millimetres; values above 1 "
        "are units per metre, for example TUM's 5000. 0 takes what a recording says, otherwise "
        "millimetres for whole numbers and metres for others (REP-118).",
        minimum=0.0,
        maximum=1e6,
    )
    depth_is_registered: bool = read_once(
        False,
        "Depth is registered to colour whatever its frame says, and depth/camera_info is ignored. "
        "If false, depth in another frame than colour is registered by the node or refused.",
    )
    depth_camera_pose: str = read_once(
        "",
        "Pose of the depth camera in the colour camera, between the optical frames, for depth that "
        "is not registered.",
        check=or_nothing(POSE),
    )
    imu_pose: str = read_once(
        "",
        "Pose of the IMU in the colour camera's optical frame; only the rotation is used. If "
        "empty, it is looked up on TF (in a bag on /tf_static), unless both have the same frame.",
        check=or_nothing(POSE),
    )
    max_width: int = read_once(
        0,
        "Wider images are reduced to at most this width, each block of n x n pixels to one: colour "
        "to its mean, depth to that of one surface. With 640, larger images are processed at "
        "30 Hz on two cores. 0 leaves them as they are.",
        unit="pixels",
        minimum=0,
        maximum=MOST_WIDTH_PX,
        check=WIDTH,
    )
    stamps: str = read_once(
        HEADER,
        "Which stamps pair images: those in their headers, or the time of receipt (by the node, or "
        "by the recorder of a bag), for streams with different clocks. Images without a stamp "
        "always use the time of receipt. The IMU goes by the same as the images. The mapping node "
        "accepts only header.",
        choices=(HEADER, RECEIPT),
    )
    approx_sync: bool = read_once(
        True, "Whether stamps of colour and depth may differ; if false, only equal ones pair."
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
        """``depth_scale`` in metres; None if it is 0."""
        return metres_per_unit(self.depth_scale) if self.depth_scale else None

    @property
    def max_interval_s(self) -> float:
        """Maximum difference of the stamps of a pair, seconds."""
        return self.approx_sync_max_interval if self.approx_sync else 0.0


def metres_per_unit(scale: float) -> float:
    """A depth scale as metres of one unit: some write 0.001 for millimetres, others 1000.

    Raises:
        ValueError: the scale is not positive and finite.
    """
    if not 0 < scale < math.inf:
        raise ValueError(f"a depth scale of {scale}")
    return scale if scale <= 1 else 1 / scale
