"""The inputs of a refinement: the model, the frame whose pose is refined, and the parameters."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from rgbd_glue_ros.geometry.normals import relative_edge
from rgbd_glue_ros.parameters import RefineConfig
from rgbd_glue_ros.refinement.image_pyramid import ImagePyramid
from rgbd_glue_ros.refinement.level_problem import Exposure, LevelProblem
from rgbd_glue_ros.refinement.model import Model
from rgbd_glue_ros.types import Correspondences, View

NO_MATCHES = Correspondences.empty()
# Weight of a match relative to a plane, a few times that of a pixel: enough to hold a pose where
# planes and pixels do not determine it. Where they do, they outweigh the matches by their number
# and accuracy.
_MATCH_WEIGHT = 30.0
# A small image has as many planes as a large one, but fewer pixels: each weighs more, by up to this
# factor.
_GREATEST_WEIGHT_FACTOR = 2.0
_NO_IMAGES = ImagePyramid(np.empty((0, 0), np.uint8))


@dataclass(frozen=True)
class RefinementProblem:
    """The inputs of a refinement.

    The pyramid of the frame's image is computed once, and shared with copies that ``replace`` makes
    with the same image. It is freed with the last of them, so keep none longer than its frame.

    Attributes:
        model: planes and pixels.
        view: the frame whose pose is refined, with its estimated twist.
        config: steps at each level (0 only evaluates the start) and weights.
        matches: visual matches between the frame and the model, which also constrain the pose.
        images: pyramid of the view's image; set by this class, not by callers.
    """

    model: Model
    view: View
    config: RefineConfig
    matches: Correspondences = NO_MATCHES
    images: ImagePyramid = field(default=_NO_IMAGES, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Creates a pyramid, unless ``replace`` has passed on one of the same image."""
        if self.images.at_level(0) is not self.view.grey:
            object.__setattr__(self, "images", ImagePyramid(self.view.grey))

    def without_matches(self) -> RefinementProblem:
        """The same problem with planes and pixels only."""
        return replace(self, matches=NO_MATCHES)

    def at_level(self, level: int) -> LevelProblem:
        """The problem at a pyramid level, with every 2^level-th plane of the model."""
        view, config = self.view, self.config
        planes, pixels = self.model.planes, self.model.pixels[level]
        image, K = self.images.at_level(level), view.intrinsics.focal_and_centre
        # pyrDown centres pixel i of a level on pixel 2 i of the next finer one
        K_depth, K_image = tuple(K.tolist()), tuple((K / 2**level).tolist())
        twist, readout_time = tuple(view.twist.tolist()), view.readout_time
        every = slice(None, None, 2**level)
        return LevelProblem(
            points=np.ascontiguousarray(planes.points[every].T),
            normals=np.ascontiguousarray(planes.normals[every].T),
            depth=view.depth,
            depth_exposure=Exposure(
                K_depth, view.depth.shape[0], twist, readout_time, view.depth_delay
            ),
            pixels=np.ascontiguousarray(pixels.points.T),
            brightness=pixels.brightness,
            image=image,
            image_exposure=Exposure(K_image, image.shape[0], twist, readout_time, 0.0),
            plane_cauchy=config.plane_cauchy,
            pixel_cauchy=config.pixel_cauchy,
            pixel_weight=config.pixel_weight,
            noisy_pixel_weight=config.pixel_weight * _weight_factor_of_pixels(view),
            match_source=self.matches.source,
            match_target=self.matches.target,
            match_weight=_MATCH_WEIGHT,
            contrast=view.contrast,
            depth_noise=view.depth_noise,
        )


def _weight_factor_of_pixels(view: View) -> float:
    return min(max(1 / relative_edge(view), 1.0), _GREATEST_WEIGHT_FACTOR)
