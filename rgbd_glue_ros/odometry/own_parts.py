"""Parts of the robot in view: what stays where it is in the image while the camera moves.

A gripper or a bumper moves with the camera, speaks against every motion, and weighs most, as it is
near. So a surface that is seen at the same depth in the same pixels from poses from which it, if it
stood still, would have to be seen elsewhere, is taken for one, and left out of frames from then on.
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
from rgbd_glue_ros.odometry.surfaces import BLOCK_PX, Surfaces, dense, pixels_of, widened
from rgbd_glue_ros.refinement.model import Mask
from rgbd_glue_ros.types import Float32, Float64, UInt8, View

logger = logging.getLogger(__name__)

# Motion from one view that is compared to the next, metres and radians added.
_APART = 0.04
# The latest views are compared, and of those before as many that are farther apart: some parts
# could stand still in a small motion.
_LATEST, _EARLIER, _FAR_APART = 3, 2, 0.2
# Depth that differs by fewer standard deviations has stayed, by more has changed.
_STAYED_SIGMAS, _CHANGED_SIGMAS = 4.0, 10.0
# An own part is nearer than this part of the median depth of what changes: of a room and somebody
# who walks by, the room is the farther.
_NEARER = 2 / 3
# Where almost everything is where it could not be, it is the pose that is wrong.
_MOST = 0.7
# So many times a block has to be seen as an own part; beside blocks that were, once.
_VOTES = 3
_MOST_VOTES = 100
# Own parts are painted in this: an image without edges says nothing.
_GREY = 128
# It is said when so much more of the view is left out.
_WORTH_SAYING = 0.05


@dataclass(frozen=True)
class OwnParts:
    """What is known of own parts.

    Attributes:
        votes: int8 [R, C], how often each block was seen as one, since its depth changed.
        views: that the next is compared with, the oldest first.
        said: the part of the view that the log said is left out, from 0 to 1.
    """

    votes: NDArray[np.int8] = field(default_factory=lambda: np.zeros((0, 0), np.int8))
    views: tuple[Surfaces, ...] = ()
    said: float = 0.0

    def needs(self, view: View, T_track_camera: Float64) -> bool:
        """Whether a view from there would tell anything new."""
        if min(view.depth.shape) < BLOCK_PX:
            return False
        views = self.views
        return not views or se3.difference(views[-1].T_track_depth, T_track_camera) > _APART

    def after_view(self, view: View, T_track_camera: Float64) -> OwnParts:
        """The same after another view, with own parts in it. Logs what is left out from now on.

        Args:
            view: as the camera gave it.
            T_track_camera: its pose, float64 [4, 4].
        """
        now = Surfaces.seen(view, T_track_camera)
        votes = self.votes
        if votes.shape != now.depth.shape:
            return OwnParts(np.zeros(now.depth.shape, np.int8), (now,))
        if self.views:
            own = np.any([_own(now, before, votes) for before in self.views], axis=0)
            changed = _sigmas_apart(now.depth, self.views[-1].depth) > _CHANGED_SIGMAS
            votes = np.where(changed, 0, np.minimum(votes + own, _MOST_VOTES)).astype(np.int8)
        after = OwnParts(votes, _spaced((*self.views, now)), self.said)
        share = 0.0 if after.blocks is None else float(after.blocks.mean())
        if share < self.said + _WORTH_SAYING:
            return after
        logger.warning(
            "%.0f %% of the view moves with the camera: taken for a part of the robot, and left "
            "out; odometry.own_parts: false leaves it in",
            100 * share,
        )
        return replace(after, said=share)

    def without_views(self) -> OwnParts:
        """The same where the poses of earlier views cannot be compared with those to come."""
        return replace(self, views=())

    @cached_property
    def blocks(self) -> UInt8 | None:
        """1 in the blocks of own parts, uint8 [R, C]; None where there are none."""
        often = np.asarray(self.votes >= _VOTES, np.uint8)
        if not often.any():
            return None
        sure = dense(often) > 0
        if not sure.any():
            return None
        _, labels = cv2.connectedComponents(np.asarray(self.votes > 0, np.uint8), connectivity=4)
        return widened(np.isin(labels, labels[sure]).astype(np.uint8))

    def left_out(self, view: View) -> View:
        """A view without its own parts: their depth is unknown, and the image flat there."""
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
    """Which blocks have stayed in the image and cannot have stood still, bool [R, C].

    Args:
        now: a view.
        before: another, whose own parts were in the same blocks.
        votes: int8 [R, C]; what they know already says nothing about the pose.
    """
    none = np.zeros(votes.shape, np.bool_)
    apart = _sigmas_apart(now.depth, before.depth)
    elsewhere = now.depth[apart >= _STAYED_SIGMAS]
    if len(elsewhere) == 0:
        return none
    stayed = (apart < _STAYED_SIGMAS) & (now.depth < _NEARER * np.median(elsewhere))
    # in most views nothing has, and where surfaces would be need not be looked at
    if not stayed.any():
        return none
    displaced = now.in_front_of(before)
    if np.count_nonzero(displaced[votes < _VOTES]) > _MOST * displaced.size:
        return none
    return np.asarray(stayed & ((displaced | before.in_front_of(now)) > 0), np.bool_)


def _spaced(views: tuple[Surfaces, ...]) -> tuple[Surfaces, ...]:
    """The views to go on with, the oldest first."""
    earlier: list[Surfaces] = []
    for view in views[:-_LATEST]:
        if not earlier or _is_far(earlier[-1], view):
            earlier.append(view)
    return (*earlier[-_EARLIER:], *views[-_LATEST:])


def _is_far(a: Surfaces, b: Surfaces) -> bool:
    return se3.difference(a.T_track_depth, b.T_track_depth) > _FAR_APART


@compiled
def _sigmas_apart(depth: Float32, other: Float32) -> Float64:
    """How far two depths differ, float64 [R, C], in standard deviations; NaN where unknown."""
    apart = np.full(depth.shape, np.nan)
    for r in range(depth.shape[0]):
        for c in range(depth.shape[1]):
            z, y = depth[r, c], other[r, c]
            apart[r, c] = abs(z - y) / depth_sigma(min(y, z))
    return apart
