"""What estimates rest on, by name as on /diagnostics."""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.types import ImuCalibration, ImuUse, OdometryEstimate, RegistrationResult


def evidence_values(estimate: OdometryEstimate) -> dict[str, str]:
    """The usable depth and the matches behind an estimate, as far as it has them."""
    values: dict[str, str] = {}
    if estimate.depth is not None:
        values |= {
            "depth_known": f"{estimate.depth.known:.3f}",
            "depth_in_range": f"{estimate.depth.in_range:.3f}",
            "depth_median_m": f"{estimate.depth.median_m:.3f}",
        }
    if estimate.registration is not None:
        values |= _matches(estimate.registration)
    return values


def imu_values(imu: ImuCalibration | None) -> dict[str, str]:
    """What was learnt about the IMU, and what it is used for; nothing before that is known."""
    if imu is None:
        return {}
    if imu.use is ImuUse.NONE:
        return {"imu_use": imu.use.value}
    return {f"imu_{name}": _rounded(value) for name, value in imu.values().items()}


def _rounded(value: str | float | list[float]) -> str:
    """Numbers with six decimals, separated by blanks."""
    if isinstance(value, str):
        return value
    return " ".join(f"{number:.6f}" for number in np.atleast_1d(value))


def _matches(result: RegistrationResult) -> dict[str, str]:
    """The matches behind the last pose, and the status of its registration."""
    return {
        "registration": result.status.value,
        "visual_matches": str(len(result.visual)),
        "visual_inliers": str(len(result.visual_inliers)),
        "geometric_matches": str(len(result.geometric)),
        "credible_matches": str(len(result.credible)),
        "sigma_m": f"{result.sigma_m:.5f}",
        "epsilon_m": f"{result.epsilon_m:.5f}",
    }
