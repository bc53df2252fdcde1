"""Parts of the robot in view: surfaces that stay in the image while the camera moves.

A gripper or a bumper moves with the camera, contradicts every motion, and has the most weight,
since it is near. So a surface that keeps its depth at the same pixels, at poses from which a static
surface would be seen elsewhere, is classified as such a part, and ignored from then on.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, field, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.depth import depth_sigma
from rgbd_glue_ros.odometry.surfaces import (
    BLOCK_PX,
    Surfaces,
    dense,
    depth_pose,
    pixels_of,
    widened,
)
from rgbd_glue_ros.types import Float32, Float64, Mask, UInt8, View

logger = logging.getLogger(__name__)

# Motion between views that are compared, metres and radians added.
_APART = 0.04
# A view is compared with this number of the latest ones,
_LATEST = 3
# and of earlier ones that are farther apart: some parts could stand still in a small motion.
_EARLIER = 2
# Least motion between earlier views, metres and radians added.
_FAR_APART = 0.2
# Depth that differs by fewer standard deviations is unchanged.
_STAYED_SIGMAS = 4.0
# Depth that differs by more standard deviations has changed.
_CHANGED_SIGMAS = 10.0
# An own part is nearer than this fraction of the median depth of what changes: the room is farther
# away than a passer-by.
_NEARER = 2 / 3
# If almost everything is where it could not be, the pose is wrong instead.
_MOST = 0.7
# Times that a block has to be seen as an own part; once, if it is next to blocks that were.
_VOTES = 3
# Votes are counted up to here: one byte holds them.
_MOST_VOTES = 100
# Own parts are painted in this grey: an image without edges says nothing.
_GREY = 128
# It is logged when this much more of the view is ignored.
_WORTH_SAYING = 0.05


@dataclass(frozen=True)
class OwnParts:
    """What is known about own parts.

    Attributes:
        votes: int8 [R, C], how often each block was seen as one, since its depth changed.
        views: views that the next is compared with, the oldest first.
        logged_share: the fraction of the view that was logged as ignored, from 0 to 1.
    """

    votes: NDArray[np.int8] = field(default_factory=lambda: np.zeros((0, 0), np.int8))
    views: tuple[Surfaces, ...] = ()
    logged_share: float = 0.0

    def needs(self, view: View, T_track_camera: Float64) -> bool:
        """Whether a view from that pose would add information."""
        if min(view.depth.shape) < BLOCK_PX:
            return False
        if not self.views:
            return True
        T_track_depth = depth_pose(view, T_track_camera)
        return se3.difference(self.views[-1].T_track_depth, T_track_depth) > _APART

    def after_view(self, view: View, T_track_camera: Float64) -> OwnParts:
        """The own parts after another view that contains them. Logs what is ignored from now on.

        Args:
            view: the view, with own parts still in it.
            T_track_camera: its pose, float64 [4, 4].
        """
        now = Surfaces.seen(view, T_track_camera)
        votes = self.votes
        if votes.shape != now.depth.shape:
            return OwnParts(np.zeros(now.depth.shape, np.int8), (now,))
        if self.views:
            own = np.any([_own(now, before, votes) for before in self.views], axis=0)
            changed = _sigmas_apart(now, self.views[-1]) > _CHANGED_SIGMAS
            votes = np.where(changed, 0, np.minimum(votes + own, _MOST_VOTES)).astype(np.int8)
        after = OwnParts(votes, _spaced((*self.views, now)), self.logged_share)
        share = 0.0 if after.blocks is None else float(after.blocks.mean())
        if share < self.logged_share + _WORTH_SAYING:
            return after
        logger.warning(
            "%.0f %% of the view moves with the camera: treated as a part of the robot, and "
            "ignored; odometry.own_parts: false keeps it",
            100 * share,
        )
        return replace(after, logged_share=share)

    def without_views(self) -> OwnParts:
        """The own parts without earlier views, whose poses cannot be compared with later ones."""
        return replace(self, views=())

    @cached_property
    def blocks(self) -> UInt8 | None:
        """1 in the blocks of own parts, uint8 [R, C]; None if there are none."""
        often = np.asarray(self.votes >= _VOTES, np.uint8)
        if not often.any():
            return None
        sure = dense(often) > 0
        if not sure.any():
            return None
        _, labels = cv2.connectedComponents(np.asarray(self.votes > 0, np.uint8), connectivity=4)
        return widened(np.isin(labels, labels[sure]).astype(np.uint8))

    def left_out(self, view: View) -> View:
        """A view without own parts: there depth is unknown, and the image flat."""
        blocks = self.blocks
        if blocks is None:
            return view
        own = pixels_of(blocks, view)
        return replace(
            view,
            depth=np.where(own, np.float32(np.nan), view.depth),
            grey=np.where(own, np.uint8(_GREY), view.grey),
        )


def _own(now: Surfaces, before: Surfaces, votes: NDArray[np.int8]) -> Mask:
    """Which blocks have stayed in the image and cannot be static in the room, bool [R, C].

    Args:
        now: a view.
        before: another view, whose own parts were in the same blocks.
        votes: int8 [R, C]; known own parts say nothing about the pose.
    """
    none = np.zeros(votes.shape, np.bool_)
    apart = _sigmas_apart(now, before)
    elsewhere = now.depth[apart >= _STAYED_SIGMAS]
    if len(elsewhere) == 0:
        return none
    stayed = (apart < _STAYED_SIGMAS) & (now.depth < _NEARER * np.median(elsewhere))
    # in most views nothing has, so projecting surfaces can be skipped
    if not stayed.any():
        return none
    displaced = now.in_front_of(before)
    if np.count_nonzero(displaced[votes < _VOTES]) > _MOST * displaced.size:
        return none
    return np.asarray(stayed & ((displaced | before.in_front_of(now)) > 0), np.bool_)


def _spaced(views: tuple[Surfaces, ...]) -> tuple[Surfaces, ...]:
    """The views to keep, the oldest first."""
    earlier: list[Surfaces] = []
    for view in views[:-_LATEST]:
        if not earlier or _is_far(earlier[-1], view):
            earlier.append(view)
    return (*earlier[-_EARLIER:], *views[-_LATEST:])


def _is_far(a: Surfaces, b: Surfaces) -> bool:
    return se3.difference(a.T_track_depth, b.T_track_depth) > _FAR_APART


def _sigmas_apart(now: Surfaces, before: Surfaces) -> Float64:
    """Difference of two views' depths, float64 [R, C], in standard deviations; NaN if unknown."""
    return _depths_apart(now.depth, before.depth) / max(now.noise, before.noise)


@compiled
def _depths_apart(depth: Float32, other: Float32) -> Float64:
    """Difference of two depths, float64 [R, C], in ``depth_sigma``; NaN where one is unknown."""
    apart = np.full(depth.shape, np.nan)
    for r in range(depth.shape[0]):
        for c in range(depth.shape[1]):
            z, z_other = depth[r, c], other[r, c]
            apart[r, c] = abs(z - z_other) / depth_sigma(min(z_other, z))
    return apart
