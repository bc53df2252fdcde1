"""What every feature keeps to, whatever computes it: both tables, one contract."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rigs.fcgf_weights import write_random_fcgf
from rigs.geometry import points_of
from rigs.room import CAMERA, TIMES, room_view, small_room_view, true_transform

from rgbd_glue_ros.errors import InputError, MissingExtraError
from rgbd_glue_ros.features import GEOMETRIC, VISUAL
from rgbd_glue_ros.features.lifting import KeypointPoints, lift
from rgbd_glue_ros.features.visual import KeypointFeature, VisualMatches
from rgbd_glue_ros.features.weights import require
from rgbd_glue_ros.geometry.fitting import distances
from rgbd_glue_ros.parameters import FeaturesConfig
from rgbd_glue_ros.types import Correspondences, Float32, TransformPrior, UInt8, View

SOMETHING = [name for name in VISUAL if name != "none"]
SHAPED = [name for name in GEOMETRIC if name != "none"]
RANDOM = "fcgf"
"""What this one learned is not to be had: random numbers keep the contract, and describe little."""


@pytest.fixture(scope="module")
def features(weights_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Makes a feature by its name, each once, or skips where what it needs is not there."""
    made: dict[str, Any] = {}
    random_folder = tmp_path_factory.mktemp("random")

    def make(name: str) -> Any:
        config = FeaturesConfig(
            visual=name if name in VISUAL else "none",
            geometric=name if name in GEOMETRIC else "none",
            keypoints=300,
            geometric_keypoints=200,
            device="cpu",
            weights=str(random_folder if name == RANDOM else weights_folder),
        )
        try:
            if name == RANDOM and importlib.util.find_spec("torch"):
                write_random_fcgf(random_folder)
            require(config)
        except (InputError, MissingExtraError) as error:
            pytest.skip(f"{name}: {error}")
        if name not in made:
            table: dict[str, Any] = VISUAL if name in VISUAL else GEOMETRIC
            made[name] = table[name](config)
        return made[name]

    return make


def view(image: UInt8, depth: Float32 | None = None) -> View:
    """A view of a camera as wide as the image; without depth unless it is given."""
    height, width = image.shape
    if depth is None:
        depth = np.full(image.shape, np.nan, np.float32)
    return View(image, depth, CAMERA.scaled(width, height))


def blank(level: int = 0) -> View:
    return view(np.full((CAMERA.height // 2, CAMERA.width // 2), level, np.uint8))


def one_spot() -> View:
    """A white square on black, which looks the same from four sides."""
    spot = np.zeros((CAMERA.height // 2, CAMERA.width // 2), np.uint8)
    spot[58:64, 78:84] = 255
    return view(spot)


def noise(height: int, width: int) -> View:
    return view(np.random.default_rng(0).integers(0, 256, (height, width), np.uint8))


def check(matches: VisualMatches, source: View, target: View) -> None:
    """Shapes and types, pixels of the images, weights in [0, 1]."""
    for uv, seen in ((matches.source_uv, source), (matches.target_uv, target)):
        assert uv.dtype == np.float32
        assert uv.shape == (len(matches), 2)
        size = seen.grey.shape[::-1]
        assert ((uv >= -0.5) & (uv <= np.array(size) - 0.5)).all()
    assert matches.weights.dtype == np.float64
    assert matches.weights.shape == (len(matches),)
    assert ((matches.weights >= 0) & (matches.weights <= 1)).all()


@pytest.mark.parametrize("name", SOMETHING)
def test_two_views_of_a_room_are_matched_mostly_right_and_again_with_the_same_bits(
    features: Any, name: str
) -> None:
    feature = features(name)
    source, target = (small_room_view(time) for time in TIMES)
    pixels, again = (
        feature.match(feature.extract(source), feature.extract(target)) for _ in range(2)
    )
    check(pixels, source, target)
    matches = lift(pixels, points_of(source), points_of(target))
    assert len(matches) > 20
    assert (distances(true_transform(), matches) < 0.05).mean() > 0.6
    np.testing.assert_array_equal(pixels.source_uv, again.source_uv)
    np.testing.assert_array_equal(pixels.target_uv, again.target_uv)
    np.testing.assert_array_equal(pixels.weights, again.weights)


@pytest.mark.parametrize("name", SOMETHING)
def test_where_nothing_is_seen_little_is_matched(features: Any, name: str) -> None:
    feature = features(name)
    views = [small_room_view(0.0), blank(), blank(255)]
    seen, black, white = (feature.extract(view) for view in views)
    for source, target in ((seen, black), (black, seen), (black, white)):
        matches = feature.match(source, target)
        check(matches, views[0], views[0])
        # a network may see something at the borders of nothing
        assert len(matches) < 10


@pytest.mark.parametrize("name", SOMETHING)
def test_an_image_of_a_few_pixels_breaks_nothing(features: Any, name: str) -> None:
    feature = features(name)
    large = small_room_view(0.0)
    seen = feature.extract(large)
    for size in ((1, 1), (2, 3), (15, 16), (31, 33), (64, 40), (240, 1)):
        small = noise(*size)
        found = feature.extract(small)
        check(feature.match(found, seen), small, large)
        check(feature.match(seen, found), large, small)
        check(feature.match(found, found), small, small)


@pytest.mark.parametrize("name", SOMETHING)
def test_one_spot_and_points_that_all_look_equal_break_nothing(features: Any, name: str) -> None:
    feature = features(name)
    board = np.kron(np.indices((8, 10)).sum(0) % 2, np.ones((16, 16))).astype(np.uint8) * 255
    for seen in (one_spot(), view(board)):
        described = feature.extract(seen)
        check(feature.match(described, described), seen, seen)


@pytest.mark.parametrize("name", SOMETHING)
def test_without_depth_matches_are_found_and_none_is_lifted(features: Any, name: str) -> None:
    feature = features(name)
    flat = view(small_room_view(0.0).grey)
    described = feature.extract(flat)
    matches = feature.match(described, described)
    assert len(matches) > 50
    assert len(lift(matches, points_of(flat), points_of(flat))) == 0


@pytest.mark.parametrize("name", SOMETHING)
def test_its_matches_are_of_its_keypoints_and_have_the_points_of_the_whole_image(
    features: Any, name: str
) -> None:
    feature = features(name)
    views = [small_room_view(time) for time in TIMES]
    described = [feature.extract(view) for view in views]
    pixels = feature.match(*described)
    assert isinstance(feature, KeypointFeature)
    kept = [
        KeypointPoints.of(feature.keypoints(one), view)
        for one, view in zip(described, views, strict=True)
    ]
    whole = lift(pixels, *map(points_of, views))
    of_keypoints = lift(pixels, *(points.at for points in kept))
    np.testing.assert_array_equal(of_keypoints.source, whole.source)
    np.testing.assert_array_equal(of_keypoints.target, whole.target)
    np.testing.assert_array_equal(of_keypoints.weights, whole.weights)


# geometric


def check_geometry(matches: Correspondences) -> None:
    for points in (matches.source, matches.target):
        assert points.dtype == np.float64
        assert points.shape == (len(matches), 3)
        assert np.isfinite(points).all()
    assert ((matches.weights >= 0) & (matches.weights <= 1)).all()


def right(matches: Correspondences) -> float:
    """The part of the matches that are right within 10 cm."""
    return float((distances(true_transform(), matches) < 0.1).mean())


def at_random(matches: Correspondences) -> Correspondences:
    """The same points, matched without looking."""
    order = np.random.default_rng(0).permutation(len(matches))
    return replace(matches, target=matches.target[order])


def measured(time: float) -> View:
    """A view with the noise of a depth camera: exactly flat walls look exactly alike."""
    seen = room_view(time)
    rng = np.random.default_rng(round(time * 10))
    return replace(seen, depth=seen.depth + rng.normal(0, 0.003, seen.depth.shape).astype("f4"))


@dataclass(frozen=True)
class Matched:
    """What a feature makes of two measured views, and its matches without a prior."""

    source: Any
    target: Any
    matches: Correspondences


@pytest.fixture(scope="module")
def source_of(features: Any) -> Callable[[str], Any]:
    """What a feature, by its name, makes of the first measured view, each once."""

    @cache
    def extract(name: str) -> Any:
        return features(name).extract(measured(TIMES[0]))

    return extract


@pytest.fixture(scope="module")
def matched(features: Any, source_of: Callable[[str], Any]) -> Callable[[str], Matched]:
    """Describes and matches by the name of a feature, each once."""

    @cache
    def match(name: str) -> Matched:
        source, target = source_of(name), features(name).extract(measured(TIMES[1]))
        return Matched(source, target, features(name).match(source, target, None))

    return match


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in SHAPED if name != RANDOM])
def test_geometry_of_two_views_is_matched_better_than_by_chance(
    features: Any, matched: Callable[[str], Matched], name: str
) -> None:
    first = matched(name)
    prior = TransformPrior(true_transform(), 0.1)
    led = features(name).match(first.source, first.target, prior)
    for matches in (first.matches, led):
        check_geometry(matches)
        assert len(matches) > 100
        assert right(matches) > 3 * right(at_random(matches))


@pytest.mark.slow
@pytest.mark.parametrize("name", SHAPED)
def test_the_same_depth_gives_the_same_bits(
    features: Any, matched: Callable[[str], Matched], name: str
) -> None:
    feature, first = features(name), matched(name).matches
    second = feature.match(*(feature.extract(measured(time)) for time in TIMES), None)
    np.testing.assert_array_equal(first.source, second.source)
    np.testing.assert_array_equal(first.target, second.target)
    np.testing.assert_array_equal(first.weights, second.weights)


def with_depth(kind: str) -> View:
    depth = np.full((CAMERA.height, CAMERA.width), np.nan, np.float32)
    if kind == "one point":
        depth[100, 100] = 2.0
    elif kind == "two points":
        depth[100, 100], depth[60, 200] = 2.0, 1.0
    elif kind == "all points in one voxel":
        depth[118:121, 158:161] = 0.5
    return view(room_view(0.0).grey, depth)


@pytest.mark.parametrize("name", SHAPED)
@pytest.mark.parametrize("kind", ["no depth", "one point", "two points", "all points in one voxel"])
def test_hardly_any_depth_breaks_nothing(
    features: Any, source_of: Callable[[str], Any], name: str, kind: str
) -> None:
    feature = features(name)
    little, room = feature.extract(with_depth(kind)), source_of(name)
    for source, target in ((little, room), (room, little), (little, little)):
        for rough in (None, TransformPrior(np.eye(4), 0.1)):
            check_geometry(feature.match(source, target, rough))


@pytest.mark.parametrize("name", SHAPED)
def test_a_plane_where_all_points_look_equal_breaks_nothing(features: Any, name: str) -> None:
    feature = features(name)
    black = blank().grey
    wall = feature.extract(view(black, np.full(black.shape, 2.0, np.float32)))
    check_geometry(feature.match(wall, wall, None))
