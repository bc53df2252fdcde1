"""What light, sensors and drivers do to a recording, and what that does to the odometry: a table.

``python scripts/sensors.py RECORDING...`` changes the frames in one way after another and prints
APE in cm, and the frames lost. ``--only haze`` does one, ``--set`` changes a parameter of all.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros import Odometry, RgbdFrame, Trajectory, evaluate, load_preset, open_recording
from rgbd_glue_ros.experiments.report.markdown import table
from rgbd_glue_ros.odometry.warm_up import warm_up
from rgbd_glue_ros.parameters import Config, with_values
from rgbd_glue_ros.parameters.files import parse_assignment
from rgbd_glue_ros.types import Float32, Float64, UInt8

Frames = Iterable[RgbdFrame]
Change = Callable[[Frames, np.random.Generator], Iterator[RgbdFrame]]

# A stereo camera of 5 cm with errors of an eighth of a pixel, in steps of a sixteenth.
STEREO_BASELINE_M, STEREO_SIGMA_PX, STEREO_STEPS_PER_PX = 0.05, 0.12, 16
# As near as a gripper or a bumper.
OWN_PART_M = 0.35


def levels(brightness: NDArray[np.floating[Any]]) -> UInt8:
    """Brightness as an image has it."""
    return np.asarray(np.clip(np.rint(brightness), 0, 255), np.uint8)


def light(part: float, noise: float, haze: float = 0.0) -> Change:
    """A part of the light, the noise of the camera, and haze, in grey levels."""

    def changed(frames: Frames, rng: np.random.Generator) -> Iterator[RgbdFrame]:
        for frame in frames:
            noisy = part * frame.color + haze + rng.normal(0, noise, frame.color.shape)
            yield replace(frame, color=levels(noisy))

    return changed


def lamp(frames: Frames, rng: np.random.Generator) -> Iterator[RgbdFrame]:
    """An eighth of the light, and a lamp that moves with the camera."""
    dark = light(0.12, 2.0)
    for frame in dark(frames, rng):
        height, width = frame.depth.shape
        frame.color[height // 12 : height // 4, 3 * width // 4 : 15 * width // 16] = 250
        yield frame


def flicker(frames: Frames, rng: np.random.Generator) -> Iterator[RgbdFrame]:
    """An exposure that is half as much more or less in every frame."""
    for frame in frames:
        yield replace(frame, color=levels(rng.uniform(0.5, 1.5) * frame.color))


def jpeg(frames: Frames, _: np.random.Generator) -> Iterator[RgbdFrame]:
    """Colour compressed to a quality of 15."""
    for frame in frames:
        data = cv2.imencode(".jpg", frame.color, [cv2.IMWRITE_JPEG_QUALITY, 15])[1]
        yield replace(frame, color=np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8))


def twice(frames: Frames, _: np.random.Generator) -> Iterator[RgbdFrame]:
    """Every frame comes again 16 ms later."""
    for frame in frames:
        yield frame
        yield replace(frame, stamp_ns=frame.stamp_ns + 16_000_000)


def jitter(frames: Frames, rng: np.random.Generator) -> Iterator[RgbdFrame]:
    """Stamps that are up to 10 ms off."""
    for frame in frames:
        yield replace(frame, stamp_ns=frame.stamp_ns + int(rng.uniform(-1e7, 1e7)))


def depth_changed(change: Callable[[Float32, RgbdFrame, np.random.Generator], Float64]) -> Change:
    """Other depth in every frame."""

    def changed(frames: Frames, rng: np.random.Generator) -> Iterator[RgbdFrame]:
        for frame in frames:
            depth = np.asarray(change(frame.depth, frame, rng), np.float32)
            yield replace(frame, depth=depth)

    return changed


def stereo(depth: Float32, frame: RgbdFrame, rng: np.random.Generator) -> Float64:
    """The noise of stereo, alike in neighbouring pixels."""
    noise = cv2.GaussianBlur(rng.normal(0, 1, depth.shape), (0, 0), 2.5)
    base = frame.intrinsics.fx * STEREO_BASELINE_M
    disparity = base / depth + noise * (STEREO_SIGMA_PX / noise.std())
    rounded = np.rint(disparity * STEREO_STEPS_PER_PX) / STEREO_STEPS_PER_PX
    return base / np.where(rounded > 0, rounded, np.nan)


def centimetres(depth: Float32, _: RgbdFrame, __: np.random.Generator) -> Float64:
    """In steps of a centimetre."""
    return np.rint(100.0 * depth.astype(np.float64)) / 100


def smoothed(depth: Float32, _: RgbdFrame, __: np.random.Generator) -> Float64:
    """As a phone has it: 256x192, made larger again, smeared over edges."""
    height, width = depth.shape
    known = np.isfinite(depth)
    blurred = [
        cv2.resize(cv2.resize(image, (256, 192), interpolation=cv2.INTER_AREA), (width, height))
        for image in (np.where(known, depth, 0).astype(np.float64), known.astype(np.float64))
    ]
    return np.where(blurred[1] > 0.5, blurred[0] / np.maximum(blurred[1], 0.5), np.nan)


def speckled(depth: Float32, _: RgbdFrame, rng: np.random.Generator) -> Float64:
    """Anything in every twentieth pixel."""
    wrong = rng.random(depth.shape) < 0.05
    return np.where(wrong, rng.uniform(0.3, 6.0, depth.shape), depth)


def averaged(frames: Frames, _: np.random.Generator) -> Iterator[RgbdFrame]:
    """Depth that a driver has averaged with that of the frames before, where it is within 10 cm."""
    before: Float32 | None = None
    for frame in frames:
        depth = frame.depth
        if before is not None:
            near = np.abs(before - depth) < 0.1
            depth = np.where(near, 0.6 * before + 0.4 * depth, depth).astype(np.float32)
        before = depth
        yield replace(frame, depth=depth)


def own_part(frames: Frames, rng: np.random.Generator) -> Iterator[RgbdFrame]:
    """A grey part of the robot below, and a finger up to the middle: they move with the camera."""
    for frame in frames:
        height, width = frame.depth.shape
        v, u = np.mgrid[:height, :width]
        finger = (np.abs(u - width / 2) < 0.08 * width) & (v > height / 2)
        own = (v > 0.75 * height) | finger
        depth = OWN_PART_M + 0.1 * (1 - v / height) + rng.normal(0, 0.001, own.shape)
        color = levels(56 + 6 * np.sin(u / 20) + rng.normal(0, 2, own.shape))
        yield replace(
            frame,
            color=np.where(own[..., np.newaxis], color[..., np.newaxis], frame.color),
            depth=np.where(own, depth, frame.depth).astype(np.float32),
        )


CHANGES: Mapping[str, Change] = {
    "as recorded": lambda frames, _: iter(frames),
    "an eighth of the light": light(0.12, 3.0),
    "a twenty-fifth of the light": light(0.04, 1.5),
    "an eighth of the light, and a lamp": lamp,
    "haze": light(0.12, 1.5, 110.0),
    "exposure flickers": flicker,
    "noise of 12 grey levels": light(1.0, 12.0),
    "colour as JPEG of quality 15": jpeg,
    "stamps 10 ms off": jitter,
    "every frame twice": twice,
    "depth of stereo": depth_changed(stereo),
    "depth in centimetres": depth_changed(centimetres),
    "depth of 256x192, smeared": depth_changed(smoothed),
    "a twentieth of depth wrong": depth_changed(speckled),
    "depth averaged over frames": averaged,
    "a part of the robot in view": own_part,
}


def tracked(path: Path, change: Change, config: Config) -> str:
    """APE in cm and the frames lost, in words."""
    stamps, poses, lost = [], [], 0
    with open_recording(path) as recording, Odometry(config) as odometry:
        for frame in change(recording, np.random.default_rng(0)):
            estimate = odometry.process(frame)
            if estimate.T_odom_camera is None:
                lost += 1
                continue
            stamps.append(estimate.stamp_ns)
            poses.append(estimate.T_odom_camera)
        truth = recording.ground_truth
    said = f" ({lost} lost)" if lost else ""
    if truth is None or len(poses) < 3:
        return f"–{said}"
    errors = evaluate(Trajectory(np.array(stamps), np.array(poses)), truth)
    return f"{100 * errors.ape.rmse_m:.2f}{said}"


def main() -> None:
    """Measures, and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recordings", metavar="RECORDING", nargs="+", type=Path)
    parser.add_argument("--only", metavar="CHANGE", action="append", choices=CHANGES)
    parser.add_argument("--set", metavar="KEY=VALUE", action="append", default=[])
    args = parser.parse_args()
    config = with_values(load_preset("live"), dict(map(parse_assignment, args.set)))
    warm_up(config)
    rows = []
    for name in args.only or CHANGES:
        rows.append([name])
        for path in args.recordings:
            rows[-1].append(tracked(path, CHANGES[name], config))
            print(f"{name}  {path.name}  {rows[-1][-1]}", file=sys.stderr)
    print(table(["", *(path.name for path in args.recordings)], rows))


if __name__ == "__main__":
    main()
