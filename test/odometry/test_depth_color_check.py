"""Depth that is not registered to its colour is noticed, and nothing else is."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterable
from dataclasses import replace

import cv2
import numpy as np
import pytest
from rigs.bag_frames import errors, recorded_frames, true_poses
from rigs.unseen import without_depth

from rgbd_glue_ros.geometry import se3, views
from rgbd_glue_ros.odometry.depth_color_check import DepthColorCheck
from rgbd_glue_ros.odometry.edge_overlay import Orientation
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.parameters import Config, with_values
from rgbd_glue_ros.types import Float32, RgbdFrame, View

ENOUGH = 8
# If depth does not fit at first, more is tried.
LONG_ENOUGH = 16


def view(frame: RgbdFrame) -> View:
    return View(views.grey(frame.color), frame.depth, frame.intrinsics)


def laid(depth: Float32, scale: float, right: float, down: float) -> Float32:
    """A depth image as it is magnified about its centre and then shifted, in pixels."""
    height, width = depth.shape
    cx, cy = (width - 1) / 2, (height - 1) / 2
    M = np.array([[scale, 0, cx * (1 - scale) + right], [0, scale, cy * (1 - scale) + down]])
    unknown = (float("nan"),) * 4
    moved = cv2.warpAffine(depth, M, (width, height), flags=cv2.INTER_NEAREST, borderValue=unknown)
    return np.asarray(moved, np.float32)


def unregistered(scale: float, right: float, down: float) -> list[RgbdFrame]:
    return [replace(f, depth=laid(f.depth, scale, right, down)) for f in recorded_frames()]


def after_views(frames: list[RgbdFrame]) -> DepthColorCheck:
    check = DepthColorCheck.start()
    for frame in frames:
        if check.placement is None:
            check = check.after_view(view(frame), np.eye(4))
    return check


def spread(frames: Iterable[RgbdFrame], count: int) -> list[RgbdFrame]:
    """So many of the recorded frames, from different places."""
    return list(frames)[:: 96 // count][:count]


def test_registered_depth_is_recognised(caplog: pytest.LogCaptureFixture) -> None:
    check = after_views(spread(recorded_frames(), ENOUGH))
    assert check.views == ENOUGH
    assert check.placement is None
    assert not caplog.records


@pytest.mark.parametrize(
    ("scale", "right", "down", "offset_px"),
    [(1.0, 12.0, 0.0, 12.0), (1.0, -6.0, 9.0, 10.8), (1.1, 0.0, 0.0, 14.0), (1.1, 6.0, 0.0, 15.5)],
)
def test_unregistered_depth_is_detected_and_logged_once(
    scale: float, right: float, down: float, offset_px: float, caplog: pytest.LogCaptureFixture
) -> None:
    frames = spread(unregistered(scale, right, down), LONG_ENOUGH)
    assert after_views(frames[: ENOUGH - 1]).placement is None
    found = after_views(frames).placement
    assert found is not None
    # the steps tried are 3 pixels and up to 5.5 %
    assert abs(found.offset_px - offset_px) < 5
    (record,) = caplog.records
    assert record.levelno == logging.WARNING
    assert "not registered" in record.message


def enlarged(frame: RgbdFrame, times: int) -> RgbdFrame:
    return replace(
        frame,
        color=frame.color.repeat(times, axis=0).repeat(times, axis=1),
        depth=frame.depth.repeat(times, axis=0).repeat(times, axis=1),
        intrinsics=frame.intrinsics.scaled(
            times * frame.intrinsics.width, times * frame.intrinsics.height
        ),
    )


def test_in_large_images_edges_may_be_farther_apart(caplog: pytest.LogCaptureFixture) -> None:
    frames = spread(unregistered(1.0, 6.0, 0.0), LONG_ENOUGH)
    of_640, of_1920 = (
        after_views([enlarged(f, times) for f in frames]).placement for times in (2, 6)
    )
    assert of_640 is not None
    assert abs(of_640.offset_px - 12.0) < 5
    assert of_1920 == of_640
    small, large = (int(re.findall(r"(\d+) pixels", r.message)[0]) for r in caplog.records)
    assert large == 3 * small


@pytest.mark.parametrize("scale", [0.65, 1.25, 1.6])
def test_depth_of_another_field_of_view_is_detected(
    scale: float, caplog: pytest.LogCaptureFixture
) -> None:
    found = after_views(spread(unregistered(scale, 0.0, 0.0), LONG_ENOUGH)).placement
    assert found is not None
    assert found.orientation is Orientation.ALIKE
    assert found.scale * scale == pytest.approx(1.0, rel=0.06)
    (record,) = caplog.records
    assert "not registered" in record.message


@pytest.mark.parametrize(
    ("turn", "says"),
    [(np.s_[:, ::-1], "are mirrored against"), (np.s_[::-1, ::-1], "are upside down against")],
)
@pytest.mark.parametrize("image", ["color", "depth"])
def test_an_image_that_the_driver_mirrors_or_turns_is_told(
    image: str, turn: tuple[slice, ...], says: str, caplog: pytest.LogCaptureFixture
) -> None:
    frames = spread(recorded_frames(), LONG_ENOUGH)
    turned = [replace(f, **{image: getattr(f, image)[turn].copy()}) for f in frames]
    after_views(turned)
    (record,) = caplog.records
    assert says in record.message


def test_images_of_different_rooms_fit_nowhere(caplog: pytest.LogCaptureFixture) -> None:
    frames = spread(recorded_frames(), LONG_ENOUGH)
    # no driver mirrors an image upside down
    check = after_views([replace(f, color=f.color[::-1].copy()) for f in frames])
    assert not check.needs(view(frames[0]), se3.exp(np.full(6, 1.0)))
    assert check.placement is None
    assert not caplog.records


def test_a_view_with_few_edges_is_skipped() -> None:
    frame = recorded_frames()[0]
    wall = replace(frame, depth=np.full_like(frame.depth, 2.0))
    unknown = without_depth(frame)
    check = after_views([wall, unknown])
    assert check.views == 0
    assert check.placement is None


def test_only_views_from_different_poses_count_until_there_are_enough() -> None:
    frame, here = recorded_frames()[0], np.eye(4)
    check = DepthColorCheck.start()
    assert check.needs(view(frame), here)
    check = check.after_view(view(frame), here)
    assert not check.needs(view(frame), here)
    assert check.needs(view(frame), se3.exp(np.array([0.1, 0, 0, 0, 0, 0])))
    for _ in range(ENOUGH - 1):
        check = check.after_view(view(frame), here)
    assert not check.needs(view(frame), se3.exp(np.array([0.1, 0, 0, 0, 0, 0])))


@pytest.mark.slow
def test_the_odometry_trusts_colour_less_once_depth_is_known_to_be_unregistered(
    caplog: pytest.LogCaptureFixture,
) -> None:
    frames = unregistered(1.1, 6.0, 0.0)
    # depth that is magnified was taken by a camera that magnifies
    K = frames[0].intrinsics
    K = replace(K, fx=1.1 * K.fx, fy=1.1 * K.fy, cx=K.cx + 6.0)

    def error(weight: float) -> float:
        config = with_values(Config(), {"refine.unregistered_weight": weight})
        odometry = Odometry(config)
        metres, _ = errors(
            [odometry.process(replace(f, intrinsics=K)) for f in frames], true_poses()
        )
        assert np.isfinite(metres).all()
        return float(np.mean(metres[-40:]))

    assert error(1.0) < error(100.0)
    assert len([r for r in caplog.records if "not registered" in r.message]) == 2


def test_a_view_with_late_depth_during_a_turn_is_skipped() -> None:
    late = replace(view(recorded_frames()[0]), depth_delay=0.03)
    turning = replace(late, twist=np.array([0, 0, 0, 0, 0.8, 0]))
    moving = replace(late, twist=np.array([0.8, 0, 0, 0, 0, 0]))
    check = DepthColorCheck.start()
    assert check.needs(late, np.eye(4))
    assert check.needs(replace(turning, depth_delay=0.001), np.eye(4))
    assert not check.needs(turning, np.eye(4))
    assert not check.needs(moving, np.eye(4))
