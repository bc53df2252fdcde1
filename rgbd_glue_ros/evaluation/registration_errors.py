"""Errors of a registration against ground truth, as measured by UR&R and BYOC.

UR&R (El Banani, Gao and Johnson, CVPR 2021) and BYOC (El Banani and Johnson, ICCV 2021) define the
figures that the paper reports: errors of rotation, translation and chamfer distance of every pair,
and over all pairs the mean, the median, and the part below each of three thresholds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.camera import back_project
from rgbd_glue_ros.types import Float64, View

THRESHOLDS: dict[str, tuple[float, float, float]] = {
    "rotation_deg": (5, 10, 45),
    "translation_cm": (5, 10, 25),
    "chamfer_mm": (1, 5, 10),
}
"""Thresholds of accuracy, for each of the errors by its name in ``RegistrationErrors``."""

# UR&R evaluates on images cropped to a centred square and reduced to this many pixels a side.
_CHAMFER_SIDE = 128


@dataclass(frozen=True)
class RegistrationErrors:
    """The errors of one registration.

    Attributes:
        rotation_deg: as ``rotation_deg`` gives it.
        translation_cm: as ``translation_cm`` gives it.
        chamfer_mm: ``chamfer`` times 1000, which the publications call millimetres.
        failed: whether there was no transform; the errors are then those of the identity.
    """

    rotation_deg: float
    translation_cm: float
    chamfer_mm: float
    failed: bool = False


def registration_errors(
    estimate: Float64 | None, truth: Float64, source: View, target: View
) -> RegistrationErrors:
    """The errors of an estimated T_target_source; if it is None, those of the identity.

    Args:
        estimate: T_target_source, float64 [4, 4].
        truth: T_target_source, float64 [4, 4].
        source: frame that the transforms map from.
        target: frame that they map to.
    """
    T = np.eye(4) if estimate is None else estimate
    return RegistrationErrors(
        rotation_deg=rotation_deg(T, truth),
        translation_cm=translation_cm(T, truth),
        chamfer_mm=1000 * chamfer(T, truth, chamfer_points(source), chamfer_points(target)),
        failed=estimate is None,
    )


def rotation_deg(estimate: Float64, truth: Float64) -> float:
    """The angle of the rotation between two transforms [4, 4], degrees in [0, 180]."""
    return float(np.rad2deg(se3.rotation_angle(se3.inverse(truth) @ estimate)))


def translation_cm(estimate: Float64, truth: Float64) -> float:
    """The length of the difference between the translations of two transforms [4, 4], cm."""
    return 100 * float(np.linalg.norm(estimate[:3, 3] - truth[:3, 3]))


def chamfer(estimate: Float64, truth: Float64, source: Float64, target: Float64) -> float:
    """The chamfer distance between the scene as estimated and the true scene, square metres.

    A scene is the union of both clouds in the source's frame: the source's points, and the
    target's points moved there by the inverse of the transform. From every point of each scene the
    squared distance to the nearest point of the other is taken; the result is the mean over the
    points of the one plus the mean over the points of the other.

    The source's points are the same in both scenes, so the result is bounded by the distance of the
    target's points from them, and a small value means less than small errors of the transform.

    Args:
        estimate: T_target_source, float64 [4, 4].
        truth: T_target_source, float64 [4, 4].
        source: float64 [N, 3], metres.
        target: float64 [M, 3], metres; without points nothing can differ.
    """
    if not len(target):
        return 0.0
    estimated, true = (
        np.concatenate([source, se3.transform(se3.inverse(T), target)]) for T in (estimate, truth)
    )
    there, _ = cKDTree(true).query(estimated)
    back, _ = cKDTree(estimated).query(true)
    return float(np.mean(there**2) + np.mean(back**2))


def chamfer_points(view: View) -> Float64:
    """The points [N, 3] that UR&R measures the chamfer distance on, optical frame, metres.

    The points of 128 x 128 pixels spread evenly over the centred square of the depth image, without
    interpolation. Unknown depth is skipped, whereas UR&R keeps a point at the camera for it.
    """
    height, width = view.depth.shape
    side = min(height, width)
    steps = np.arange(_CHAMFER_SIDE) * side // _CHAMFER_SIDE
    u, v = (w.ravel() for w in np.meshgrid((width - side) // 2 + steps, steps))
    z = view.depth[v, u].astype(np.float64)
    known = np.isfinite(z)
    uv = np.stack([u[known], v[known]], axis=1).astype(np.float64)
    return back_project(uv, z[known], view.intrinsics)


def error_statistics(errors: Sequence[RegistrationErrors]) -> dict[str, dict[str, Any]]:
    """Accuracy in percent at every threshold, mean and median of each error, by its name.

    A failed registration is never accurate; mean and median treat it as the identity, since the
    methods of the publications always give a transform and skip no pair.

    Args:
        errors: of at least one pair.
    """
    failed = np.array([e.failed for e in errors])
    statistics = {}
    for name, thresholds in THRESHOLDS.items():
        values = np.array([getattr(e, name) for e in errors])
        statistics[name] = {
            "accuracy": {
                f"{threshold:g}": 100 * float(np.mean(~failed & (values <= threshold)))
                for threshold in thresholds
            },
            "mean": float(values.mean()),
            "median": float(np.median(values)),
        }
    return statistics
