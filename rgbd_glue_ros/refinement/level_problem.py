"""A model and a frame at a level of the pyramid: all that residuals depend on besides the pose."""

from __future__ import annotations

from typing import NamedTuple

from rgbd_glue_ros.types import Float32, Float64, UInt8


class Exposure(NamedTuple):
    """How and when one image of a frame was taken.

    Attributes:
        K: float64 [4], fx, fy, cx, cy.
        height: of the image, pixels.
        twist: float64 [6], velocity of the camera.
        readout_time: seconds from the first row to the last.
        delay: seconds from the colour image to this one.
    """

    K: Float64
    height: int
    twist: Float64
    readout_time: float
    delay: float


class LevelProblem(NamedTuple):
    """What the residuals of planes and pixels are computed from, as compiled code takes it.

    Attributes:
        points: float64 [N, 3] of planes.
        normals: float64 [N, 3].
        depth: float32 [H, W] of the frame.
        depth_exposure: of ``depth``.
        pixels: float64 [M, 3], textured points.
        brightness: float64 [M] of these.
        image: uint8 [H / 2^level, W / 2^level] of the frame.
        image_exposure: of ``image``.
        plane_cauchy: residual, in standard deviations, at which a plane's weight is halved.
        pixel_cauchy: that of a pixel.
        pixel_weight: of a pixel against a plane.
        match_source: float64 [L, 3], visual matches' points in the frame.
        match_target: float64 [L, 3], the same points of the model.
        match_weight: of a match against a plane.
        contrast: of the frame's image, as a part of that of a well-lit one.
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
    match_source: Float64
    match_target: Float64
    match_weight: float
    contrast: float
