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
from rgbd_glue_ros.geometry.fitting import POSE_GATE, distances
from rgbd_glue_ros.odometry.acceptance import Acceptance
from rgbd_glue_ros.odometry.pose_refinement import COARSE_LEVELS, PoseEstimate
from rgbd_glue_ros.refinement.gauss_newton import Refinement
from rgbd_glue_ros.types import Correspondences

CLEARLY_BETTER = 0.1
"""A difference of fits that decides.

From a wrong start, refinement also ends in places that fit a little better.
"""
# Poses refined from distant starts that end nearer than this, metres and radians added, are equal.
_SAME = 0.01
# The weight of brightness correlation relative to the agreement of planes: surfaces fill an image,
# but all its texture may be on a passer-by.
_TEXTURE = 0.3
# A pose that the camera can hardly reach is penalised by this fraction of the planes.
_MOTION = 0.25
# Visual matches decide between two poses from this number on, if this many times as many agree with
# one of them. If the finest level is for that pose as well, nothing overrules them. Otherwise it
# does if it is clearly against it, planes by this further fraction, and the motion if one pose is
# likely and the other is not.
_DECIDING_MATCHES, _CLEARLY_MORE = 20, 1.3
_PLANES_CONTRADICT, _MOTION_CONTRADICTS = 0.25, 0.5
# If no more than this fraction of the planes agrees with a pose, matches may be with a passer-by.
_MOST_PLANES = 0.5
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

    def is_accepted(self, acceptance: Acceptance) -> bool:
        """Whether the pose is plausible, and within reach of the camera or conclusive."""
        if not acceptance.is_plausible(self.refinement):
            return False
        return self.distance_squared < POSE_GATE or acceptance.allows_jump(self.refinement)


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
    accepted = [c for c in candidates if c.is_accepted(acceptance)]
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
    visible = coarse.planes_visible * 2 ** COARSE_LEVELS[-1]
    if visible >= acceptance.min_planes and coarse.visible_agreement >= _CLEAR_AGREEMENT:
        return True
    agreeing = distances(candidate.estimate.T_track_camera, matches) <= inlier_threshold
    return bool(np.count_nonzero(agreeing) >= _DECIDING_MATCHES)


def fit(refinement: Refinement) -> float:
    """How well planes and pixels agree with a pose."""
    correlation = max(refinement.brightness_correlation, 0.0)
    return refinement.plane_agreement + _TEXTURE * correlation


def _is_better(
    candidate: Candidate, than: Candidate, matches: Correspondences, inlier_threshold: float
) -> bool:
    """Whether there is more evidence for a pose than for another one of the same frame."""
    T, T_other = candidate.estimate.T_track_camera, than.estimate.T_track_camera
    if se3.difference(T, T_other) <= _SAME:
        return False
    agreeing, agreeing_with_other = (
        int(np.count_nonzero(distances(pose, matches) <= inlier_threshold)) for pose in (T, T_other)
    )
    # The light of a lamp on the camera is smooth: at the coarse levels it correlates at any pose.
    if _decided(candidate, agreeing, than, agreeing_with_other):
        return True
    if _decided(than, agreeing_with_other, candidate, agreeing):
        return False
    by_images = fit(candidate.coarse) - fit(than.coarse)
    by_motion = _likelier(candidate, than)
    if by_images + _MOTION * by_motion > 0:
        return True
    more = candidate.coarse.plane_agreement - than.coarse.plane_agreement
    return bool(
        _decide(agreeing, agreeing_with_other)
        and fit(candidate.refinement) > fit(than.refinement) - CLEARLY_BETTER
        and candidate.coarse.brightness_correlation >= than.coarse.brightness_correlation
        and more > -_PLANES_CONTRADICT
        and by_motion > -_MOTION_CONTRADICTS
    )


def _decided(
    candidate: Candidate, agreeing: int, than: Candidate, agreeing_with_other: int
) -> bool:
    """Whether matches decide for a pose and the finest level is for it, too.

    The finest level has to be clearly for it if few planes agree with it, as with a pose that
    follows a passer-by, or if the motion contradicts.
    """
    if not _decide(agreeing, agreeing_with_other):
        return False
    is_supported = (
        candidate.refinement.plane_agreement > _MOST_PLANES
        and _likelier(candidate, than) > -_MOTION_CONTRADICTS
    )
    least = 0.0 if is_supported else CLEARLY_BETTER
    return fit(candidate.refinement) - fit(than.refinement) > least


def _decide(agreeing: int, agreeing_with_other: int) -> bool:
    """Whether matches decide for the pose that so many of them agree with."""
    return agreeing >= _DECIDING_MATCHES and agreeing > _CLEARLY_MORE * agreeing_with_other


def _likelier(candidate: Candidate, than: Candidate) -> float:
    """How much likelier a pose is than another one, by the motion alone; from -1 to 1."""
    return _unlikeliness(than) - _unlikeliness(candidate)


def _unlikeliness(candidate: Candidate) -> float:
    """From 0 for normal motion of a hand-held camera to 1 at the limit of what is possible."""
    return min(candidate.distance_squared / POSE_GATE, 1.0) ** 2
