"""A model and a frame at one pyramid level: everything that residuals need besides the pose."""

from __future__ import annotations

from typing import NamedTuple

from rgbd_glue_ros.types import Float32, Float64, UInt8


class Exposure(NamedTuple):
    """How and when one image of a frame was taken.

    Attributes:
        K: fx, fy, cx, cy.
        height: image height, pixels.
        twist: linear and angular velocity of the camera, 6 numbers.
        readout_time: time from the first row to the last, seconds.
        delay: time from the colour image to this one, seconds.
    """

    K: tuple[float, ...]
    height: int
    twist: tuple[float, ...]
    readout_time: float
    delay: float


class LevelProblem(NamedTuple):
    """The inputs of the residuals, in a form that compiled code accepts and is fast with.

    Attributes:
        points: float64 [3, N], points of the planes.
        normals: float64 [3, N], their normals.
        depth: float32 [H, W], depth image of the frame.
        depth_exposure: exposure of ``depth``.
        pixels: float64 [3, M], textured points.
        brightness: float64 [M], their brightness.
        image: uint8 [H / 2^level, W / 2^level], grey image of the frame.
        image_exposure: exposure of ``image``.
        plane_cauchy: residual, in standard deviations, at which a plane's weight is halved.
        pixel_cauchy: the same for a pixel.
        pixel_weight: weight of a pixel relative to a plane, if depth is exact.
        noisy_pixel_weight: the same if depth is as noisy as a sensor's.
        match_source: float64 [L, 3], points of visual matches in the frame.
        match_target: float64 [L, 3], the same points in the model.
        match_weight: weight of a match relative to a plane.
        contrast: contrast of the frame's image, as a fraction of that of a well-lit one.
        depth_noise: noise of the frame's depth, relative to ``depth_sigma``.
    """

    points: Float64
    normals: Float64
    depth: Float32
    depth_exposure: Exposure
    pixels: Float64
    brightness: Float64
    image: UInt8
    image_exposure: Exposure
    plane_cauchy: float
    pixel_cauchy: float
    pixel_weight: float
    noisy_pixel_weight: float
    match_source: Float64
    match_target: Float64
    match_weight: float
    contrast: float
    depth_noise: float
