"""How far parts of an image agree on a pose, against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigs.bag_frames import recorded_frames, true_poses

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.views import grey
from rgbd_glue_ros.parameters import RefineConfig
from rgbd_glue_ros.refinement.agreement import BandAgreement, disagreement
from rgbd_glue_ros.refinement.gauss_newton import refine
from rgbd_glue_ros.refinement.model import Model, model_of
from rgbd_glue_ros.refinement.pose_residuals import rows_at
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.refinement.residual_rows import Rows
from rgbd_glue_ros.types import Float64, View

BANDS, OF_A_BAND = 3, 200
# 0.3 s apart
BEFORE, NOW = 0, 9


def rows(rng: np.random.Generator, shifts: Float64) -> Rows:
    """Residuals of unit weight whose bands have their optima at ``shifts`` [BANDS, 6], and noise.

    Large derivatives make what holds the pose where nothing is seen negligible.
    """
    count = BANDS * OF_A_BAND
    J = 1000 * rng.normal(size=(count, 6))
    row_time = np.repeat((np.arange(BANDS) + 0.5) / BANDS - 0.5, OF_A_BAND)
    r = rng.normal(size=count) - np.sum(J * np.repeat(shifts, OF_A_BAND, axis=0), axis=1)
    return Rows(np.arange(count), np.ones(count), r, J, row_time)


def part_of(table: Rows, which: slice) -> Rows:
    """Some of the rows."""
    return Rows(
        table.point[which],
        table.weight[which],
        table.residual[which],
        np.ascontiguousarray(table.jacobian[which]),
        table.row_time[which],
    )


def test_independent_residuals_disagree_by_one_per_degree_of_freedom() -> None:
    rng = np.random.default_rng(0)
    found = [disagreement([rows(rng, np.zeros((BANDS, 6)))]) for _ in range(300)]
    # of chi² with 12 degrees of freedom, by these: the mean of 300 has σ 0.024
    assert np.mean(np.array(found, np.float64)) == pytest.approx(1.0, abs=0.1)


def test_a_pose_that_all_bands_share_is_not_a_disagreement() -> None:
    same = np.tile(0.01 * np.random.default_rng(0).normal(size=6), (BANDS, 1))
    noise = disagreement([rows(np.random.default_rng(1), np.zeros((BANDS, 6)))])
    assert disagreement([rows(np.random.default_rng(1), same)]) == pytest.approx(noise, rel=0.01)


def test_bands_that_disagree_do_so_by_the_mahalanobis_distances_of_their_optima() -> None:
    rng = np.random.default_rng(2)
    table = rows(rng, 0.01 * rng.normal(size=(BANDS, 6)))
    halves = [part_of(table, slice(i, None, 2)) for i in range(2)]
    optima, informations = [], []
    for band in np.split(np.arange(BANDS * OF_A_BAND), BANDS):
        J, r = table.jacobian[band], table.residual[band]
        informations.append(J.T @ J)
        optima.append(-np.linalg.lstsq(J, r, rcond=None)[0])
    together = np.linalg.solve(
        sum(informations), sum(H @ x for H, x in zip(informations, optima, strict=True))
    )
    squared = sum(
        (x - together) @ H @ (x - together) for H, x in zip(informations, optima, strict=True)
    )
    # two kinds of residuals, as planes and pixels are, count together
    assert disagreement(halves) == pytest.approx(float(squared) / (6 * (BANDS - 1)), rel=1e-3)


def test_a_single_band_gives_no_disagreement() -> None:
    table = rows(np.random.default_rng(3), np.zeros((BANDS, 6)))
    top = part_of(table, slice(OF_A_BAND))
    assert disagreement([top]) is None


def test_measurements_outweigh_the_expectation_after_some_frames() -> None:
    counts = [
        BandAgreement(frames, 0.0).residuals_per_independent_one(1000.0) for frames in (0, 1, 30)
    ]
    # between 1000 that were expected and 50 of bands that agree
    expected = [1000.0, (1000 * 50) ** 0.5, 1000 ** (1 / 31) * 50 ** (30 / 31)]
    assert counts == pytest.approx(expected)


def recorded(row: int) -> View:
    frame = recorded_frames()[row]
    return View(grey(frame.color), frame.depth, frame.intrinsics)


def after(view: View, frames: int = 1, model: Model | None = None) -> BandAgreement:
    """What is known after the view was looked at some times, at its pose on an earlier one."""
    # images of this size double the weight of pixels
    config = RefineConfig(iterations=15, pixel_weight=5.0)
    model = model_of(recorded(BEFORE), 8) if model is None else model
    start = se3.inverse(true_poses()[BEFORE]) @ true_poses()[NOW]
    problem = RefinementProblem(model, view, config)
    of_frame, known = rows_at(refine(start, problem), problem, level=0), BandAgreement()
    for _ in range(frames):
        known = known.after_frame(of_frame)
    return known


def test_depth_with_a_varying_scale_makes_fewer_residuals_independent() -> None:
    view, whole = recorded(NOW), model_of(recorded(BEFORE), 8)
    rows = np.linspace(-0.5, 0.5, len(view.depth))[:, None]
    # pixels do not show it
    of_planes = whole.selected(
        np.ones(len(whole.planes.points), bool),
        [np.zeros(len(pixels.points), bool) for pixels in whole.pixels],
    )
    scaled = [
        replace(view, depth=(view.depth * (1 + fault * rows)).astype(np.float32))
        for fault in (0.0, 0.01, 0.02, 0.04)
    ]
    for model, factor in ((whole, 1.5), (of_planes, 5.0)):
        counts = [after(s, model=model).residuals_per_independent_one(1000.0) for s in scaled]
        assert counts == sorted(counts)
        assert counts[-1] > factor * counts[0]


def test_neither_a_repeated_frame_nor_an_empty_one_changes_the_agreement() -> None:
    view = recorded(NOW)
    once = after(view)
    thrice = after(view, 3)
    assert thrice.frames == 3
    assert thrice.log_excess == pytest.approx(once.log_excess)
    blind = replace(view, depth=np.full_like(view.depth, np.nan), grey=np.zeros_like(view.grey))
    assert after(blind) == BandAgreement()
