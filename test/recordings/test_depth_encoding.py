"""Numbers of depth images that mean a distance, and those that mean none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rgbd_glue_ros.recordings.depth_encoding import MILLIMETRES, TUM, DepthEncoding


@pytest.mark.parametrize("encoding", [MILLIMETRES, TUM, DepthEncoding(4000.0)])
def test_nothing_and_overflow_are_no_depth_in_whole_numbers_of_any_unit(
    encoding: DepthEncoding,
) -> None:
    metres = encoding.metres(np.array([[0, 1, 65534, 65535]], np.uint16))
    np.testing.assert_array_equal(np.isnan(metres), [[True, False, False, True]])
    np.testing.assert_allclose(metres[0, 1:3], np.array([1, 65534]) / encoding.units_per_metre)


def test_numbers_that_were_rotated_are_rotated_back() -> None:
    rotated = replace(MILLIMETRES, rotation=3)
    metres = rotated.metres(np.array([[1500 << 3, 0, 65535]], np.uint16))
    np.testing.assert_allclose(metres, [[1.5, np.nan, np.nan]])


def test_floats_are_metres_unless_a_scale_is_given() -> None:
    image = np.array([[1.5, 0.0, -1.0, np.inf, np.nan]], np.float32)
    np.testing.assert_allclose(MILLIMETRES.metres(image), [[1.5, *[np.nan] * 4]])
    scaled = MILLIMETRES.with_scale(0.5).metres(image)
    np.testing.assert_allclose(scaled, [[0.75, *[np.nan] * 4]])
