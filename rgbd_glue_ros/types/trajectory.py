"""Poses over time."""

from __future__ import annotations

from dataclasses import dataclass

from rgbd_glue_ros.types.arrays import Float64, Int64
from rgbd_glue_ros.types.checks import check_trajectory


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses over time.

    Attributes:
        stamps_ns: int64 [N], not necessarily increasing.
        poses: float64 [N, 4, 4], T_world_body at each stamp.
    """

    stamps_ns: Int64
    poses: Float64

    def __post_init__(self) -> None:
        """Checks the arrays.

        Raises:
            InputError: an array has another type or shape, or a pose is not finite.
        """
        check_trajectory(self.stamps_ns, self.poses)

    def __len__(self) -> int:
        return len(self.stamps_ns)
