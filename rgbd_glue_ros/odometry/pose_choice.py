"""Chooses the pose of a frame by all evidence that distinguishes the candidates.

Along a corridor planes fit anywhere, in front of a blank wall there are few pixels, and where
everything repeats, matches are with another place. So all of them are used, and the camera's motion
too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.fitting import distances
from rgbd_glue_ros.geometry.gates import POSE_GATE
from rgbd_glue_ros.odometry.acceptance import Acceptance, Evidence
from rgbd_glue_ros.odometry.pose_refinement import COARSE_LEVELS, PoseEstimate
from rgbd_glue_ros.refinement.gauss_newton import Refinement
from rgbd_glue_ros.types import Correspondences

CLEARLY_BETTER = 0.1
"""A difference of ``image_agreement`` that decides.

From a wrong start, refinement also ends in places that fit a little better.
"""
# Poses refined from distant starts that end nearer than this, metres and radians added, are equal.
_SAME_POSE = 0.01
# The weight of brightness correlation relative to the agreement of planes: surfaces fill an image,
# but all its texture may be on a passer-by.
_CORRELATION_WEIGHT = 0.3
# A pose that the camera can hardly reach is penalised by this fraction of the planes.
_MOTION_WEIGHT = 0.25
# Visual matches tell two poses apart if at least this number agree with one of them,
_DECIDING_MATCHES = 20
# and this many times as many as with the other.
_CLEARLY_MORE_MATCHES = 1.3
# If at most this fraction of the planes agrees with a pose, its matches may be with a passer-by.
_FEW_PLANES = 0.5
# Matches do not decide against planes of which this further fraction agrees with the other pose,
_PLANES_CONTRADICT = 0.25
# nor against the motion if one pose is likely and the other is not: see ``_likelier``.
_MOTION_CONTRADICTS = 0.5
# Blur and fast motion displace some planes; if more than this fraction agree, or matches decide, no
# further start is needed. Poses were up to 29 cm off with 77 % of the planes agreeing.
_CLEAR_AGREEMENT = 0.85


@dataclass(frozen=True)
class Candidate:
    """A pose that a frame may have.

    Attributes:
        estimate: the pose.
        coarse: the pose after the coarse levels alone, by which candidates are compared unless
            matches and the final level say otherwise.
        distance_squared: Mahalanobis distance of the pose from the predicted one, squared.
        milliseconds: duration of its refinement.
    """

    estimate: PoseEstimate
    coarse: Refinement
    distance_squared: float
    milliseconds: float

    @property
    def refinement(self) -> Refinement:
        """The pose, and how well the frame agrees with it."""
        return self.estimate.refinement

    @property
    def is_within_reach(self) -> bool:
        """Whether the camera can have got to the pose."""
        return self.distance_squared < POSE_GATE

    def agreeing(self, matches: Correspondences, inlier_threshold: float) -> int:
        """How many of the visual matches are nearer than a threshold, metres, at the pose."""
        apart = distances(self.estimate.T_track_camera, matches)
        return int(np.count_nonzero(apart <= inlier_threshold))

    def evidence(self, matches: Correspondences, inlier_threshold: float) -> Evidence:
        """What speaks for the pose, with the visual matches nearer than a threshold, metres."""
        agreeing = self.agreeing(matches, inlier_threshold)
        return Evidence(self.refinement, agreeing, self.is_within_reach)


def choose(
    candidates: Sequence[Candidate],
    matches: Correspondences,
    inlier_threshold: float,
    acceptance: Acceptance,
) -> Candidate | None:
    """The accepted pose with the most evidence; None if none is accepted.

    Args:
        candidates: of a frame; of equal ones the first is chosen.
        matches: all visual matches of the frame, their targets in the frame of its poses.
        inlier_threshold: distance within which a match agrees with a pose, metres.
        acceptance: the evidence that it takes.
    """
    accepted = [
        candidate
        for candidate in candidates
        if acceptance.accepts(candidate.evidence(matches, inlier_threshold))
    ]
    if not accepted:
        return None
    best = accepted[0]
    for candidate in accepted[1:]:
        if _is_better(candidate, best, matches, inlier_threshold):
            best = candidate
    return best


def is_clear(
    candidate: Candidate,
    matches: Correspondences,
    inlier_threshold: float,
    acceptance: Acceptance,
) -> bool:
    """Whether planes or visual matches support a pose enough that no other start is needed.

    Args:
        candidate: the pose.
        matches: all visual matches of the frame, their targets in the frame of its poses.
        inlier_threshold: distance within which a match agrees with a pose, metres.
        acceptance: how many planes count.
    """
    coarse = candidate.coarse
    # a coarse level has every 2^level-th plane
    visible = coarse.planes_visible * 2 ** COARSE_LEVELS[-1]
    if visible >= acceptance.min_planes and coarse.visible_agreement >= _CLEAR_AGREEMENT:
        return True
    return candidate.agreeing(matches, inlier_threshold) >= _DECIDING_MATCHES


def image_agreement(refinement: Refinement) -> float:
    """How well planes and pixels agree with a pose."""
    correlation = max(refinement.brightness_correlation, 0.0)
    return refinement.plane_agreement + _CORRELATION_WEIGHT * correlation


def _is_better(
    candidate: Candidate, than: Candidate, matches: Correspondences, inlier_threshold: float
) -> bool:
    """Whether there is more evidence for a pose than for another one of the same frame."""
    T, T_other = candidate.estimate.T_track_camera, than.estimate.T_track_camera
    if se3.difference(T, T_other) <= _SAME_POSE:
        return False
    agreeing, agreeing_with_other = (
        each.agreeing(matches, inlier_threshold) for each in (candidate, than)
    )
    matches_are_for = _matches_decide(agreeing, agreeing_with_other)
    matches_are_against = _matches_decide(agreeing_with_other, agreeing)
    # before the coarse levels: there the smooth light of a lamp on the camera fits any pose
    if matches_are_for and _finest_level_confirms(candidate, than):
        return True
    if matches_are_against and _finest_level_confirms(than, candidate):
        return False
    by_images = image_agreement(candidate.coarse) - image_agreement(than.coarse)
    if by_images + _MOTION_WEIGHT * _likelier(candidate, than) > 0:
        return True
    return matches_are_for and _nothing_contradicts(candidate, than)


def _matches_decide(agreeing: int, agreeing_with_other: int) -> bool:
    """Whether matches decide for the pose that so many of them agree with."""
    is_clearly_more = agreeing > _CLEARLY_MORE_MATCHES * agreeing_with_other
    return agreeing >= _DECIDING_MATCHES and is_clearly_more


def _finest_level_confirms(candidate: Candidate, than: Candidate) -> bool:
    """Whether the finest level is for a pose, too, that matches have decided for.

    It has to be clearly for it if few planes agree with the pose, as with one that follows a
    passer-by, or if the motion contradicts.
    """
    is_supported = (
        candidate.refinement.plane_agreement > _FEW_PLANES
        and _likelier(candidate, than) > -_MOTION_CONTRADICTS
    )
    least = 0.0 if is_supported else CLEARLY_BETTER
    return image_agreement(candidate.refinement) - image_agreement(than.refinement) > least


def _nothing_contradicts(candidate: Candidate, than: Candidate) -> bool:
    """Whether neither images nor motion clearly contradict what matches have decided."""
    finest, finest_of_other = candidate.refinement, than.refinement
    coarse, coarse_of_other = candidate.coarse, than.coarse
    more_planes = coarse.plane_agreement - coarse_of_other.plane_agreement
    return bool(
        image_agreement(finest) > image_agreement(finest_of_other) - CLEARLY_BETTER
        and coarse.brightness_correlation >= coarse_of_other.brightness_correlation
        and more_planes > -_PLANES_CONTRADICT
        and _likelier(candidate, than) > -_MOTION_CONTRADICTS
    )


def _likelier(candidate: Candidate, than: Candidate) -> float:
    """How much likelier a pose is than another one, by the motion alone; from -1 to 1."""
    return _unlikeliness(than) - _unlikeliness(candidate)


def _unlikeliness(candidate: Candidate) -> float:
    """From 0 for normal motion of a hand-held camera to 1 at the limit of what is possible."""
    return min(candidate.distance_squared / POSE_GATE, 1.0) ** 2
