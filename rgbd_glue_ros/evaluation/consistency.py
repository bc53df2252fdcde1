"""Whether the covariances of an odometry's poses are of the size of its errors."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.gates import mahalanobis_squared
from rgbd_glue_ros.trajectories.interpolation import interpolated
from rgbd_glue_ros.types import Float64, OdometryEstimate, Trajectory


def normalised_errors(estimates: Iterable[OdometryEstimate], reference: Trajectory) -> Float64:
    """NEES of the transforms from every frame to its keyframe: consistency of the covariances.

    xi' P^-1 xi with xi = log(T_estimated T_true^-1), T from the frame to its keyframe (Bar-Shalom,
    Li and Kirubarajan 2001). For a consistent covariance its mean is 6. If an estimate does not
    state its uncertainty relative to its keyframe, this is the excess of the frame's covariance
    over the keyframe's.

    Args:
        estimates: in order of time.
        reference: true poses; between two of them the truth is interpolated, since a stamp missed
            by milliseconds would count as an error of the estimate.

    Returns:
        float64 [N], for every frame with a pose, a keyframe other than itself, and ground truth for
        both.
    """
    posed = [e for e in estimates if e.T_odom_camera is not None and e.covariance is not None]
    truth = interpolated(reference, np.array([e.stamp_ns for e in posed], np.int64))
    keyframes: list[tuple[OdometryEstimate, Float64]] = []
    errors = []
    for estimate, true in zip(posed, truth, strict=True):
        # a frame that restarts the odometry has its own number
        number = estimate.keyframe_id
        if number is not None and number < len(keyframes):
            errors.append(_normalised_error(estimate, true, *keyframes[number]))
        if estimate.is_keyframe:
            keyframes.append((estimate, true))
    normalised = np.array(errors, np.float64)
    return normalised[np.isfinite(normalised)]


def _normalised_error(
    frame: OdometryEstimate, true: Float64, keyframe: OdometryEstimate, true_keyframe: Float64
) -> float:
    """NEES of the transform between two estimates; NaN if ground truth is not known."""
    T, T_keyframe = frame.T_odom_camera, keyframe.T_odom_camera
    if T is None or T_keyframe is None or frame.covariance is None or keyframe.covariance is None:
        return float("nan")
    expected = T_keyframe @ se3.inverse(true_keyframe) @ true
    if not np.isfinite(expected).all():
        return float("nan")
    error = se3.log(T @ se3.inverse(expected))
    if frame.covariance_from_keyframe is not None:
        return mahalanobis_squared(error, frame.covariance_from_keyframe)
    covariance = se3.perturbation_covariance(T, frame.covariance)
    covariance = covariance - se3.perturbation_covariance(T_keyframe, keyframe.covariance)
    return mahalanobis_squared(error, covariance)
