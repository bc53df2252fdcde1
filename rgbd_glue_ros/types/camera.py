"""A camera: pinhole model and lens."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.types.arrays import Float64
from rgbd_glue_ros.types.checks import check_class, check_distortion, check_intrinsics

_SIZES, _LENGTHS = ("width", "height"), ("fx", "fy", "cx", "cy")


class LensModel(Enum):
    """How a lens displaces points relative to a pinhole camera; coefficients as in OpenCV.

    The values are the names of the models in ROS.
    """

    BROWN_CONRADY = "plumb_bob"
    """k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tau_x tau_y]]]] (Brown 1966; rational in k4 to k6)"""
    INVERSE_BROWN_CONRADY = "inverse_brown_conrady"
    """as ``BROWN_CONRADY``, but from the distorted to the undistorted point, as in librealsense"""
    KANNALA_BRANDT = "equidistant"
    """k1 k2 k3 k4, a polynomial in the angle to the axis (Kannala and Brandt 2006)"""

    @property
    def counts(self) -> tuple[int, ...]:
        """The possible numbers of coefficients, including trailing zeros."""
        return (4,) if self is LensModel.KANNALA_BRANDT else (4, 5, 8, 12, 14)


@dataclass(frozen=True)
class CameraIntrinsics:
    """A pinhole camera behind a lens; pixel centres are at integer coordinates.

    Attributes:
        width: image width, pixels; 0 with ``height`` if a calibration does not give the size.
        height: image height, pixels.
        fx: focal length along x, pixels.
        fy: focal length along y, pixels.
        cx: principal point x, pixels.
        cy: principal point y, pixels.
        distortion: coefficients of ``lens``; empty for a rectified image.
        lens: the model of the coefficients.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    lens: LensModel = LensModel.BROWN_CONRADY

    def __post_init__(self) -> None:
        """Checks the numbers.

        Raises:
            InputError: a size, focal length or centre is invalid, or the coefficients fit no lens.
        """
        check_intrinsics(self.width, self.height, self.fx, self.fy, self.cx, self.cy)
        check_class(
            "CameraIntrinsics.lens", self.lens, LensModel, "LensModel('plumb_bob') or another"
        )
        check_distortion(self.distortion, self.lens.counts)
        # NumPy's would overflow, or have kernels compiled once more
        for names, python_type in ((_SIZES, int), (_LENGTHS, float)):
            for name in names:
                object.__setattr__(self, name, python_type(getattr(self, name)))
        # OpenCV gives an array [1, N]
        object.__setattr__(self, "distortion", tuple(map(float, np.ravel(self.distortion))))

    @property
    def matrix(self) -> Float64:
        """The camera matrix K, shape [3, 3]."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], np.float64)

    @property
    def focal_and_centre(self) -> Float64:
        """fx, fy, cx, cy as an array [4], for compiled code."""
        return np.array([self.fx, self.fy, self.cx, self.cy], np.float64)

    def scaled(self, width: int, height: int) -> CameraIntrinsics:
        """The same camera with its image resized to ``width`` x ``height`` pixels.

        Raises:
            InputError: the present size is not known.
        """
        if not self.width or not self.height:
            raise InputError(
                "CameraIntrinsics.scaled", "the size of the image is not known", "give it first"
            )
        sx, sy = width / self.width, height / self.height
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * sx,
            fy=self.fy * sy,
            # pixel centres are at integers, so the image's edge is at -0.5
            cx=(self.cx + 0.5) * sx - 0.5,
            cy=(self.cy + 0.5) * sy - 0.5,
        )
