"""Checks whether depth is registered to colour, by whether their edges coincide.

Where a surface ends in front of another one, brightness usually changes too. A depth camera has a
different focal length and position than the colour camera, so in unregistered depth edges lie
elsewhere. Depth edges are overlaid on colour edges, magnified and shifted in steps, as in
calibration by edge alignment (Levinson and Thrun 2013). Registered depth fits best unchanged.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.reduction import reduced
from rgbd_glue_ros.odometry.edge_overlay import Orientation, Placement, Placements, overlay_scores
from rgbd_glue_ros.types import Float64, RgbdFrame, View

logger = logging.getLogger(__name__)

# Larger images are reduced first: what is tried is meant for images of about 640 columns.
_MAX_WIDTH_PX = 848
_SHIFTS_PX = np.linspace(-15.0, 15.0, 11)


@dataclass(frozen=True)
class Search:
    """Placements that are tried together, and what it takes to decide for one.

    Attributes:
        placements: of depth on colour.
        views: the number of views that decide.
        sigmas: by how many standard deviations of all scores the best one has to stand out.
    """

    placements: Placements
    views: int
    sigmas: float


# What is tried first: depth of one device, in pixels of its own camera. Other rooms reached 3.9.
_NEAR = Search(
    Placements((Orientation.ALIKE,), np.linspace(0.85, 1.15, 11), _SHIFTS_PX), views=8, sigmas=4.0
)
# What is tried if depth does not fit as it is, nor nearly so: cameras of other fields of view, and
# drivers that mirror or turn one of the images. Other rooms reached 6.1.
_FAR = Search(
    Placements(tuple(Orientation), np.geomspace(1 / 1.8, 1.8, 23), _SHIFTS_PX), views=4, sigmas=6.5
)
# After so many views the rest is tried, unless there are signs of registered depth.
_SUSPICIOUS_VIEWS = 3
# Least motion between two such views, metres and radians added.
_APART = 0.05
# Another place has to fit this many times better than the identity.
_BETTER = 2.0
# The least accepted score. Overlaid edges of different rooms reached 0.08.
_LEAST_SCORE = 0.12


@dataclass(frozen=True)
class DepthColorCheck:
    """How well depth edges fit colour edges, for each placement, over several views.

    Attributes:
        search: what is being tried.
        score: float64 of the shape of its placements, mean over the views.
        views: the number of views.
        T_track_camera: pose of the last view, float64 [4, 4]; None before the first.
    """

    search: Search
    score: Float64
    views: int = 0
    T_track_camera: Float64 | None = None

    @staticmethod
    def start(search: Search = _NEAR) -> DepthColorCheck:
        """The check before any view."""
        return DepthColorCheck(search, np.zeros(search.placements.shape))

    def needs(self, view: View, T_track_camera: Float64) -> bool:
        """Whether a view from that pose would add information."""
        if self.views >= self.search.views or not _is_of_one_moment(view):
            return False
        if self.T_track_camera is None:
            return True
        return se3.difference(self.T_track_camera, T_track_camera) > _APART

    def after_view(self, view: View, T_track_camera: Float64) -> DepthColorCheck:
        """The check after another view. Logs a warning once depth is known to be unregistered."""
        view, pixels_per_pixel = _reduced(view)
        score = overlay_scores(view, self.search.placements)
        if score is None:
            return replace(self, T_track_camera=T_track_camera)
        views = self.views + 1
        mean = self.score + (score - self.score) / views
        after = DepthColorCheck(self.search, mean, views, T_track_camera)
        if after.placement is not None:
            logger.warning("%s", _fault(after.placement, pixels_per_pixel))
        elif self.search is _NEAR and after._is_suspicious:
            return replace(DepthColorCheck.start(_FAR), T_track_camera=T_track_camera)
        return after

    @property
    def _is_suspicious(self) -> bool:
        """Whether there is too little sign of registered depth for so many views."""
        least = _LEAST_SCORE * self.views / self.search.views
        return self.views >= _SUSPICIOUS_VIEWS and self._at_identity < least

    @property
    def _at_identity(self) -> float:
        """The score of registered depth."""
        orientation, scale, right, down = self.search.placements.identity
        # images that are not taken at exactly the same time differ by a few pixels
        near = self.score[orientation, scale, right - 1 : right + 2, down - 1 : down + 2]
        return float(near.max())

    @cached_property
    def placement(self) -> Placement | None:
        """How depth lies on colour, in pixels of an image of about 640 columns.

        None if it is registered, or while that is unknown.
        """
        index = int(np.argmax(self.score))
        best = float(self.score.flat[index])
        if (
            self.views < self.search.views
            or best < max(_LEAST_SCORE, _BETTER * self._at_identity)
            or best < self.score.mean() + self.search.sigmas * self.score.std()
        ):
            return None
        return self.search.placements.at(index)


def _fault(placement: Placement, pixels_per_pixel: int) -> str:
    """What is wrong with depth that lies so on colour, and what to do."""
    if placement.orientation is Orientation.ALIKE:
        return (
            "depth is not registered to colour: its edges are off by "
            f"{placement.offset_px * pixels_per_pixel:.0f} pixels; give the aligned or registered "
            "depth topic. Colour counts for less from here on"
        )
    return (
        f"depth and colour are {placement.orientation.value} against each other, and poses wrong: "
        "switch off what mirrors, flips or turns one of the two in the driver, as color_mirroring, "
        "depth_flip or a rotation"
    )


def _reduced(view: View) -> tuple[View, int]:
    """A view of about 640 columns or fewer, and the side of the block that became a pixel."""
    frame = reduced(RgbdFrame(0, view.grey, view.depth, view.intrinsics), _MAX_WIDTH_PX)
    small = replace(view, grey=frame.color, depth=frame.depth, intrinsics=frame.intrinsics)
    return small, view.intrinsics.width // frame.intrinsics.width


def _is_of_one_moment(view: View) -> bool:
    """Whether the camera hardly moved between the colour image and the depth image."""
    speed = np.linalg.norm(view.twist[:3]) + np.linalg.norm(view.twist[3:])
    moved_px = view.intrinsics.fx * speed * abs(view.depth_delay)
    return bool(moved_px <= _SHIFTS_PX[1] - _SHIFTS_PX[0])
