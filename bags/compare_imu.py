"""The odometry with and without an IMU, which is simulated from the ground truth of a recording.

``python bags/compare_imu.py RECORDING --every 3``: no public RGB-D sequence with a truth has a
gyroscope, so its samples are made of the truth, with the noise and bias of a real one.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
from raycast_room.imu import BMI055, simulated_imu
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation, RotationSpline, Slerp

from rgbd_glue_ros import (
    ImuSamples,
    Odometry,
    Trajectory,
    evaluate,
    load_preset,
    open_recording,
)
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.types import NANOSECONDS, Float64

# A motion capture system jitters, and a derivative makes much of that: what is faster is no motion.
STEP_S, SMOOTHED_S = 0.01, 0.02


def smooth_pose(truth: Trajectory) -> tuple[Callable[[float], Float64], float, float]:
    """The pose at any time in seconds since the first, and the first and last time it is known."""
    stamps, first = np.unique(truth.stamps_ns, return_index=True)
    times, poses = (stamps - stamps[0]) / NANOSECONDS, truth.poses[first]
    even = np.arange(0.0, times[-1], STEP_S)
    quaternions = Slerp(times, Rotation.from_matrix(poses[:, :3, :3]))(even).as_quat()
    # q and -q are one rotation: neighbours are to have like signs
    turned_over = (quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0
    quaternions[1:][np.cumsum(turned_over) % 2 == 1] *= -1
    positions = np.stack([np.interp(even, times, poses[:, i, 3]) for i in range(3)], axis=1)
    smoothed = [gaussian_filter1d(v, SMOOTHED_S / STEP_S, axis=0) for v in (quaternions, positions)]
    rotation = RotationSpline(even, Rotation.from_quat(smoothed[0]))
    position = CubicSpline(even, smoothed[1])

    def pose(time_s: float) -> Float64:
        return se3.from_rotation_translation(rotation(time_s).as_matrix(), position(time_s))

    return pose, 2 * STEP_S, float(even[-1]) - 2 * STEP_S


def simulated(truth: Trajectory) -> ImuSamples:
    """The samples of a BMI055 on the camera."""
    pose, first_s, last_s = smooth_pose(truth)
    return simulated_imu(pose, first_s, last_s, BMI055, int(truth.stamps_ns.min()))


def errors(path: Path, truth: Trajectory, every: int, samples: ImuSamples) -> str:
    """A row of the table: the errors of a replay."""
    stamps, poses, frames = [], [], 0
    with open_recording(path) as recording, Odometry(load_preset("live")) as odometry:
        odometry.add_imu(samples)
        for frame in recording.select(range(0, recording.frame_count, every)):
            estimate = odometry.process(frame)
            frames += 1
            if estimate.T_odom_camera is not None:
                stamps.append(estimate.stamp_ns)
                poses.append(estimate.T_odom_camera)
        estimated = Trajectory(np.array(stamps, np.int64), np.array(poses))
        found = evaluate(estimated, truth)
    cells = [f"{100 * found.ape.rmse_m:.2f}"]
    if found.rpe is not None:
        cells += [f"{100 * found.rpe.trans_rmse_m:.2f}", f"{found.rpe.rot_rmse_deg:.2f}"]
    return " | ".join([*cells, str(frames - len(poses))])


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--every", type=int, default=1, help="take every Nth frame")
    args = parser.parse_args()
    with open_recording(args.recording) as recording:
        truth = recording.ground_truth
    if truth is None:
        parser.error("the recording has no ground truth")
    print("| | APE (cm) | RPE (cm/s) | RPE (°/s) | lost |\n|---|---|---|---|---|")  # noqa: T201
    for name, given in (("without", ImuSamples.empty()), ("with an IMU", simulated(truth))):
        print(f"| {name} | {errors(args.recording, truth, args.every, given)} |")  # noqa: T201


if __name__ == "__main__":
    main()
