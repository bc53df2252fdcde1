"""From arrays to a pose: registers two views of a poster that the camera has moved along.

python examples/arrays_to_pose.py
"""

import cv2
import numpy as np

from rgbd_glue_ros import CameraIntrinsics, RgbdFrame, load_preset, register

SHIFT_PX, DISTANCE_MM = 20, 2000
CAMERA = CameraIntrinsics(width=640, height=480, fx=525.0, fy=525.0, cx=319.5, cy=239.5)


def main() -> None:
    """Prints how far the camera moved, estimated and true."""
    noise = np.random.default_rng(0).integers(0, 256, (480, 640 + SHIFT_PX, 3), np.uint8)
    poster = np.asarray(cv2.GaussianBlur(noise, (0, 0), 3) * 4, np.uint8)
    depth_mm = np.full((480, 640), DISTANCE_MM, np.uint16)  # as in most cameras
    depth_m = np.where(depth_mm > 0, depth_mm / 1000, np.nan).astype(np.float32)

    first = RgbdFrame(0, np.ascontiguousarray(poster[:, :640]), depth_m, CAMERA)
    second = RgbdFrame(33_000_000, np.ascontiguousarray(poster[:, SHIFT_PX:]), depth_m, CAMERA)
    result = register(second, first, load_preset("live"))

    if result.T_target_source is None:
        raise SystemExit(f"no transform: {result.status.value}")
    x, y, z = result.T_target_source[:3, 3]
    print(f"moved by  {x:.4f} {y:.4f} {z:.4f} m")
    print(f"in truth  {SHIFT_PX * DISTANCE_MM / 1000 / CAMERA.fx:.4f} 0 0 m")
    print(f"from {len(result.visual_inliers)} visual matches")


if __name__ == "__main__":
    main()
