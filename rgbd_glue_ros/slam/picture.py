"""A picture of a coloured cloud, as seen by an onlooker in the room."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.messages.image_codecs import encode_jpeg
from rgbd_glue_ros.slam.cloud import ColoredCloud
from rgbd_glue_ros.types import Float64, UInt8

RGB = tuple[int, int, int]
PATH_RGB, CAMERA_RGB, PAGE = (29, 95, 209), (207, 47, 60), 246

# of the width of the picture
_FOCAL = 0.95
_NEAREST_M = 0.3
# drawn at twice the size and smoothed
_JPEG_WIDTH, _JPEG_HEIGHT, _JPEG_QUALITY = 880, 560, 80
# of the pinhole that a camera is drawn as, and half the width of a point, metres
_EYE_M, _SPLAT_M = 0.09, 0.009
# position of the onlooker: height above the cameras' line of sight, and the percentage of points
# that must be in the picture
_RISE, _INSIDE = 0.55, 90


@dataclass(frozen=True)
class Onlooker:
    """An onlooker who views a room.

    Attributes:
        T_view_room: float64 [4, 4], from the room to the optical frame of the eye.
        width: of the picture, pixels.
        height: of the picture, pixels.
    """

    T_view_room: Float64
    width: int
    height: int

    @staticmethod
    def at(eye: Float64, target: Float64, up: Float64, width: int, height: int) -> Onlooker:
        """An onlooker at ``eye`` [3] who views ``target`` [3], with the given up direction [3]."""
        forward = target - eye
        z = forward / np.linalg.norm(forward)
        x = np.cross(z, up)
        x /= np.linalg.norm(x)
        T_room_view = se3.from_rotation_translation(np.stack([x, np.cross(z, x), z], axis=1), eye)
        return Onlooker(np.asarray(se3.inverse(T_room_view)), width, height)

    @staticmethod
    def of(cloud: ColoredCloud, poses: Float64, width: int, height: int) -> Onlooker:
        """An onlooker behind and above the cameras, far enough away to see most of the cloud.

        Args:
            cloud: with at least one point.
            poses: T_room_camera of the cameras, float64 [N, 4, 4], upright in the mean.
            width: of the picture, pixels.
            height: of the picture, pixels.
        """
        points = cloud.points.astype(np.float64)
        target = np.median(points, axis=0)
        up = -poses[:, :3, 1].mean(axis=0)
        up /= np.linalg.norm(up)
        ahead = target - poses[:, :3, 3].mean(axis=0)
        ahead -= (ahead @ up) * up
        if np.linalg.norm(ahead) < _NEAREST_M:  # the cameras went around it
            ahead = poses[0, :3, 2] - (poses[0, :3, 2] @ up) * up
        back = _RISE * up - ahead / np.linalg.norm(ahead)
        extent = float(np.percentile(np.linalg.norm(points - target, axis=1), _INSIDE))
        away = 2 * _FOCAL * width / min(width, height) * extent
        return Onlooker.at(target + away * back / np.linalg.norm(back), target, up, width, height)

    def sees(self, points: Float64) -> tuple[Float64, Float64]:
        """Positions of points [N, 3] in the picture, pixels [N, 2], and distances, metres [N]."""
        x, y, z = se3.transform(self.T_view_room, points).T
        safe = np.maximum(z, 1e-3)
        focal = _FOCAL * self.width
        centre = self.width / 2, self.height / 2
        return np.stack([focal * x / safe + centre[0], focal * y / safe + centre[1]], axis=1), z


def picture(cloud: ColoredCloud, onlooker: Onlooker) -> UInt8:
    """The cloud on a light background, uint8 [H, W, 3] RGB; points are squares, nearest on top."""
    width, height = onlooker.width, onlooker.height
    image = np.full((height, width, 3), PAGE, np.uint8)
    uv, z = onlooker.sees(cloud.points.astype(np.float64))
    seen = np.flatnonzero(z > _NEAREST_M)
    seen = seen[np.argsort(-z[seen], kind="stable")]
    sizes = np.maximum(np.rint(_SPLAT_M * _FOCAL * width / z[seen]), 1.0)
    for i, size in zip(seen.tolist(), sizes.astype(int).tolist(), strict=True):
        u, v = int(uv[i, 0]), int(uv[i, 1])
        if -size < u < width + size and -size < v < height + size:
            image[max(0, v - size) : max(0, v + size), max(0, u - size) : max(0, u + size)] = (
                cloud.colors[i]
            )
    return image


def with_path(image: UInt8, poses: Float64, onlooker: Onlooker, thickness: int) -> UInt8:
    """The picture with the camera's path, and the camera at its end.

    Args:
        image: of ``onlooker``, uint8 [H, W, 3]; a copy is drawn on.
        poses: T_room_camera, float64 [N, 4, 4], at least one.
        onlooker: the onlooker.
        thickness: of the lines, pixels.
    """
    drawn: UInt8 = image.copy()
    way = poses[:, :3, 3]
    _draw(drawn, onlooker, way, PATH_RGB, thickness)
    corners = _EYE_M * np.array(
        [[x, y, 1.3] for x, y in ((-1, -0.75), (1, -0.75), (1, 0.75), (-1, 0.75))]
    )
    ends = se3.transform(poses[-1], corners)
    for i in range(4):
        triangle = np.stack([way[-1], ends[i], ends[(i + 1) % 4], way[-1]])
        _draw(drawn, onlooker, triangle, CAMERA_RGB, thickness)
    return drawn


def _draw(image: UInt8, onlooker: Onlooker, line: Float64, rgb: RGB, thickness: int) -> None:
    """Draws the parts of a line through points [N, 3] that are in front of the eye."""
    uv, z = onlooker.sees(line)
    visible = z > _NEAREST_M
    for part in np.split(np.arange(len(line)), np.flatnonzero(np.diff(visible)) + 1):
        if visible[part[0]]:
            cv2.polylines(image, [np.int32(16 * uv[part])], False, rgb, thickness, cv2.LINE_AA, 4)


def map_jpeg(cloud: ColoredCloud, poses: Float64) -> bytes:
    """A small JPEG of a map with the camera's path; empty for an empty cloud.

    Args:
        cloud: in the frame of the poses.
        poses: T_room_camera, float64 [N, 4, 4].
    """
    if not len(cloud):
        return b""
    onlooker = Onlooker.of(cloud, poses, 2 * _JPEG_WIDTH, 2 * _JPEG_HEIGHT)
    large = with_path(picture(cloud, onlooker), poses, onlooker, 5)
    small = cv2.resize(large, (_JPEG_WIDTH, _JPEG_HEIGHT), interpolation=cv2.INTER_AREA)
    return encode_jpeg(small[:, :, ::-1], _JPEG_QUALITY)
