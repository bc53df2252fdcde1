"""From a recording to a trajectory file and a picture of the path, seen from above.

python examples/bag_to_trajectory.py bags/living_room out
"""

import sys
from pathlib import Path

import cv2
import numpy as np

from rgbd_glue_ros import Odometry, Trajectory, load_preset, open_recording, write_tum


def main(source: Path, folder: Path) -> None:
    """Writes ``trajectory.txt`` (TUM) and ``path.png`` into the folder."""
    stamps, poses = [], []
    with open_recording(source) as recording, Odometry(load_preset("live")) as odometry:
        for frame in recording:
            estimate = odometry.process(frame)
            if estimate.T_odom_camera is not None:  # there is none while the camera is lost
                stamps.append(estimate.stamp_ns)
                poses.append(estimate.T_odom_camera)
    trajectory = Trajectory(np.array(stamps, np.int64), np.array(poses).reshape(-1, 4, 4))
    folder.mkdir(parents=True, exist_ok=True)
    write_tum(folder / "trajectory.txt", trajectory)

    x, z = trajectory.poses[:, 0, 3], trajectory.poses[:, 2, 3]
    path = np.stack([x - x.min(), z.max() - z], axis=1)
    pixels = np.rint(20 + 360 * path / max(path.max(), 1e-3)).astype(np.int32)
    picture = np.full((400, 400, 3), 255, np.uint8)
    cv2.polylines(picture, [pixels], isClosed=False, color=(160, 60, 0), lineType=cv2.LINE_AA)
    cv2.imwrite(str(folder / "path.png"), picture)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: python examples/bag_to_trajectory.py RECORDING FOLDER")
    main(Path(sys.argv[1]), Path(sys.argv[2]))
