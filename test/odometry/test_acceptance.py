"""What planes and pixels must say of a pose before it is plausible."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rgbd_glue_ros.odometry.acceptance import Acceptance, Evidence
from rgbd_glue_ros.parameters import OdometryConfig
from rgbd_glue_ros.refinement.gauss_newton import START_BRIGHTNESS, Refinement

USUAL = Acceptance.of(OdometryConfig())
MANY = 4 * USUAL.min_planes


def found(planes: int, agreement: float, pixels: int, correlation: float) -> Refinement:
    """A refined pose of which planes and pixels say so much."""
    return Refinement(
        np.eye(4),
        np.eye(6),
        planes_seen=planes,
        planes_agreeing=round(planes * agreement),
        planes_occluded=0,
        pixels_seen=pixels,
        brightness_correlation=correlation,
        affine_brightness=np.array(START_BRIGHTNESS),
    )


@pytest.mark.parametrize(
    ("pose", "is_plausible", "is_conclusive"),
    [
        (found(MANY, 0.9, MANY, 0.9), True, True),
        (found(MANY, 0.9, 0, 0.0), True, False),
        (found(0, 0.0, MANY, 0.9), True, False),
        (found(MANY, 0.1, MANY, 0.9), False, False),
        (found(MANY, 0.4, MANY, 0.9), True, False),
        (found(MANY, 0.4, MANY, 0.5), False, False),
        # a dozen pixels may correlate by chance
        (found(MANY, 0.9, USUAL.min_pixels - 1, 0.9), True, False),
        (found(0, 0.0, 0, 0.0), False, False),
    ],
)
def test_planes_or_pixels_support_a_pose_and_decide_together(
    pose: Refinement, is_plausible: bool, is_conclusive: bool
) -> None:
    assert USUAL.is_plausible(pose) is is_plausible
    assert USUAL.is_conclusive(pose) is is_conclusive


def test_after_a_gap_a_few_planes_or_pixels_are_not_enough() -> None:
    few_planes, few_pixels = found(MANY - 1, 0.9, 0, 0.0), found(0, 0.0, MANY - 1, 0.9)
    alike = found(0, 0.0, MANY, 0.7)
    for pose in few_planes, few_pixels, alike:
        assert USUAL.is_plausible(pose)
        assert not USUAL.sceptical().is_plausible(pose)
    for pose in found(MANY, 0.6, 0, 0.0), found(0, 0.0, MANY, 0.9):
        assert USUAL.sceptical().is_plausible(pose)


@pytest.mark.parametrize(
    ("pose", "agreeing_matches", "accepted"),
    [
        (found(MANY, 0.6, MANY, 0.9), 0, True),
        # images that correlate less take a few matches
        (found(MANY, 0.6, MANY, 0.7), 6, True),
        (found(MANY, 0.6, MANY, 0.7), 5, False),
        # with texture, planes or pixels alone are not enough
        (found(MANY, 1.0, MANY, 0.5), 20, False),
        (found(MANY, 0.4, MANY, 1.0), 20, False),
        # without it, most planes
        (found(MANY, 0.8, 0, 0.0), 0, True),
        (found(MANY, 0.7, 0, 0.0), 0, False),
        # half of the visible planes agree, but most of those that must be seen are occluded
        (replace(found(5 * MANY, 0.1, MANY, 0.9), planes_occluded=4 * MANY), 0, False),
    ],
)
def test_where_no_motion_leads_all_that_images_show_must_support_a_pose(
    pose: Refinement, agreeing_matches: int, accepted: bool
) -> None:
    sceptical = USUAL.sceptical()
    evidence = Evidence(pose, agreeing_matches, is_within_reach=True)
    assert sceptical.accepts(evidence) is accepted
    # a motion would make each of them plausible
    assert USUAL.accepts(evidence)


def test_a_pose_out_of_reach_takes_texture_too() -> None:
    with_texture, without = found(MANY, 0.9, MANY, 0.9), found(MANY, 0.9, 0, 0.0)
    for acceptance in USUAL, USUAL.sceptical():
        assert acceptance.accepts(Evidence(with_texture, 0, is_within_reach=False))
        assert not acceptance.accepts(Evidence(without, 0, is_within_reach=False))


@pytest.mark.parametrize(
    ("pose", "allowed"), [(found(MANY, 0.9, MANY, 0.9), True), (found(MANY, 0.9, 0, 0.0), False)]
)
def test_a_jump_takes_a_conclusive_pose_where_jumps_are_accepted_at_all(
    pose: Refinement, allowed: bool
) -> None:
    assert USUAL.allows_jump(pose) is allowed
    assert not USUAL.without_jumps().allows_jump(pose)


@pytest.mark.parametrize(
    ("pose", "is_plausible"),
    [
        (found(MANY, 0.9, MANY, 0.9), True),
        (found(MANY, 0.4, MANY, 0.9), True),
        (found(0, 0.0, MANY, 0.9), True),
        (found(MANY, 0.9, MANY, 0.5), False),
        (found(MANY, 0.1, MANY, 0.9), False),
        # half of the visible planes agree
        (replace(found(5 * MANY, 0.1, MANY, 0.9), planes_occluded=4 * MANY), False),
    ],
)
def test_a_pose_without_prediction_takes_pixels_that_no_planes_contradict_not_even_occluded_ones(
    pose: Refinement, is_plausible: bool
) -> None:
    assert USUAL.is_plausible_place(pose) is is_plausible


@pytest.mark.parametrize(
    ("pixels", "correlation", "contradict"),
    [(MANY, 0.9, False), (MANY, 0.4, False), (MANY, 0.2, True), (USUAL.min_pixels - 1, 0.2, False)],
)
def test_pixels_contradict_a_pose_at_which_they_hardly_correlate(
    pixels: int, correlation: float, contradict: bool
) -> None:
    assert USUAL.pixels_contradict(found(MANY, 0.9, pixels, correlation)) is contradict
