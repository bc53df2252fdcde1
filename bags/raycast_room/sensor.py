"""What a structured-light RGB-D camera makes of a scene: noise, holes, quantisation, blur.

Depth is measured as a disparity d = f b / z between projector and infrared camera, with noise of
the same size at any range and in steps of an eighth of a pixel (Khoshelham and Elberink 2012).
So depth noise grows with z^2.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from raycast_room.motion import Pose
from raycast_room.raycaster import Tables
from raycast_room.render import EXPOSURES, develop, expose, measure, to_uint8
from rgbd_glue_ros.types import CameraIntrinsics, Float64, UInt8

EXPOSURE_S = 0.012  # of the colour image

BASELINE = 0.075  # metres from camera to projector
FOCAL_BASELINE = 580.0 * BASELINE  # focal length of the infrared camera in pixels x metres
DISPARITY_STEPS = 8  # per pixel
DISPARITY_SIGMA = 0.06  # pixels
# The sensor matches windows, so neighbours err alike: white noise through a 9 x 9 box, three times.
_WINDOW = 9
_PASSES = 3

_NEAREST = 0.4  # metres
_WEAKEST_ECHO = 0.025  # of a white surface seen frontally from 1 m
_ECHO_SPREAD = 0.3  # of the echo that is just enough, relative
_EDGE = 0.04  # a step in depth that loses the far side, relative

_COLOR_SIGMA = 1.2  # grey levels

_UNIFORM_VARIANCE = (256 * 256 - 1) / 12  # of a random byte


def photograph(
    scene: Tables, path: Callable[[float], Pose], time_s: float, camera: CameraIntrinsics, seed: int
) -> tuple[UInt8, NDArray[np.uint16]]:
    """One frame as the camera delivers it.

    Args:
        scene: as from ``living_room``.
        path: pose of the camera at any time.
        time_s: the middle of the exposure.
        camera: of both images.
        seed: of the noise.

    Returns:
        Colour uint8 [H, W, 3] RGB and depth uint16 [H, W], millimetres, 0 unknown.
    """
    moments = [time_s + EXPOSURE_S * ((k + 0.5) / EXPOSURES - 0.5) for k in range(EXPOSURES)]
    linear = expose(scene, np.stack([path(moment).matrix for moment in moments]), camera)
    depth, echo = measure(scene, path(time_s).matrix, BASELINE, camera)
    # noise drawn as whole numbers is the same on every machine
    random = np.random.default_rng(seed)
    return _with_noise(develop(linear), random), _structured_light(depth, echo, random)


def _with_noise(sixteenths: NDArray[np.int32], random: np.random.Generator) -> UInt8:
    """Colour with the noise of its sensor."""
    draws = random.integers(0, 256, (4, *sixteenths.shape), dtype=np.uint8)
    total = draws.sum(axis=0, dtype=np.int32) - 2 * 255
    scale = _COLOR_SIGMA * 16 / math.sqrt(4 * _UNIFORM_VARIANCE)
    return to_uint8(sixteenths + np.floor(total * scale + 0.5).astype(np.int32))


def _structured_light(
    depth: Float64, echo: Float64, random: np.random.Generator
) -> NDArray[np.uint16]:
    """Depth with noise, quantisation and holes, in millimetres."""
    noise = DISPARITY_SIGMA * _smooth_noise(random, depth.shape)
    disparity = FOCAL_BASELINE / depth + noise
    steps = np.floor(disparity * DISPARITY_STEPS + 0.5)
    measured = np.floor(1000.0 * DISPARITY_STEPS * FOCAL_BASELINE / steps + 0.5)
    needed = _WEAKEST_ECHO * (1.0 + _ECHO_SPREAD * _smooth_noise(random, depth.shape))
    hole = (echo < needed) | (depth < _NEAREST) | _far_side_of_edge(depth)
    return np.where(hole, 0, measured).astype(np.uint16)


def _far_side_of_edge(depth: Float64) -> NDArray[np.bool_]:
    """Pixels beside one that is much nearer: the window that is matched straddles both."""
    padded = np.pad(depth, 1, mode="edge")
    height, width = depth.shape
    nearest = np.minimum.reduce(
        [padded[i : i + height, j : j + width] for i in range(3) for j in range(3)]
    )
    far: NDArray[np.bool_] = depth - nearest > _EDGE * depth
    return far


def _smooth_noise(random: np.random.Generator, shape: tuple[int, ...]) -> Float64:
    """Gaussian noise of unit variance [H, W], correlated over some pixels."""
    # a sum of many bytes is as good as Gaussian, and exact
    margin = _PASSES * (_WINDOW - 1)
    sums = random.integers(0, 256, (shape[0] + margin, shape[1] + margin)) - 128
    kernel = np.ones(1)
    for _ in range(_PASSES):
        sums = _box_sums(_box_sums(sums).T).T
        kernel = np.convolve(kernel, np.ones(_WINDOW))
    noise: Float64 = (sums + 0.5 * kernel.sum() ** 2) / (
        float(kernel @ kernel) * math.sqrt(_UNIFORM_VARIANCE)
    )
    return noise


def _box_sums(values: NDArray[np.int64]) -> NDArray[np.int64]:
    """Sums of ``_WINDOW`` consecutive rows."""
    total = np.concatenate([np.zeros_like(values[:1]), values.cumsum(axis=0)])
    sums: NDArray[np.int64] = total[_WINDOW:] - total[:-_WINDOW]
    return sums
