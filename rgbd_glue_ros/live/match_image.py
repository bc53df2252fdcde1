"""An image of the matches that a pose was computed from, for people to look at."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros.geometry.camera import project
from rgbd_glue_ros.geometry.views import rectified
from rgbd_glue_ros.types import (
    CameraIntrinsics,
    Correspondences,
    OdometryEstimate,
    RegistrationResult,
    RgbdFrame,
    UInt8,
)

# Colours (RGB) that are distinct for people with red-green colour blindness too.
VISUAL = (255, 210, 0)
CREDIBLE = (70, 160, 255)
REJECTED = (230, 50, 40)
_TEXT = (255, 255, 255)
_FONT = cv2.FONT_HERSHEY_SIMPLEX
# Fractional bits of the coordinates that OpenCV draws at.
_SHIFT = 4
# Brightness of the image, so that lines stand out.
_DIMMED = 0.6
# Drawn matches of each kind, at most: more would hide the image and take time.
_MOST_DRAWN = 200


def match_image(frame: RgbdFrame, estimate: OdometryEstimate) -> UInt8:
    """The frame's colour image [H, W, 3] RGB with its matches, state and epsilon.

    Each match is a line from the point's pixel in the keyframe's image to its pixel in this one,
    where it ends in a dot. If there are many matches, only some are drawn; the numbers count all.

    Args:
        frame: the frame.
        estimate: the estimate of the frame.
    """
    frame = rectified(frame)
    color = frame.color if frame.color.ndim == 3 else np.dstack([frame.color] * 3)
    image = np.asarray(cv2.convertScaleAbs(color, alpha=_DIMMED), np.uint8)
    result = estimate.registration
    if result is not None:
        kinds = (
            (rejected(result), REJECTED),
            (result.credible, CREDIBLE),
            (result.visual_inliers, VISUAL),
        )
        for matches, rgb in kinds:
            _draw(image, matches, frame.intrinsics, rgb)
    _write(image, estimate)
    return image


def rejected(result: RegistrationResult) -> Correspondences:
    """The geometric matches that are not credible, which equation 8 removes."""
    credible = {row.tobytes() for row in _rows(result.credible)}
    rows = [row.tobytes() not in credible for row in _rows(result.geometric)]
    return result.geometric.select(np.array(rows, bool))


def drawn(matches: Correspondences) -> Correspondences:
    """The matches to draw: every n-th of those in front of both cameras."""
    visible = matches.select((matches.source[:, 2] > 0) & (matches.target[:, 2] > 0))
    return visible.select(np.arange(0, len(visible), max(1, -(-len(visible) // _MOST_DRAWN))))


def _rows(matches: Correspondences) -> NDArray[np.float64]:
    return np.hstack([matches.source, matches.target])


def _draw(
    image: UInt8, matches: Correspondences, camera: CameraIntrinsics, rgb: tuple[int, int, int]
) -> None:
    some = drawn(matches)
    if not len(some):
        return
    ends = [project(points, camera) for points in (some.target, some.source)]
    lines = np.round(np.stack(ends, axis=1) * 2**_SHIFT).astype(np.int32)
    cv2.polylines(image, list(lines), False, rgb, 1, cv2.LINE_AA, _SHIFT)
    for _, end in lines:
        cv2.circle(image, end.tolist(), 3 << (_SHIFT - 1), rgb, -1, cv2.LINE_AA, _SHIFT)


def _write(image: UInt8, estimate: OdometryEstimate) -> None:
    words = [(estimate.state.value.upper(), _TEXT)]
    result = estimate.registration
    if result is not None:
        epsilon = f"eps {result.epsilon_m * 100:.1f} cm" if result.filtered else "not filtered"
        words += [
            (epsilon, _TEXT),
            (f"{len(result.visual_inliers)} visual", VISUAL),
            (f"{len(result.credible)} credible", CREDIBLE),
            (f"{len(result.geometric) - len(result.credible)} rejected", REJECTED),
        ]
    scale = image.shape[1] / 1250
    (_, height), _ = cv2.getTextSize("X", _FONT, scale, 1)
    image[: 2 * height + 2] //= 3
    x = height
    for text, rgb in words:
        cv2.putText(image, text, (x, round(1.5 * height)), _FONT, scale, rgb, 1, cv2.LINE_AA)
        x += cv2.getTextSize(text, _FONT, scale, 1)[0][0] + 2 * height
