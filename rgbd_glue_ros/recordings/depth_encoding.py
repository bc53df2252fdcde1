"""How the depth images of a recording encode metres."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros.messages.fields import DEPTH_UNITS_PER_METRE
from rgbd_glue_ros.messages.images import metres
from rgbd_glue_ros.types import Float32


@dataclass(frozen=True)
class DepthEncoding:
    """How a depth image encodes metres.

    Attributes:
        units_per_metre: units per metre in an image of whole numbers.
        float_units_per_metre: units per metre in an image of other numbers.
        rotation: bits by which a number was rotated to the left before storage.
    """

    units_per_metre: float
    float_units_per_metre: float = 1.0
    rotation: int = 0

    def with_scale(self, metres_per_unit: float | None) -> DepthEncoding:
        """This encoding in other units; None leaves them unchanged."""
        if metres_per_unit is None:
            return self
        units = 1 / metres_per_unit
        return replace(self, units_per_metre=units, float_units_per_metre=units)

    def with_calibration_depth_scale(self, metres_per_unit: float | None) -> DepthEncoding:
        """This encoding in the units of a calibration file; None leaves them unchanged.

        A unit of one metre, as in ORB-SLAM's ``DepthMapFactor: 1.0``, is for floats: depth in whole
        metres is unusable.
        """
        if metres_per_unit == 1:
            return replace(self, float_units_per_metre=1.0)
        return self.with_scale(metres_per_unit)

    def metres(self, image: NDArray[Any]) -> Float32:
        """float32 [H, W] metres from whole numbers or floats [H, W].

        NaN where it is unknown: where a whole number is 0 or has overflowed, or another number is
        not positive and finite.
        """
        if image.dtype.kind == "f":
            return metres(image, self.float_units_per_metre, None)
        if image.dtype != np.uint16 and _fits_16_bits(image):
            image = image.astype(np.uint16)  # which NumPy makes wider in many calculations
        if self.rotation:
            image = (image >> self.rotation) | (image << (16 - self.rotation))
        return metres(image, self.units_per_metre, None)


def _fits_16_bits(image: NDArray[Any]) -> bool:
    return bool(image.min(initial=0) >= 0 and image.max(initial=0) <= np.iinfo(np.uint16).max)


MILLIMETRES = DepthEncoding(DEPTH_UNITS_PER_METRE)
"""Whole numbers as in bags (REP-118) and in most data sets."""

TUM_UNITS_PER_METRE = 5000

TUM = DepthEncoding(TUM_UNITS_PER_METRE)
"""Whole numbers as in TUM's data sets and those in their layout."""
