"""Draws the pictures of README.md from the bundled recording: ``python scripts/pictures.py``.

docs/images/matches.jpg is what the node publishes on debug/matches, room.jpg the room with the
camera's path in it, living_room.webp both as they come about.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from rgbd_glue_ros import Odometry, RgbdFrame, load_preset, open_recording
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live.match_image import match_image
from rgbd_glue_ros.slam.cloud import ColoredCloud, cloud_of, fused
from rgbd_glue_ros.types import Float64, UInt8

ROOT = Path(__file__).resolve().parents[1]
SOURCE, IMAGES = ROOT / "bags" / "living_room", ROOT / "docs" / "images"
WIDTH, HEIGHT = 400, 300
# pixels of the large picture for one of the animation
LARGE = 2
EVERY, FRAME_MS = 3, 100
FOCAL = 0.95
PATH_RGB, CAMERA_RGB, PAGE = (29, 95, 209), (207, 47, 60), 246
# of the pinhole that a camera is drawn as, metres
EYE = 0.09
# half the width that a point of the cloud is drawn with, metres
SPLAT_M = 0.009


def looking(eye: tuple[float, float, float], at: tuple[float, float, float]) -> Float64:
    """T_view_odom of somebody at ``eye`` who looks at ``at``; y is down, as in odom."""
    forward = np.subtract(at, eye)
    z = forward / np.linalg.norm(forward)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    T = se3.from_rotation_translation(np.stack([x, np.cross(z, x), z], axis=1), np.array(eye))
    return np.asarray(se3.inverse(T))


# from behind the first camera, to its right and above it
T_VIEW_ODOM = looking(eye=(1.2, -0.75, -1.5), at=(-0.1, 0.1, 1.6))


def seen(points: Float64, width: int, height: int) -> tuple[Float64, Float64]:
    """Where points [N, 3] of odom are in the picture, pixels [N, 2], and how far away, metres."""
    x, y, z = se3.transform(T_VIEW_ODOM, points).T
    safe = np.maximum(z, 1e-3)
    focal = FOCAL * width
    uv = np.stack([focal * x / safe + width / 2, focal * y / safe + height / 2], axis=1)
    return uv, z


def room(cloud: ColoredCloud, width: int, height: int) -> UInt8:
    """The cloud as somebody sees it who stands in the room, [H, W, 3] RGB."""
    uv, z = seen(cloud.points.astype(np.float64), width, height)
    image = np.full((height, width, 3), PAGE, np.uint8)
    inside = (z > 0.3) & (uv > 0).all(axis=1) & (uv < [width, height]).all(axis=1)
    # far ones first, so that near ones cover them
    for i in np.flatnonzero(inside)[np.argsort(-z[inside])]:
        size = max(1, round(SPLAT_M * FOCAL * width / z[i]))
        u, v = uv[i].astype(int)
        image[max(0, v - size) : v + size, max(0, u - size) : u + size] = cloud.colors[i]
    return image


def with_path(image: UInt8, poses: list[Float64]) -> UInt8:
    """The room with the way of the camera, and the camera where it is last."""
    drawn, (height, width) = image.copy(), image.shape[:2]
    thick = max(1, width // 220)
    way = np.array([T[:3, 3] for T in poses])
    uv, _ = seen(way, width, height)
    cv2.polylines(drawn, [np.int32(16 * uv)], False, PATH_RGB, thick, cv2.LINE_AA, 4)
    corners = EYE * np.array(
        [[x, y, 1.3] for x, y in ((-1, -0.75), (1, -0.75), (1, 0.75), (-1, 0.75))]
    )
    ends, _ = seen(se3.transform(poses[-1], corners), width, height)
    (middle,), _ = seen(way[-1:], width, height)
    for i in range(4):
        triangle = np.int32(16 * np.array([middle, ends[i], ends[(i + 1) % 4]]))
        cv2.polylines(drawn, [triangle], True, CAMERA_RGB, thick, cv2.LINE_AA, 4)
    return np.asarray(drawn)


def save(name: str, image: UInt8, quality: int) -> None:
    """Writes a picture [H, W, 3] RGB."""
    cv2.imwrite(str(IMAGES / name), image[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])


def main() -> None:
    """Runs the odometry over the bundled recording and draws what comes of it."""
    poses: list[Float64] = []
    clouds, placed, left, counts = [], [], [], []
    with open_recording(SOURCE) as recording, Odometry(load_preset("live")) as odometry:
        frames: list[RgbdFrame] = list(recording)
        for number, frame in enumerate(frames):
            estimate = odometry.process(frame)
            assert estimate.T_odom_camera is not None  # noqa: S101 - of this recording
            poses.append(estimate.T_odom_camera)
            if number % (2 * EVERY) == 0:
                clouds.append(cloud_of(frame))
                placed.append(estimate.T_odom_camera)
            if number % EVERY == 0:
                left.append(match_image(frame, estimate))
                counts.append(number + 1)
    cloud = fused(clouds, np.array(placed))
    middle = left[len(left) // 2]
    save("matches.jpg", middle, 80)
    save("room.jpg", with_path(room(cloud, LARGE * WIDTH, LARGE * HEIGHT), poses), 82)
    bare = room(cloud, WIDTH, HEIGHT)
    animation = cv2.Animation()
    animation.frames = [
        np.hstack(
            [
                cv2.resize(matches, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA),
                with_path(bare, poses[:count]),
            ]
        )[:, :, ::-1]
        for matches, count in zip(left, counts, strict=True)
    ]
    animation.durations = [FRAME_MS] * len(left)
    cv2.imwriteanimation(
        str(IMAGES / "living_room.webp"), animation, [cv2.IMWRITE_WEBP_QUALITY, 60]
    )


if __name__ == "__main__":
    main()
