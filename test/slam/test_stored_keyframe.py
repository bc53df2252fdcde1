"""A map keeps its keyframes small, and compares them as if they had been kept as they were."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np
import pytest
from rigs.bag_frames import recorded_frames
from rigs.drifted import config, drifted

from rgbd_glue_ros.geometry.views import view_of
from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.slam.live_map import LiveMap, PublishedKeyframe
from rgbd_glue_ros.slam.map_keyframe import MapKeyframe
from rgbd_glue_ros.slam.packed_view import packed
from rgbd_glue_ros.slam.stored_keyframe import StoredKeyframe, WholeKeyframes
from rgbd_glue_ros.types import Float32, View


def seen(row: int) -> MapKeyframe:
    """A keyframe known only by its view."""
    frame = recorded_frames()[row]
    view = view_of(frame, config().camera)
    return MapKeyframe.seen(row, frame.stamp_ns, np.eye(4), view, Glue(config()), config())


def stored(keyframe: MapKeyframe) -> StoredKeyframe:
    view = packed(keyframe.features.view)
    return StoredKeyframe.of_view(keyframe, view, config().refine.grid_step)


def assert_same(one: MapKeyframe, other: MapKeyframe) -> None:
    """All that is compared of two keyframes has the same bits."""
    np.testing.assert_array_equal(one.features.view.grey, other.features.view.grey)
    bits = other.features.view.depth.view(np.uint32)
    np.testing.assert_array_equal(one.features.view.depth.view(np.uint32), bits)
    points = [(k.model.planes, *k.model.pixels) for k in (one, other)]
    for mine, yours in zip(*points, strict=True):
        for field in fields(mine):
            np.testing.assert_array_equal(getattr(mine, field.name), getattr(yours, field.name))
    assert one.features.visual is other.features.visual
    assert one.features.geometric is other.features.geometric


def noise() -> Float32:
    return np.random.default_rng(0).uniform(0.1, 8.0, (480, 640)).astype(np.float32)


def odd_numbers() -> Float32:
    rows = [[0.0, -0.0, np.inf, -np.inf], [np.nan, -np.nan, 1e-40, 3.0]]
    return np.array(rows, np.float32)


# made by the test that wants one, as all tests are collected by each process
DEPTHS: dict[str, Callable[[], Float32]] = {
    "of a camera": lambda: recorded_frames()[0].depth,
    "of more values than 16 bits": lambda: np.where(noise() > 4, np.float32(np.nan), noise()),
    "of nothing": lambda: np.full((4, 5), np.nan, np.float32),
    "of numbers that no camera gives": odd_numbers,
    "that is not in one piece": lambda: noise()[::2, ::3],
}


@pytest.mark.parametrize("kind", DEPTHS)
def test_a_view_comes_back_to_the_last_bit(kind: str) -> None:
    depth = DEPTHS[kind]()
    grey = np.random.default_rng(1).integers(0, 256, depth.shape, np.uint8)
    camera = recorded_frames()[0].intrinsics
    view = View(grey, depth, camera, np.arange(6.0), 0.01, 0.002, 0.5)
    back = packed(view).unpacked()
    np.testing.assert_array_equal(back.grey, grey)
    assert back.grey.dtype == np.uint8
    expected = np.ascontiguousarray(depth).view(np.uint32)
    np.testing.assert_array_equal(back.depth.view(np.uint32), expected)
    assert back.intrinsics is camera
    np.testing.assert_array_equal(back.twist, view.twist)
    assert (back.readout_time, back.depth_delay, back.contrast) == (0.01, 0.002, 0.5)


def test_a_keyframe_known_by_its_view_is_whole_again_to_the_last_bit() -> None:
    keyframe = seen(30)
    assert_same(stored(keyframe).whole(), keyframe)


def test_a_keyframe_of_the_odometry_is_whole_again_with_the_model_that_it_had() -> None:
    keyframe = drifted()[3].keyframe
    whole = StoredKeyframe.with_model(keyframe).whole()
    assert whole.model is keyframe.model
    assert_same(whole, keyframe)


def test_the_keyframes_used_last_are_not_made_whole_again_and_others_are() -> None:
    keyframes = WholeKeyframes()
    many = [stored(replace(seen(0), row=number)) for number in range(10)]
    first = keyframes.of(many[0])
    assert keyframes.of(many[0]) is first
    for other in many[1:]:
        keyframes.of(other)
    again = keyframes.of(many[0])
    assert again is not first
    assert_same(again, first)


@pytest.mark.slow
def test_a_keyframe_costs_the_map_less_than_two_thirds_of_its_images() -> None:
    pytest.importorskip("gtsam", reason="GTSAM is not installed")
    pytest.importorskip("pyhbst", reason="pyHBST is not installed")
    live = LiveMap(config())
    frame = recorded_frames()[0]
    # besides features it has had a model as large as these
    images = frame.color[..., 0].nbytes + frame.depth.nbytes
    sizes = []
    tracemalloc.start()
    for number, known in enumerate(drifted()):
        # whatever else the first one needs, and those that are kept whole, is there after some
        frame = recorded_frames()[known.row]
        own = replace(frame, color=frame.color.copy(), depth=frame.depth.copy())
        live.add(number, PublishedKeyframe(own, known.T_odom_camera, known.edges))
        del frame, own
        gc.collect()
        sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert len(sizes) > 20
    each = (sizes[-1] - sizes[10]) / (len(sizes) - 11)
    assert each < 2 / 3 * images
