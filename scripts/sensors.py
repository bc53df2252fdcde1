"""What light, sensors and drivers do to a recording, and what that does to the odometry: a table.

``python scripts/sensors.py RECORDING...`` changes the frames in one way after another and prints
APE in cm, and the frames lost. ``--only haze`` does one, ``--set`` changes a parameter of all.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from rgbd_glue_ros import Odometry, RgbdFrame, load_preset, open_recording
from rgbd_glue_ros.experiments.bench.degraded import Degradation, DegradedSequence, dim, in_levels
from rgbd_glue_ros.experiments.bench.figures import errors, losses, trajectory_of
from rgbd_glue_ros.experiments.bench.robot_part import with_robot_part
from rgbd_glue_ros.experiments.report.markdown import NOTHING, table
from rgbd_glue_ros.geometry.views import grey
from rgbd_glue_ros.odometry.warm_up import warm_up
from rgbd_glue_ros.parameters import Config, with_values
from rgbd_glue_ros.parameters.files import parse_assignment
from rgbd_glue_ros.recordings import Recording
from rgbd_glue_ros.types import Float32, Float64

Rng = np.random.Generator

# A stereo camera of 5 cm with errors of an eighth of a pixel, in steps of a sixteenth.
STEREO_BASELINE_M, STEREO_SIGMA_PX, STEREO_STEPS_PER_PX = 0.05, 0.12, 16
# Pixels for one dot of a projector.
DOT_PX = 60


def each(name: str, change: Callable[[RgbdFrame, Rng], RgbdFrame]) -> Degradation:
    """Every frame changed, whatever was before it."""

    def apply(frames: Iterable[RgbdFrame], _: int) -> Iterator[RgbdFrame]:
        rng = np.random.default_rng(0)
        return (change(frame, rng) for frame in frames)

    return Degradation(name, apply)


def other_depth(name: str, change: Callable[[RgbdFrame, Rng], Float64]) -> Degradation:
    """Other depth in every frame."""

    def changed(frame: RgbdFrame, rng: Rng) -> RgbdFrame:
        return replace(frame, depth=np.asarray(change(frame, rng), np.float32))

    return each(name, changed)


def with_lamp(frames: Iterable[RgbdFrame], count: int) -> Iterator[RgbdFrame]:
    """An eighth of the light, and a lamp that moves with the camera."""
    for frame in dim(0.12).apply(frames, count):
        height, width = frame.depth.shape
        frame.color[height // 12 : height // 4, 3 * width // 4 : 15 * width // 16] = 250
        yield frame


def flickering(frame: RgbdFrame, rng: Rng) -> RgbdFrame:
    """An exposure that is up to half as much more or less."""
    return replace(frame, color=in_levels(rng.uniform(0.5, 1.5) * frame.color))


def as_jpeg(frame: RgbdFrame, _: Rng) -> RgbdFrame:
    """Colour compressed to a quality of 15."""
    data = cv2.imencode(".jpg", frame.color, [cv2.IMWRITE_JPEG_QUALITY, 15])[1]
    return replace(frame, color=np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8))


def jittered(frame: RgbdFrame, rng: Rng) -> RgbdFrame:
    """A stamp that is up to 10 ms off."""
    return replace(frame, stamp_ns=frame.stamp_ns + int(rng.uniform(-1e7, 1e7)))


def twice(frames: Iterable[RgbdFrame], _: int) -> Iterator[RgbdFrame]:
    """Every frame comes again 16 ms later."""
    for frame in frames:
        yield frame
        yield replace(frame, stamp_ns=frame.stamp_ns + 16_000_000)


def with_dots(frames: Iterable[RgbdFrame], _: int) -> Iterator[RgbdFrame]:
    """Infrared with the dots of a projector, as good as fixed to the camera."""
    rng = np.random.default_rng(0)
    dots: Float64 | None = None
    for frame in frames:
        if dots is None:
            height, width = frame.depth.shape
            dots = np.zeros((height, width))
            count = dots.size // DOT_PX
            dots[rng.integers(0, height, count), rng.integers(0, width, count)] = 400
            dots = np.asarray(cv2.GaussianBlur(dots, (0, 0), 0.8), np.float64)
        yield replace(frame, color=in_levels(0.6 * grey(frame.color) + dots))


def stereo(frame: RgbdFrame, rng: Rng) -> Float64:
    """The noise of stereo, alike in neighbouring pixels."""
    noise = cv2.GaussianBlur(rng.normal(0, 1, frame.depth.shape), (0, 0), 2.5)
    base = frame.intrinsics.fx * STEREO_BASELINE_M
    disparity = base / frame.depth + noise * (STEREO_SIGMA_PX / noise.std())
    rounded = np.rint(disparity * STEREO_STEPS_PER_PX) / STEREO_STEPS_PER_PX
    return base / np.where(rounded > 0, rounded, np.nan)


def in_centimetres(frame: RgbdFrame, _: Rng) -> Float64:
    """In steps of a centimetre."""
    return np.rint(100.0 * frame.depth.astype(np.float64)) / 100


def smeared(frame: RgbdFrame, _: Rng) -> Float64:
    """As a phone has it: 256x192, made larger again, smeared over edges."""
    height, width = frame.depth.shape
    known = np.isfinite(frame.depth)
    depth, share = (
        cv2.resize(cv2.resize(image, (256, 192), interpolation=cv2.INTER_AREA), (width, height))
        for image in (np.where(known, frame.depth, 0).astype(np.float64), known.astype(np.float64))
    )
    return np.where(share > 0.5, depth / np.maximum(share, 0.5), np.nan)


def speckled(frame: RgbdFrame, rng: Rng) -> Float64:
    """Anything in every twentieth pixel."""
    wrong = rng.random(frame.depth.shape) < 0.05
    return np.where(wrong, rng.uniform(0.3, 6.0, frame.depth.shape), frame.depth)


def averaged(frames: Iterable[RgbdFrame], _: int) -> Iterator[RgbdFrame]:
    """Depth that a driver has averaged with that of the frames before, where it is within 10 cm."""
    before: Float32 | None = None
    for frame in frames:
        depth = frame.depth
        if before is not None:
            near = np.abs(before - depth) < 0.1
            depth = np.where(near, 0.6 * before + 0.4 * depth, depth).astype(np.float32)
        before = depth
        yield replace(frame, depth=depth)


def late_depth(frames: Iterable[RgbdFrame], _: int) -> Iterator[RgbdFrame]:
    """Each frame with the depth of the one before, and no word of that."""
    before: Float32 | None = None
    for frame in frames:
        if before is not None:
            yield replace(frame, depth=before)
        before = frame.depth


def of_unknown_camera(frames: Iterable[RgbdFrame], count: int) -> Iterator[RgbdFrame]:
    """The same by a camera whose times are not known beforehand."""
    return (replace(frame, frame_id="camera") for frame in late_depth(frames, count))


CHANGES = {
    change.name: change
    for change in (
        each("as recorded", lambda frame, _: frame),
        replace(dim(0.12, noise=3.0), name="an eighth of the light"),
        replace(dim(0.04, noise=1.5), name="a twenty-fifth of the light"),
        Degradation("an eighth of the light, and a lamp", with_lamp),
        replace(dim(0.12, noise=1.5, haze=110.0), name="haze"),
        each("exposure flickers", flickering),
        replace(dim(1.0, noise=12.0), name="noise of 12 grey levels"),
        each("colour as JPEG of quality 15", as_jpeg),
        Degradation("dots of a projector", with_dots),
        each("stamps 10 ms off", jittered),
        Degradation("every frame twice", twice, lambda count: 2 * count),
        other_depth("depth of stereo", stereo),
        other_depth("depth in centimetres", in_centimetres),
        other_depth("depth of 256x192, smeared", smeared),
        other_depth("a twentieth of depth wrong", speckled),
        Degradation("depth averaged over frames", averaged),
        Degradation("depth of the frame before", late_depth),
        Degradation("depth of the frame before, of an unknown camera", of_unknown_camera),
        each("a part of the robot in view", with_robot_part),
    )
}


def tracked(recording: Recording, change: Degradation, config: Config) -> str:
    """APE in cm and the frames lost, in words."""
    with Odometry(config) as odometry:
        estimates = [odometry.process(frame) for frame in DegradedSequence(recording, change)]
    found = errors(trajectory_of(estimates), recording.ground_truth)
    lost = losses(estimates)["lost"]
    error = f"{100 * found['ape']['rmse_m']:.2f}" if found else NOTHING
    return error + (f" ({lost} lost)" if lost else "")


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
            with open_recording(path) as recording:
                rows[-1].append(tracked(recording, CHANGES[name], config))
            print(f"{name}  {path.name}  {rows[-1][-1]}", file=sys.stderr)
    print(table(["", *(path.name for path in args.recordings)], rows))


if __name__ == "__main__":
    main()
