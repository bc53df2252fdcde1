"""The contrast of an image: in the dark, in haze, and of what is no texture at all."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rigs.room import room_frame
from rigs.scenes import SCENES

from rgbd_glue_ros.features import VISUAL
from rgbd_glue_ros.geometry.contrast import contrast_of, well_lit
from rgbd_glue_ros.geometry.views import grey, view_of
from rgbd_glue_ros.parameters import CameraConfig, Config
from rgbd_glue_ros.refinement.model import model_of
from rgbd_glue_ros.types import Float64, UInt8, View

GRADIENT = CameraConfig().well_lit_gradient


def room() -> UInt8:
    """A picture of the room, twice as large."""
    return np.asarray(cv2.resize(grey(room_frame(0.0).color), None, fx=2, fy=2), np.uint8)


def seen(brightness: Float64, noise: float, seed: int = 0) -> UInt8:
    """What a camera of some noise makes of it, in grey levels."""
    noisy = brightness + np.random.default_rng(seed).normal(0, noise, brightness.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def dark_room(light: float, noise: float = 1.0) -> View:
    """The room in a part of its light."""
    frame = room_frame(0.0)
    rng = np.random.default_rng(0)
    color = frame.color * light + rng.normal(0, noise, frame.color.shape)
    dark = replace(frame, color=np.clip(np.rint(color), 0, 255).astype(np.uint8))
    return view_of(dark, CameraConfig())


def test_a_well_lit_image_has_all_of_its_contrast() -> None:
    assert contrast_of(room(), GRADIENT) == 1.0


@given(st.floats(0.1, 0.9), st.floats(0.0, 20.0))
def test_contrast_is_the_part_of_light_that_is_left_whatever_haze_adds(
    light: float, haze: float
) -> None:
    bright = room().astype(np.float64)
    steep = GRADIENT
    while contrast_of(room(), steep) == 1.0:
        steep *= 1.1
    expected = light * contrast_of(room(), steep)
    image = seen(light * bright + haze, 0.0)
    assert contrast_of(image, steep) == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("noise", [0.0, 0.5, 2.0, 8.0])
def test_a_bare_wall_is_not_taken_for_a_dark_room(noise: float) -> None:
    """Nor where light falls on it unevenly, whose levels are contours in the image."""
    across = np.linspace(0, np.pi, 640)
    wall = 120 + 10 * np.sin(across) + 5 * np.cos(np.linspace(0, 2, 480))[:, np.newaxis]
    assert contrast_of(seen(wall, noise), GRADIENT) == 1.0
    assert contrast_of(seen(np.full((480, 640), 7.0), noise), GRADIENT) == 1.0


@pytest.mark.parametrize("seed", range(3))
def test_a_few_steep_edges_do_not_make_texture_of_the_noise_of_a_bare_wall(seed: int) -> None:
    """Notices cover so little of it that most of the steepest pixels are hardly more than noise."""
    corridor = SCENES["a bare corridor at 30 Hz"]
    after_a_second = replace(corridor, pose=lambda s: corridor.pose(s + 29 / 30), frame_count=4)
    for frame in after_a_second.noisy_frames(seed):
        assert contrast_of(grey(frame.color), GRADIENT) > 0.7


def test_few_edges_that_stand_out_from_little_noise_are_texture() -> None:
    """A poster of faint blots, and a frame around it."""
    faint = np.kron(np.random.default_rng(0).random((24, 32)) > 0.5, np.ones((20, 20)))
    room = np.asarray(200 + 14.0 * faint, np.float64)
    room[100:300, 100:104] = room[100:300, 300:304] = 130.0
    assert contrast_of(seen(room, 0.3), GRADIENT) < 0.5


def test_noise_keeps_limits_from_shrinking_to_it() -> None:
    bright = room().astype(np.float64)
    contrasts = [contrast_of(seen(0.05 * bright + 20, noise), GRADIENT) for noise in (0, 1, 4)]
    assert contrasts == sorted(contrasts)
    assert contrasts[0] < 0.15
    assert contrasts[-1] > 0.3


@pytest.mark.parametrize("light", [0.05, 0.12])
def test_a_lamp_says_nothing_of_the_dark_around_it(light: float) -> None:
    dark = light * room().astype(np.float64)
    lamp = dark.copy()
    lamp[40:110, 500:600] = 250
    without = contrast_of(seen(dark, 1.0), GRADIENT)
    assert without < 0.5
    assert contrast_of(seen(lamp, 1.0), GRADIENT) == pytest.approx(without, rel=0.05)


def test_an_overexposed_image_is_left_as_it_is() -> None:
    assert contrast_of(np.full((480, 640), 255, np.uint8), GRADIENT) == 1.0


def test_limits_never_shrink_below_a_sixteenth() -> None:
    checks = np.kron(np.indices((12, 16)).sum(axis=0) % 2, np.ones((40, 40)))
    assert contrast_of(seen(10 + 8 * checks, 0.0), 255.0) == 1 / 16


@pytest.mark.parametrize("shape", [(1, 1), (2, 500), (1, 4000), (3, 3), (5, 7)])
def test_an_image_too_small_to_show_edges_is_well_lit(shape: tuple[int, int]) -> None:
    assert contrast_of(np.zeros(shape, np.uint8), GRADIENT) == 1.0


def test_no_gradient_takes_every_image_as_it_is() -> None:
    frame = room_frame(0.0)
    dark = replace(frame, color=frame.color // 12)
    assert view_of(dark, CameraConfig(well_lit_gradient=0.0)).contrast == 1.0


def test_in_good_light_a_dark_image_looks_as_it_would() -> None:
    lit, dark = dark_room(1.0, noise=0.0), dark_room(0.1, noise=0.0)
    assert well_lit(lit) is lit.grey
    brightened = well_lit(dark)
    correlation = np.corrcoef(brightened.ravel(), lit.grey.ravel())[0, 1]
    assert correlation > 0.9
    assert brightened.std() > 3 * dark.grey.std()


@pytest.mark.parametrize("light", [0.08, 0.15, 0.3])
def test_in_the_dark_most_is_seen_that_daylight_shows_of_a_room(light: float) -> None:
    feature = VISUAL["orb"](Config().features)
    lit, dark = dark_room(1.0), dark_room(light)
    as_it_is = replace(dark, contrast=1.0)
    assert len(feature.extract(dark).uv) > 0.6 * len(feature.extract(lit).uv)
    assert len(feature.extract(as_it_is).uv) < 0.4 * len(feature.extract(lit).uv)
    pixels, without, in_daylight = (
        len(model_of(view, 8).pixels[0].points) for view in (dark, as_it_is, lit)
    )
    assert pixels > 0.8 * in_daylight
    assert without < 0.7 * in_daylight
