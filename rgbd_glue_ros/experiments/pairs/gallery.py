"""Pictures of registered pairs: both images, and the matches between them."""

from __future__ import annotations

import base64
import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from rgbd_glue_ros.closing import uninterrupted
from rgbd_glue_ros.evaluation.registration_errors import THRESHOLDS
from rgbd_glue_ros.experiments.pairs.evaluation import INLIER_THRESHOLDS_CM, PairResult
from rgbd_glue_ros.experiments.pairs.jobs import pose_at, true_poses
from rgbd_glue_ros.experiments.pairs.methods import PairMethod
from rgbd_glue_ros.experiments.report.escaping import escape
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.fitting import distances
from rgbd_glue_ros.geometry.views import grey, view_of
from rgbd_glue_ros.messages.image_codecs import encode_jpeg
from rgbd_glue_ros.parameters import CameraConfig
from rgbd_glue_ros.recordings import Recording
from rgbd_glue_ros.types import (
    CameraIntrinsics,
    Correspondences,
    Float64,
    RegistrationResult,
    UInt8,
)

logger = logging.getLogger(__name__)

WORST, TYPICAL = 6, 3
CORRECT_M = 0.1
"""A match is shown as correct if the true transform maps its points this close together."""

_WIDTH = 480
_QUALITY = 78
# fraction of an image's contrast that is kept, towards white
_CONTRAST = 0.5
_SPACE = 6
_SHOWN = {"visual": 12, "geometric": 16}

CSS = """
.pairs { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 17rem), 1fr));
  gap: 1.6rem 1.2rem; }
.pair { margin: 0; }
.pair svg { display: block; width: 100%; height: auto; border-radius: 8px;
  background: var(--card); }
.pair line { stroke-width: 2.6; stroke-linecap: round; }
.pair .visual { stroke: #1559d6; } .pair .geometric { stroke: #d07a00; }
.pair .wrong { stroke: #d4142a; }
.pair figcaption { font-size: .85rem; margin-top: .5rem; line-height: 1.4; }
.pair figcaption b { font-variant-numeric: tabular-nums; }
.pair figcaption span { color: var(--quiet); display: block; }
"""


@dataclass(frozen=True)
class Example:
    """A pair to show.

    Attributes:
        figures: its measurements.
        target: the image registered to, uint8 [H, W] or [H, W, 3] RGB.
        source: the image registered, likewise.
        camera: of both images.
        truth: T_target_source, float64 [4, 4].
        result: with the matches.
    """

    figures: PairResult
    target: UInt8
    source: UInt8
    camera: CameraIntrinsics
    truth: Float64
    result: RegistrationResult


def severity(result: PairResult) -> float:
    """Severity of a result: its errors divided by the lowest thresholds of the paper's tables."""
    if result.errors.failed:
        return float("inf")
    rotation = result.errors.rotation_deg / THRESHOLDS["rotation_deg"][0]
    return max(rotation, result.errors.translation_cm / THRESHOLDS["translation_cm"][0])


def chosen(results: Sequence[tuple[Path, PairResult]]) -> list[tuple[Path, PairResult]]:
    """The worst pairs, worst first, and some from the middle, without duplicates."""
    ranked = sorted(results, key=lambda pair: severity(pair[1]), reverse=True)
    worst, rest = ranked[:WORST], ranked[WORST:]
    middle = max(0, len(ranked) // 2 - len(worst) - TYPICAL // 2)
    return worst + rest[middle : middle + TYPICAL]


def examples(
    pairs: Iterable[tuple[Path, PairResult]],
    open_recording: Callable[[Path], Recording],
    method: PairMethod,
    camera: CameraConfig,
) -> list[Example]:
    """Registers pairs once more, for their images and matches; failures are skipped."""
    shown = (_example(path, result, open_recording, method, camera) for path, result in pairs)
    return [example for example in shown if example is not None]


def _example(
    path: Path,
    figures: PairResult,
    open_recording: Callable[[Path], Recording],
    method: PairMethod,
    camera: CameraConfig,
) -> Example | None:
    try:
        with open_recording(path) as recording:
            target, source = recording.select([figures.target, figures.source])
            truth = true_poses(recording)
            poses = [pose_at(truth, frame.stamp_ns) for frame in (target, source)]
        with uninterrupted():
            views = [view_of(frame, camera) for frame in (target, source)]
            described = [method.describe(view) for view in views]
            result = method.register(described[1], described[0])
    except Exception as error:
        logger.debug("cannot draw a pair of %s", path, exc_info=error)
        return None
    if poses[0] is None or poses[1] is None:
        return None
    T = se3.inverse(poses[0]) @ poses[1]
    return Example(figures, target.color, source.color, views[0].intrinsics, T, result)


def gallery(shown: Sequence[Example]) -> str:
    """Figures of the pairs, in their order."""
    return f'<div class="pairs">{"".join(map(_figure, shown))}</div>'


LEGEND = (
    '<div class="legend">'
    '<span class="key" style="--c:#1559d6"><i></i>visual match</span>'
    '<span class="key" style="--c:#d07a00"><i></i>geometric match that the filter kept</span>'
    f'<span class="key" style="--c:#d4142a"><i></i>wrong by more than {100 * CORRECT_M:g} cm</span>'
    "</div>"
)


def _figure(example: Example) -> str:
    height = round(_WIDTH * example.camera.height / example.camera.width)
    images = (
        f'<image href="data:image/jpeg;base64,{_jpeg(image, height)}" y="{y}" '
        f'width="{_WIDTH}" height="{height}"/>'
        for image, y in ((example.target, 0), (example.source, height + _SPACE))
    )
    lines = _lines(example.result.credible, "geometric", example, height)
    lines += _lines(example.result.visual, "visual", example, height)
    # wrong ones on top
    lines.sort(key=lambda line: 'class="wrong"' in line)
    figures = example.figures
    return (
        f'<figure class="pair"><svg viewBox="0 0 {_WIDTH} {2 * height + _SPACE}" role="img" '
        f'aria-label="{escape(figures.recording)}, frames {figures.target} and {figures.source}">'
        f"{''.join(images)}{''.join(lines)}</svg>"
        f"<figcaption><b>{_errors(figures)}</b><span>{escape(figures.recording)}, frames "
        f"{figures.target} and {figures.source}</span><span>{_matches(figures)}</span>"
        "</figcaption></figure>"
    )


def _errors(figures: PairResult) -> str:
    if figures.errors.failed:
        return "no transform"
    errors = figures.errors
    return f"{errors.rotation_deg:.1f}°, {errors.translation_cm:.1f} cm, {errors.chamfer_mm:.2f} mm"


def _matches(figures: PairResult) -> str:
    column = INLIER_THRESHOLDS_CM.index(10)
    visual = f"visual: {figures.visual.amounts[column]} right of {figures.visual.matches}"
    if not figures.before.matches:
        return visual
    kept = " kept" if figures.filtered else ", filter skipped"
    right = figures.after.amounts[column]
    return f"{visual}; geometric: {right} right of {figures.after.matches}{kept}"


def _lines(matches: Correspondences, kind: str, example: Example, height: int) -> list[str]:
    """Lines from the target above to the source below, of some matches spread over all."""
    rows = np.unique(np.linspace(0, len(matches) - 1, _SHOWN[kind]).astype(int))
    some = matches.select(np.asarray(rows[: len(matches)], np.int64))
    is_correct = distances(example.truth, some) <= CORRECT_M
    above = _pixels(some.target, example.camera)
    below = _pixels(some.source, example.camera) + np.array([0, height + _SPACE])
    return [
        f'<line class="{kind if correct else "wrong"}" x1="{x1:.0f}" y1="{y1:.0f}" '
        f'x2="{x2:.0f}" y2="{y2:.0f}"/>'
        for (x1, y1), (x2, y2), correct in zip(above, below, is_correct, strict=True)
    ]


def _pixels(points: Float64, camera: CameraIntrinsics) -> Float64:
    """Positions of points [N, 3] in the picture of width ``_WIDTH``, float64 [N, 2]."""
    x, y, z = points.T
    uv = np.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], axis=1)
    scaled: Float64 = (uv + 0.5) * (_WIDTH / camera.width)
    return scaled


def _jpeg(image: UInt8, height: int) -> str:
    """Grey and light, so that the lines stand out."""
    small = cv2.resize(grey(image), (_WIDTH, height), interpolation=cv2.INTER_AREA)
    light: UInt8 = np.asarray(255 - _CONTRAST * (255 - small.astype(np.float32)), np.uint8)
    return base64.b64encode(encode_jpeg(light, _QUALITY)).decode()
