"""Draws the pictures of README.md and docs/.

``python scripts/pictures.py`` draws them from the bundled recording: docs/images/matches.jpg is
what the node publishes on debug/matches, room.jpg the room with the camera's path in it,
living_room.webp both as they come about. ``python scripts/pictures.py rgbd_dataset_freiburg1_desk``
draws desk.jpg, the map that ``rgbd-glue map`` makes of that recording of TUM, and fr1_desk.png, the
way of its camera by the odometry alone beside the true one.
"""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros import Odometry, RgbdFrame, load_preset, open_recording
from rgbd_glue_ros.evaluation.trajectory_errors import evaluate
from rgbd_glue_ros.experiments.mapping.mapping import map_recording
from rgbd_glue_ros.experiments.replay.replay import replay
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live.match_image import match_image
from rgbd_glue_ros.slam.cloud import ColoredCloud, cloud_of, fused
from rgbd_glue_ros.slam.picture import PATH_RGB, Onlooker, picture, with_path
from rgbd_glue_ros.types import Float64, UInt8

ROOT = Path(__file__).resolve().parents[1]
SOURCE, IMAGES = ROOT / "bags" / "living_room", ROOT / "docs" / "images"
WIDTH, HEIGHT = 400, 300
# pixels of the large picture for one of the animation
LARGE = 2
EVERY, FRAME_MS = 3, 100
# of the way from above: how many times larger it is drawn, its border in pixels then, the length of
# its bar, colours
SMOOTHING, MARGIN, BAR_M = 4, 96, 0.5
TRUE_RGB, START_RGB, END_RGB, BAR_RGB = (176, 184, 196), (30, 140, 90), (200, 40, 50), (60, 60, 60)


def of_the_room(scale: int) -> Onlooker:
    """Behind the first camera, to its right and above it; y is down, as in odom."""
    eye, target, up = np.array([[1.2, -0.75, -1.5], [-0.1, 0.1, 1.6], [0.0, -1.0, 0.0]])
    return Onlooker.at(eye, target, up, scale * WIDTH, scale * HEIGHT)


def of_the_desk(scale: int) -> Onlooker:
    """In the frame of the motion capture."""
    eye, target, up = np.array([[1.5, -2.2, 2.85], [0.1, 0.75, 0.78], [0.0, 0.0, 1.0]])
    return Onlooker.at(eye, target, up, scale * WIDTH, scale * HEIGHT)


def save(name: str, image: UInt8, quality: int) -> None:
    """Writes a picture [H, W, 3] RGB."""
    cv2.imwrite(str(IMAGES / name), image[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])


def draw_desk(source: Path) -> None:
    """Draws the map of fr1_desk, twice as large and then smoothed."""
    with open_recording(source) as recording, TemporaryDirectory() as folder:
        mapped = map_recording(recording, load_preset("live"), Path(folder))
        truth = recording.ground_truth
    if truth is None:
        raise SystemExit(f"{source}: has no ground truth, which tells which way is up")
    trajectory = mapped.run.trajectory
    T_world_map = evaluate(trajectory, truth).T_reference_estimate
    points = se3.transform(T_world_map, mapped.cloud.points.astype(np.float64))
    cloud = ColoredCloud(points.astype(np.float32), mapped.cloud.colors)
    onlooker = of_the_desk(2 * LARGE)
    way = T_world_map @ trajectory.poses
    drawn = with_path(picture(cloud, onlooker), way, onlooker, 5)
    small = cv2.resize(drawn, (LARGE * WIDTH, LARGE * HEIGHT), interpolation=cv2.INTER_AREA)
    save("desk.jpg", np.asarray(small, np.uint8), 82)


def draw_way(source: Path) -> None:
    """Draws the way of the camera from above, larger and then smoothed."""
    with open_recording(source) as recording, TemporaryDirectory() as folder:
        run = replay(recording, load_preset("live"), Path(folder))
    if run.ground_truth is None:
        raise SystemExit(f"{source}: has no ground truth to draw beside it")
    found = evaluate(run.trajectory, run.ground_truth)
    true, way = found.reference[:, :2, 3], found.estimate[:, :2, 3]
    low, high = np.vstack([true, way]).min(axis=0), np.vstack([true, way]).max(axis=0)
    width = SMOOTHING * LARGE * WIDTH
    scale = (width - 2 * MARGIN) / (high[0] - low[0])
    height = round(2 * MARGIN + scale * (high[1] - low[1]))

    def pixels(points: Float64) -> NDArray[np.int32]:
        right, up = (MARGIN + scale * (points - low)).T
        return np.asarray(np.rint(np.stack([right, height - up], axis=1)), np.int32)

    image = np.full((height, width, 3), 255, np.uint8)
    cv2.polylines(image, [pixels(true)], isClosed=False, color=TRUE_RGB, thickness=20)
    cv2.polylines(image, [pixels(way)], isClosed=False, color=PATH_RGB, thickness=8)
    for end, rgb in ((way[0], START_RGB), (way[-1], END_RGB)):
        cv2.circle(image, pixels(end[np.newaxis])[0].tolist(), 18, rgb, cv2.FILLED)
    left, right, level = MARGIN, MARGIN + round(BAR_M * scale), height - MARGIN // 2
    cv2.line(image, (left, level), (right, level), color=BAR_RGB, thickness=6)
    label, beside = f"{100 * BAR_M:g} cm", (right + 30, level + 20)
    cv2.putText(image, label, beside, cv2.FONT_HERSHEY_SIMPLEX, 2.0, BAR_RGB, 5, cv2.LINE_AA)
    size = LARGE * WIDTH, round(height / SMOOTHING)
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(IMAGES / "fr1_desk.png"), small[:, :, ::-1])


def draw_living_room() -> None:
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
    way, large, small = np.array(poses), of_the_room(LARGE), of_the_room(1)
    save("room.jpg", with_path(picture(cloud, large), way, large, 3), 82)
    bare = picture(cloud, small)
    animation = cv2.Animation()
    animation.frames = [
        np.hstack(
            [
                cv2.resize(matches, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA),
                with_path(bare, way[:count], small, 1),
            ]
        )[:, :, ::-1]
        for matches, count in zip(left, counts, strict=True)
    ]
    animation.durations = [FRAME_MS] * len(left)
    cv2.imwriteanimation(
        str(IMAGES / "living_room.webp"), animation, [cv2.IMWRITE_WEBP_QUALITY, 60]
    )


if __name__ == "__main__":
    if len(sys.argv) > 1:
        draw_desk(Path(sys.argv[1]))
        draw_way(Path(sys.argv[1]))
    else:
        draw_living_room()
