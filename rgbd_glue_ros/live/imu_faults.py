"""Why an IMU is not used."""

from __future__ import annotations

from rgbd_glue_ros.types import ImuCalibration, ImuUse


def explain_distrust(imu: ImuCalibration) -> str | None:
    """Why a gyroscope is not used, and what to do about it; None if it is used."""
    if imu.use is not ImuUse.DISTRUSTED:
        return None
    return (
        "the gyroscope disagrees with the images, and is not used until they agree: check the "
        "IMU's orientation in the camera (imu_pose, TF), and its stamps"
    )
