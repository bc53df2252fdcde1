"""Small recordings in the formats of data sets."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import yaml

from rgbd_glue_ros.types import UInt8

CALIBRATION = {
    "width": 320,
    "height": 240,
    "distortion_model": "plumb_bob",
    "d": [0.0] * 5,
    "k": [300.0, 0.0, 159.5, 0.0, 300.0, 119.5, 0.0, 0.0, 1.0],
}


def write_data_set(folder: Path, frames: int) -> Path:
    """A TUM folder of a camera that passes a poster at 1.5 m; returns its calibration file."""
    noise = np.random.default_rng(0).integers(0, 256, (60, 80 + frames), np.uint8)
    poster: UInt8 = np.asarray(cv2.resize(noise, None, fx=4, fy=4), np.uint8)
    lines = []
    (folder / "rgb").mkdir(parents=True)
    for i in range(frames):
        view = cv2.cvtColor(poster[:, 3 * i : 3 * i + 320], cv2.COLOR_GRAY2BGR)
        cv2.imwrite(str(folder / f"rgb/{i:03d}.png"), view)
        cv2.imwrite(str(folder / f"{i:03d}.png"), np.full((240, 320), 7500, np.uint16))
        lines.append(f"{i / 30:.6f} ")
    for name, prefix in (("rgb.txt", "rgb/"), ("depth.txt", "")):
        text = "".join(f"{line}{prefix}{i:03d}.png\n" for i, line in enumerate(lines))
        (folder / name).write_text(text)
    truth = "".join(f"{line}{i * 0.015} 0 0 0 0 0 1\n" for i, line in enumerate(lines))
    (folder / "groundtruth.txt").write_text(truth)
    (folder / "camera.yaml").write_text(yaml.safe_dump(CALIBRATION))
    return folder / "camera.yaml"
