"""A problem makes the pyramid of its image once, and hands it on while the image is the same."""

from __future__ import annotations

import weakref
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from threading import Barrier

import cv2
import numpy as np
from rigs.room import room_view

from rgbd_glue_ros.parameters import RefineConfig
from rgbd_glue_ros.refinement.gauss_newton import evaluate_pose, refine
from rgbd_glue_ros.refinement.image_pyramid import ImagePyramid
from rgbd_glue_ros.refinement.model import LEVELS, model_of
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.types import Correspondences, UInt8

CONFIG = RefineConfig()


def the_problem() -> RefinementProblem:
    return RefinementProblem(model_of(room_view(0.0), 8), room_view(0.3), CONFIG)


def test_each_level_has_half_the_size_of_the_one_before() -> None:
    problem = the_problem()
    images = [problem.at_level(level).image for level in range(LEVELS)]
    assert images[0] is problem.view.grey
    for fine, coarse in pairwise(images):
        np.testing.assert_array_equal(coarse, cv2.pyrDown(fine))


def test_another_twist_keeps_the_pyramid_and_another_image_gets_its_own() -> None:
    problem = the_problem()
    turning = replace(problem, view=replace(problem.view, twist=np.ones(6)))
    assert turning.at_level(1).image is problem.at_level(1).image
    np.testing.assert_array_equal(turning.at_level(1).image_exposure.twist, np.ones(6))
    dark = replace(problem, view=replace(problem.view, grey=np.zeros_like(problem.view.grey)))
    assert not dark.at_level(1).image.any()


def test_concurrent_threads_get_the_same_images() -> None:
    grey, together = room_view(0.3).grey, Barrier(4)
    pyramid = ImagePyramid(grey)

    def coarsest(_: int) -> UInt8:
        together.wait()
        return pyramid.at_level(LEVELS - 1)

    with ThreadPoolExecutor(4) as executor:
        first, *others = executor.map(coarsest, range(4))
    assert all(image is first for image in others)


def test_a_refinement_does_not_keep_the_pyramid_alive() -> None:
    refine(np.eye(4), the_problem())  # a first call is compiled, which holds its arguments longer
    problem = the_problem()
    refined, pyramid = refine(np.eye(4), problem), weakref.ref(problem.images)
    del problem
    assert refined.planes_seen > 0
    assert pyramid() is None


def test_matches_do_not_affect_how_well_the_images_agree() -> None:
    points = np.random.default_rng(0).uniform(1.0, 2.0, (20, 3))
    held = replace(the_problem(), matches=Correspondences(points, points + 0.1, np.ones(20)))
    alone, with_matches = (evaluate_pose(np.eye(4), p) for p in (the_problem(), held))
    np.testing.assert_array_equal(alone.information, with_matches.information)
