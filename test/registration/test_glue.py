"""The paper's section 3: its statistics hold, its rules apply, and two frames are registered."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Protocol

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rigs.geometry import (
    SEEDS,
    noisy_matches,
    random_transform,
    room_points,
    transforms,
    wrong_matches,
)
from rigs.room import TIMES, room_view, true_transform
from scipy.stats import chi2

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.evaluation.registration_errors import rotation_deg, translation_cm
from rgbd_glue_ros.features import GEOMETRIC, VISUAL
from rgbd_glue_ros.features.lifting import KeypointPoints
from rgbd_glue_ros.features.visual import NoVisualFeature, VisualMatches
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.camera import project
from rgbd_glue_ros.geometry.fitting import distances, fit_covariance, procrustes
from rgbd_glue_ros.parameters import (
    FALLBACK_METHODS,
    FIT_METHODS,
    SC2_PCR,
    Config,
    FeaturesConfig,
    FitConfig,
    GlueConfig,
)
from rgbd_glue_ros.registration.fits import FITS
from rgbd_glue_ros.registration.frame_features import FrameFeatures
from rgbd_glue_ros.registration.glue import (
    Glue,
    adaptive_threshold,
    assumed_inliers,
    consistent,
    error_variance,
)
from rgbd_glue_ros.types import (
    Correspondences,
    Float64,
    RegistrationResult,
    RegistrationStatus,
    TransformPrior,
    View,
)

CONFIDENCE = 0.95
# a right result is this many standard deviations off once in two million times
UNLIKELY = 5


# equations 4 to 8


@given(SEEDS, st.floats(0.001, 0.1), transforms())
def test_the_threshold_holds_its_95_percent(seed: int, sigma: float, T: Float64) -> None:
    """A part of 95 % of right matches passes; the tolerance is that of two finite samples."""
    rng = np.random.default_rng(seed)
    n, n_tested = 500, 5000
    epsilon = adaptive_threshold(error_variance(noisy_matches(rng, T, n, sigma), T), CONFIDENCE)
    tested = noisy_matches(rng, T, n_tested, sigma)
    passed = len(consistent(tested, T, epsilon)) / n_tested

    counting = CONFIDENCE * (1 - CONFIDENCE) / n_tested  # variance of a binomial part
    # the variance has the relative variance 2 / (3 n), and d P / d ln(variance) = q f(q)
    quantile = chi2.ppf(CONFIDENCE, 3)
    estimating = (quantile * chi2.pdf(quantile, 3)) ** 2 * 2 / (3 * n)
    assert abs(passed - CONFIDENCE) < UNLIKELY * np.sqrt(counting + estimating)


def test_the_threshold_is_2_8_standard_deviations() -> None:
    # a table of the chi-square distribution has 7.815 for 0.95 and three degrees of freedom
    assert adaptive_threshold(0.01**2, 0.95) == pytest.approx(0.01 * np.sqrt(7.815), rel=1e-4)
    assert adaptive_threshold(0.01**2, 0.5) < adaptive_threshold(0.01**2, 0.95)
    assert adaptive_threshold(0.0, 0.95) == 0.0


def test_the_variance_by_moments_is_unbiased() -> None:
    rng = np.random.default_rng(0)
    T, sigma, n, trials = random_transform(rng), 0.02, 7, 4000
    estimates = [error_variance(noisy_matches(rng, T, n, sigma), T) for _ in range(trials)]
    error = sigma**2 * np.sqrt(2 / (3 * n * trials))
    assert np.mean(estimates) == pytest.approx(sigma**2, abs=UNLIKELY * error)


@pytest.mark.parametrize(("k", "kept"), [(1, 2), (3, 3), (5, 4)])
def test_inliers_are_assumed_within_k_times_the_threshold(k: float, kept: int) -> None:
    # 0, 4.9, 14.9, 24.9 and 25.1 cm from where T = identity puts them
    source = room_points(np.random.default_rng(0), 5)
    target = source + np.outer([0, 0.049, 0.149, 0.249, 0.251], [0.6, 0, 0.8])
    matches = Correspondences(source, target, np.arange(5.0))
    inliers = assumed_inliers(matches, np.eye(4), 0.05, k)
    np.testing.assert_array_equal(inliers.weights, np.arange(kept))


@given(SEEDS, st.floats(0.0, 1.0))
def test_consistent_matches_are_exactly_those_within_epsilon(seed: int, epsilon: float) -> None:
    rng = np.random.default_rng(seed)
    T = random_transform(rng)
    matches = noisy_matches(rng, T, 50, sigma_m=0.3)
    matches = replace(matches, weights=np.arange(50.0))
    kept = consistent(matches, T, epsilon)
    np.testing.assert_array_equal(kept.weights, np.flatnonzero(distances(T, matches) <= epsilon))
    np.testing.assert_array_equal(kept.source, matches.source[kept.weights.astype(int)])
    np.testing.assert_array_equal(kept.target, matches.target[kept.weights.astype(int)])


# the fit's covariance


def test_the_covariance_of_a_fit_is_that_of_many_fits() -> None:
    rng = np.random.default_rng(0)
    truth, sigma, n, trials = random_transform(rng), 0.02, 300, 3000
    source, weights = room_points(rng, n), rng.uniform(0.1, 2.0, n)
    errors, claimed = [], []
    for trial in range(trials):
        target = se3.transform(truth, source) + rng.normal(0, sigma, (n, 3))
        T = np.asarray(procrustes(source, target, weights))
        errors.append(se3.log(T @ se3.inverse(truth)))
        if trial < 20:
            covariance = fit_covariance(T, Correspondences(source, target, weights))
            assert covariance is not None
            claimed.append(covariance)
    sampled, expected = np.cov(np.array(errors).T), np.mean(claimed, axis=0)
    variances = np.diag(expected)
    # an entry of a sampled covariance (Wishart); the fit takes 6 of 3 n degrees of freedom
    sampling = np.sqrt((expected**2 + np.outer(variances, variances)) / trials)
    taken = 6 / (3 * n) * np.sqrt(np.outer(variances, variances))
    assert (np.abs(sampled - expected) < UNLIKELY * sampling + 2 * taken).all()
    assert np.linalg.eigvalsh(claimed[0]).min() > 0


@pytest.mark.parametrize(
    "points",
    [
        np.tile([0.1, 0.2, 2.0], (10, 1)),
        np.linspace([-1, 0, 2], [1, 0.5, 3], 10),
        np.linspace([-1, 0, 2], [1, 0.5, 3], 2),
    ],
    ids=["a point", "a line", "two points"],
)
def test_matches_that_leave_a_rotation_open_have_no_covariance(points: Float64) -> None:
    matches = Correspondences(points, points + 0.001, np.ones(len(points)))
    assert fit_covariance(np.eye(4), matches) is None


# the steps together, on matches that are known


class KnownMatches:
    """A geometric feature that finds what it is told."""

    def __init__(self, matches: Correspondences) -> None:
        self._matches = matches
        self.rough: TransformPrior | None = None

    def extract(self, view: View) -> None: ...

    def match(self, source: None, target: None, rough: TransformPrior | None) -> Correspondences:
        self.rough = rough
        return self._matches


class SilentVisual:
    """A visual feature that finds three matches, too few to count."""

    def extract(self, view: View) -> None: ...

    def match(self, source: None, target: None) -> VisualMatches:
        uv = np.array([[100, 100], [200, 100], [150, 50]], np.float32)
        return VisualMatches(uv, uv, np.ones(3))


class Told(Protocol):
    """Makes a ``Glue`` whose geometric matches are given."""

    def __call__(
        self, matches: Correspondences, visual: str, glue: GlueConfig, fit: str = "procrustes"
    ) -> tuple[Glue, KnownMatches]: ...


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> Told:
    def make(
        matches: Correspondences, visual: str, glue: GlueConfig, fit: str = "procrustes"
    ) -> tuple[Glue, KnownMatches]:
        feature = KnownMatches(matches)
        monkeypatch.setitem(GEOMETRIC, "known", lambda _: feature)
        monkeypatch.setitem(VISUAL, "silent", lambda _: SilentVisual())
        features = FeaturesConfig(visual=visual, geometric="known")
        return Glue(Config(features=features, glue=glue, fit=FitConfig(method=fit))), feature

    return make


def registered(glue: Glue, prior: TransformPrior | None = None) -> RegistrationResult:
    source, target = (glue.extract(room_view(time)) for time in TIMES)
    return glue.register(source, target, prior)


def geometric_matches(right: int, wrong: int, sigma_m: float = 0.005) -> Correspondences:
    """Matches of the two frames: right ones of weight 1, then wrong ones of weight 0.5."""
    rng = np.random.default_rng(0)
    bad = wrong_matches(rng, wrong)
    good = noisy_matches(rng, true_transform(), right, sigma_m)
    return good + replace(bad, weights=np.full(wrong, 0.5))


def test_visual_matches_tell_right_geometric_matches_from_wrong_ones(told: Told) -> None:
    glue, _ = told(geometric_matches(right=300, wrong=700), "sift", GlueConfig())
    result = registered(glue)
    assert result.filtered
    assert result.epsilon_m == pytest.approx(adaptive_threshold(result.sigma_m**2, CONFIDENCE))
    kept_right = (result.credible.weights == 1.0).sum()
    assert kept_right > 0.95 * 300
    # a wrong match lands in a ball of radius epsilon in a room of 24 cubic metres by chance
    assert len(result.credible) - kept_right < 0.02 * 700


def test_the_fit_is_to_the_union_of_visual_inliers_and_credible_matches(told: Told) -> None:
    glue, _ = told(geometric_matches(right=300, wrong=700), "sift", GlueConfig())
    result = registered(glue)
    union = result.visual_inliers + result.credible
    assert len(union) == len(result.visual_inliers) + len(result.credible) > 320
    assert result.T_target_source is not None
    np.testing.assert_array_equal(
        result.T_target_source, procrustes(union.source, union.target, union.weights)
    )
    np.testing.assert_array_equal(result.covariance, fit_covariance(result.T_target_source, union))


def test_the_geometric_search_is_guided_by_the_rough_transform_and_epsilon(told: Told) -> None:
    glue, feature = told(geometric_matches(right=300, wrong=0), "sift", GlueConfig())
    result = registered(glue, prior=TransformPrior(np.eye(4), 0.123))
    assert feature.rough is not None
    assert feature.rough.radius == result.epsilon_m
    matches = noisy_matches(np.random.default_rng(0), true_transform(), 100, sigma_m=0.0)
    assert distances(feature.rough.T_target_source, matches).max() < 0.05


@pytest.mark.parametrize("visual", ["sift", "silent"])
def test_visual_inliers_alone_are_those_of_the_whole_registration(told: Told, visual: str) -> None:
    glue, feature = told(geometric_matches(right=300, wrong=100), visual, GlueConfig())
    source, target = (glue.extract(room_view(time)) for time in TIMES)
    alone = glue.visual_inliers(source, target)
    assert feature.rough is None
    whole = glue.register(source, target).visual_inliers
    np.testing.assert_array_equal(alone.source, whole.source)
    np.testing.assert_array_equal(alone.target, whole.target)


@pytest.mark.parametrize("visual", ["none", "silent"])
def test_with_few_visual_matches_the_filter_is_skipped(told: Told, visual: str) -> None:
    glue, feature = told(geometric_matches(right=300, wrong=100), visual, GlueConfig(min_visual=4))
    result = registered(glue)
    assert feature.rough is None
    assert not result.filtered
    assert result.credible is result.geometric
    assert len(result.visual_inliers) == 0
    assert np.isnan(result.epsilon_m)
    assert np.isnan(result.sigma_m)
    assert result.status is RegistrationStatus.OK


def test_a_transform_that_few_visual_matches_agree_with_is_not_believed(told: Told) -> None:
    # three matches always agree with some transform, which says nothing
    glue, feature = told(
        geometric_matches(right=300, wrong=100), "silent", GlueConfig(min_visual=3)
    )
    result = registered(glue)
    assert len(result.visual) == 3
    assert len(result.visual_inliers) == 0
    assert feature.rough is None


def test_visual_inliers_too_few_for_a_filter_still_count_in_the_fit(told: Told) -> None:
    glue, feature = told(geometric_matches(right=500, wrong=0), "sift", GlueConfig(min_visual=400))
    result = registered(glue)
    assert feature.rough is None
    assert not result.filtered
    assert 20 < len(result.visual_inliers) < 400
    assert result.T_target_source is not None
    union = result.visual_inliers + result.credible
    np.testing.assert_array_equal(
        result.T_target_source, procrustes(union.source, union.target, union.weights)
    )


def test_with_hardly_any_survivor_the_filter_is_skipped(told: Told) -> None:
    for right, filtered in ((9, False), (30, True)):
        matches = geometric_matches(right, wrong=100, sigma_m=0.0)
        glue, _ = told(matches, "sift", GlueConfig(min_credible=20))
        result = registered(glue)
        assert result.filtered is filtered
        assert (len(result.credible) == len(matches)) is not filtered
        assert np.isnan(result.epsilon_m) is not filtered


def test_the_filter_can_be_switched_off(told: Told) -> None:
    glue, _ = told(geometric_matches(right=300, wrong=100), "sift", GlueConfig(filter=False))
    result = registered(glue)
    assert not result.filtered
    assert len(result.credible) == 400


def test_without_visual_matches_a_prior_takes_the_place_of_the_rough_transform(told: Told) -> None:
    glue, feature = told(geometric_matches(right=300, wrong=700), "none", GlueConfig())
    prior = TransformPrior(se3.exp(np.array([0.02, 0, 0, 0, 0.005, 0])) @ true_transform(), 0.1)
    result = registered(glue, prior)
    assert feature.rough is prior
    assert result.filtered
    assert result.epsilon_m == prior.radius
    assert (result.credible.weights == 1.0).sum() > 295
    assert len(result.credible) < 310


def test_without_visual_matches_geometry_can_give_the_rough_transform(told: Told) -> None:
    matches = geometric_matches(right=300, wrong=700)
    glue, feature = told(matches, "none", GlueConfig(fallback="sc2_pcr"))
    result = registered(glue)
    assert feature.rough is not None
    assert result.filtered
    assert result.epsilon_m == feature.rough.radius < 0.1
    assert (result.credible.weights == 1.0).sum() > 0.9 * 300
    assert len(result.credible) < 310


def test_visual_matches_and_a_prior_go_before_the_fallback(told: Told) -> None:
    matches = geometric_matches(right=300, wrong=700)
    glue, _ = told(matches, "sift", GlueConfig())
    fallback = GlueConfig(fallback="sc2_pcr")
    patient, _ = told(matches, "sift", fallback)
    assert registered(patient).epsilon_m == registered(glue).epsilon_m
    glue, feature = told(matches, "none", fallback)
    prior = TransformPrior(true_transform(), 0.123)
    registered(glue, prior)
    assert feature.rough is prior


def wrong_prior() -> TransformPrior:
    """One that many matches agree with by chance alone."""
    return TransformPrior(se3.exp(np.array([0.5, 0, 0, 0, 0.3, 0])) @ true_transform(), 0.5)


def test_what_survives_by_chance_alone_does_not_count(told: Told) -> None:
    matches = geometric_matches(right=100, wrong=2000)
    glue, _ = told(matches, "none", GlueConfig())
    by_chance = registered(glue, wrong_prior())
    assert by_chance.filtered
    assert len(by_chance.credible) > 10
    glue, _ = told(matches, "none", GlueConfig(over_chance=2.0))
    assert not registered(glue, wrong_prior()).filtered
    assert registered(glue, TransformPrior(true_transform(), 0.5)).filtered


def test_the_fallback_mends_a_rough_transform_that_geometry_does_not_agree_with(
    told: Told,
) -> None:
    matches = geometric_matches(right=100, wrong=900)
    glue, feature = told(matches, "none", GlueConfig(fallback="sc2_pcr", over_chance=2.0))
    result = registered(glue, wrong_prior())
    assert result.filtered
    assert feature.rough is not None
    assert translation_cm(feature.rough.T_target_source, true_transform()) < 1
    assert (result.credible.weights == 1.0).sum() > 90


@pytest.mark.parametrize("right", [0, 2, 9])
def test_geometry_of_which_hardly_any_match_agrees_gives_no_rough_transform(
    told: Told, right: int
) -> None:
    matches = geometric_matches(right, wrong=50)
    glue, feature = told(matches, "none", GlueConfig(fallback="sc2_pcr", min_credible=20))
    assert not registered(glue).filtered
    assert feature.rough is None


@pytest.mark.parametrize("fit", FIT_METHODS)
def test_every_fit_finds_the_transform_of_credible_matches(told: Told, fit: str) -> None:
    glue, _ = told(geometric_matches(right=300, wrong=700), "sift", GlueConfig(), fit)
    result = registered(glue)
    assert result.T_target_source is not None
    assert translation_cm(result.T_target_source, true_transform()) < 1
    assert rotation_deg(result.T_target_source, true_transform()) < 0.5


def test_every_fit_and_fallback_that_can_be_configured_is_known() -> None:
    assert {*FITS} == {*FIT_METHODS}
    assert {"none", SC2_PCR} == {*FALLBACK_METHODS}


@pytest.mark.parametrize(
    ("matches", "status"),
    [
        (Correspondences.empty(), RegistrationStatus.TOO_FEW_CORRESPONDENCES),
        (
            replace(geometric_matches(20, 0), weights=np.zeros(20)),
            RegistrationStatus.TOO_FEW_CORRESPONDENCES,
        ),
        (
            Correspondences(
                np.linspace([-1, 0, 2], [1, 0, 2], 50),
                np.linspace([-1, 0, 2], [1, 0, 2], 50),
                np.ones(50),
            ),
            RegistrationStatus.DEGENERATE,
        ),
    ],
    ids=["none", "without weight", "on a line"],
)
def test_matches_that_fix_no_transform_give_none_and_the_reason(
    told: Told, matches: Correspondences, status: RegistrationStatus
) -> None:
    glue, _ = told(matches, "none", GlueConfig())
    result = registered(glue)
    assert result.status is status
    assert result.T_target_source is None
    assert result.covariance is None


# the steps together, on what cameras see


@pytest.mark.parametrize(
    ("visual", "geometric"),
    [*product(["orb", "sift", "brisk"], ["none", "fpfh_grid"]), ("sift", "fpfh")],
)
def test_two_frames_are_registered(visual: str, geometric: str) -> None:
    config = Config(features=FeaturesConfig(visual=visual, geometric=geometric))
    result = registered(Glue(config))
    assert result.status is RegistrationStatus.OK
    assert result.T_target_source is not None
    assert result.covariance is not None
    error = se3.inverse(true_transform()) @ result.T_target_source
    assert np.linalg.norm(error[:3, 3]) < 0.03
    assert se3.rotation_angle(error) < 0.015
    assert np.linalg.eigvalsh(result.covariance).min() > 0
    assert (len(result.geometric) > 0) is (geometric != "none")
    assert len(result.visual_inliers) <= len(result.visual)
    assert set(result.stages_ms) == {"visual_matching", "ransac", "geometric_matching", "fit"}


def test_geometry_alone_registers_near_a_prior() -> None:
    config = Config(features=FeaturesConfig(visual="none"))
    off = se3.exp(np.array([0.03, -0.02, 0.02, 0.01, 0.01, 0])) @ true_transform()
    prior = TransformPrior(off, 0.1)
    result = registered(Glue(config), prior)
    assert result.T_target_source is not None
    assert result.filtered
    assert distances(off, result.credible).max() <= prior.radius
    error = se3.inverse(true_transform()) @ result.T_target_source
    assert np.linalg.norm(error[:3, 3]) < prior.radius


def test_the_same_frames_and_seed_give_the_same_bits() -> None:
    first, second = (registered(Glue(Config(seed=3))) for _ in range(2))
    assert first.T_target_source is not None
    np.testing.assert_array_equal(first.T_target_source, second.T_target_source)
    np.testing.assert_array_equal(first.covariance, second.covariance)


def test_a_frame_without_its_images_is_registered_to_the_same_bits() -> None:
    glue = Glue(Config())
    source, target = (glue.extract(room_view(time)) for time in (0.0, 0.5))
    without = glue.without_images(target)
    assert not isinstance(without, FrameFeatures)
    whole, sparse = glue.register(source, target), glue.register(source, without)
    assert whole.T_target_source is not None
    np.testing.assert_array_equal(sparse.T_target_source, whole.T_target_source)
    np.testing.assert_array_equal(sparse.covariance, whole.covariance)


@pytest.mark.parametrize(
    ("matches", "cause"),
    [
        (
            VisualMatches(np.zeros((4, 2), np.float32), np.zeros((4, 2), np.float32), np.ones(3)),
            "match returns arrays of shape (4, 2), (4, 2) and (3,); return one row per match",
        ),
        (
            VisualMatches(np.zeros((4, 2), np.float32), np.zeros((5, 2), np.float32), np.ones(4)),
            "match returns arrays of shape (4, 2), (5, 2) and (4,)",
        ),
        (
            VisualMatches(np.zeros((4, 3), np.float32), np.zeros((4, 3), np.float32), np.ones(4)),
            "match returns arrays of shape (4, 3), (4, 3) and (4,)",
        ),
        (np.zeros((4, 4)), "match returns ndarray, not VisualMatches"),
    ],
)
def test_matches_of_ones_own_that_are_not_one_row_each_are_refused_with_the_features_name(
    matches: VisualMatches, cause: str
) -> None:
    class Own(NoVisualFeature):
        def match(self, source: object, target: object) -> VisualMatches:
            del source, target
            return matches

    glue = Glue(Config())
    features = glue.extract(room_view(0.0))
    glue.visual = Own()
    with pytest.raises(InputError) as refused:
        glue.register(features, features)
    assert str(refused.value).startswith(f"visual feature 'orb': {cause}")


def test_a_feature_that_may_match_any_pixel_keeps_the_images() -> None:
    glue = Glue(Config(features=FeaturesConfig(visual="none")))
    features = glue.extract(room_view(0.0))
    assert glue.without_images(features) is features


def test_a_match_at_a_pixel_that_was_not_kept_is_refused() -> None:
    view = room_view(0.0)
    points = KeypointPoints.of(np.array([[20.0, 30.0], [5.0, 7.0]], np.float32), view)
    kept, known = points.at(np.array([[5.0, 7.0]], np.float32))
    assert known.all()
    np.testing.assert_allclose(project(kept, view.intrinsics), [[5.0, 7.0]], atol=1e-6)
    for other in (0.0, 100.0):
        with pytest.raises(InputError, match="not among its keypoints"):
            points.at(np.array([[other, 7.0]], np.float32))
