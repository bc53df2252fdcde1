"""The minimum cost of each stage: the same operation in OpenCV's or Open3D's C++.

Measured on frames of the contest, right after it. A floor is not a peer: it does the core of a
stage without its surroundings (selecting keypoints, looking up depth, weighing evidence).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from statistics import median
from typing import Any

import cv2
import numpy as np

from rgbd_glue_ros.features.visual import orb_detector
from rgbd_glue_ros.geometry.camera import back_project
from rgbd_glue_ros.geometry.depth import depth_at, limit_depth
from rgbd_glue_ros.geometry.normals import grid_points_and_normals
from rgbd_glue_ros.geometry.views import grey, rectified
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.refinement.model import LEVELS
from rgbd_glue_ros.stopwatch import timed
from rgbd_glue_ros.types import RgbdFrame, stages

_EVERY = 50
# One of several consecutive runs finds warm caches and no other process on the core.
_RUNS = 3
_MIN_MATCHES = 4
_SURE = 0.9999


@dataclass(frozen=True)
class Floor:
    """The core of a stage.

    Attributes:
        stage: one of ``types.stages``.
        what: the operation run in its place.
        work: runs it on a frame and the previous one.
        needs_open3d: whether Open3D runs it.
        is_of_orb: whether it works on ORB keypoints, so that it is the floor of no other feature.
    """

    stage: str
    what: str
    work: Callable[[Inputs, Inputs], object]
    needs_open3d: bool = False
    is_of_orb: bool = False


class Inputs:
    """The inputs of the floors for one frame, computed before timing."""

    def __init__(self, frame: RgbdFrame, config: Config, before: Inputs | None = None) -> None:
        self.before = before
        self.frame = rectified(frame)
        self.config = config
        self.grey = grey(self.frame.color)
        self.depth = limit_depth(self.frame.depth, config.camera)
        self.spare = np.empty_like(self.depth)

    @cached_property
    def keypoints(self) -> tuple[Any, Any]:
        """ORB keypoints and descriptors."""
        found: tuple[Any, Any] = self.orb.detectAndCompute(self.grey, None)
        return found

    @cached_property
    def orb(self) -> Any:
        """OpenCV's detector."""
        return orb_detector(self.config.features)

    @cached_property
    def uv(self) -> Any:
        """float32 [N, 2], positions of the keypoints."""
        return np.array(cv2.KeyPoint.convert(self.keypoints[0]), np.float32).reshape(-1, 2)

    @cached_property
    def grid(self) -> Any:
        """Open3D's cloud of the points that geometric features are computed for."""
        return self.cloud(self.config.features.grid_step)

    @cached_property
    def planes(self) -> Any:
        """Open3D's cloud of the points of a keyframe's planes, with their normals."""
        return self.cloud(self.config.refine.grid_step)

    def cloud(self, step: int) -> Any:
        """Open3D's cloud of every ``step``-th pixel, with normals."""
        o3d = _open3d()
        points, normals = grid_points_and_normals(self.depth, self.frame.intrinsics, step)
        known = np.isfinite(points[..., 2])
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points[known]))
        cloud.normals = o3d.utility.Vector3dVector(normals[known])
        return cloud

    @cached_property
    def matched(self) -> tuple[Any, Any]:
        """Points [N, 3] of the previous frame, and the pixels [N, 2] they are matched with."""
        if self.before is None:
            return np.empty((0, 3)), np.empty((0, 2))
        matches = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(
            self.keypoints[1], self.before.keypoints[1]
        )
        uv = self.uv[[m.queryIdx for m in matches]]
        uv_before = self.before.uv[[m.trainIdx for m in matches]]
        z = depth_at(self.before.depth, *uv_before.T.astype(np.float64))
        known = np.isfinite(z)
        points = back_project(uv_before[known], z[known], self.frame.intrinsics)
        return points, uv[known].astype(np.float64)

    @property
    def is_empty(self) -> bool:
        """Whether it shows too little for the floors to work on."""
        return len(self.uv) < 2 or not np.isfinite(self.depth).any()


def _open3d() -> Any:
    import open3d  # noqa: PLC0415 - takes seconds and is optional

    return open3d


def _preparation(now: Inputs, _: Inputs) -> object:
    np.copyto(now.spare, now.frame.depth)
    return grey(now.frame.color)


def _visual_features(now: Inputs, _: Inputs) -> object:
    return now.orb.detectAndCompute(now.grey, None)


def _visual_matching(now: Inputs, before: Inputs) -> object:
    matcher = cv2.BFMatcher(cv2.NORM_HAMMING)
    return matcher.knnMatch(now.keypoints[1], before.keypoints[1], k=2)


def _geometric_features(now: Inputs, _: Inputs) -> object:
    o3d = _open3d()
    search = o3d.geometry.KDTreeSearchParamHybrid(radius=0.12, max_nn=48)
    return o3d.pipelines.registration.compute_fpfh_feature(now.grid, search)


def _geometric_matching(now: Inputs, before: Inputs) -> object:
    evaluate = _open3d().pipelines.registration.evaluate_registration
    return evaluate(now.grid, before.grid, 0.1, np.eye(4))


def _ransac(now: Inputs, _: Inputs) -> object:
    points, uv = now.matched
    if len(points) < _MIN_MATCHES:
        return None
    return cv2.solvePnPRansac(
        points,
        uv,
        now.frame.intrinsics.matrix,
        None,
        iterationsCount=now.config.ransac.iterations,
        confidence=_SURE,
        flags=cv2.SOLVEPNP_P3P,
    )


def _refinement(now: Inputs, before: Inputs) -> object:
    registration = _open3d().pipelines.registration
    return registration.registration_icp(
        now.planes,
        before.planes,
        0.1,
        np.eye(4),
        registration.TransformationEstimationPointToPlane(),
        # no convergence limit: every iteration is run
        registration.ICPConvergenceCriteria(0.0, 0.0, now.config.refine.iterations * LEVELS),
    )


def _keyframe(now: Inputs, _: Inputs) -> object:
    now.planes.estimate_normals(_open3d().geometry.KDTreeSearchParamKNN(9))
    return [cv2.Sobel(now.grey, cv2.CV_16S, *direction) for direction in ((1, 0), (0, 1))]


FLOORS = (
    Floor(stages.PREPARATION, "grey image by OpenCV, one copy of the depth image", _preparation),
    Floor(
        stages.VISUAL_FEATURES, "cv2.ORB with the same settings", _visual_features, is_of_orb=True
    ),
    Floor(
        stages.GEOMETRIC_FEATURES,
        "Open3D's FPFH of the same points, normals given",
        _geometric_features,
        needs_open3d=True,
    ),
    Floor(
        stages.VISUAL_MATCHING,
        "cv2.BFMatcher, two nearest of all",
        _visual_matching,
        is_of_orb=True,
    ),
    Floor(
        stages.RANSAC,
        "cv2.solvePnPRansac by three points; it stops once it is sure",
        _ransac,
        is_of_orb=True,
    ),
    Floor(
        stages.GEOMETRIC_MATCHING,
        "Open3D's nearest neighbours within 10 cm in space alone",
        _geometric_matching,
        needs_open3d=True,
    ),
    Floor(
        stages.REFINEMENT,
        "Open3D's point-to-plane ICP, as many points and iterations",
        _refinement,
        needs_open3d=True,
    ),
    Floor(
        stages.KEYFRAME,
        "Open3D's normals of the same points, gradients by cv2.Sobel",
        _keyframe,
        needs_open3d=True,
    ),
)


class Floors:
    """Measures all floors on every fiftieth frame."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._count = 0
        self._before: RgbdFrame | None = None
        has_open3d = find_spec("open3d") is not None
        is_orb = config.features.visual == "orb"
        self._floors = [
            floor
            for floor in FLOORS
            if (has_open3d or not floor.needs_open3d) and (is_orb or not floor.is_of_orb)
        ]
        self._ms: dict[str, list[float]] = {floor.stage: [] for floor in self._floors}

    def show(self, frame: RgbdFrame) -> None:
        """Processes the next frame."""
        before, self._before = self._before, frame
        self._count += 1
        if before is None or self._count % _EVERY:
            return
        then = Inputs(before, self._config)
        now = Inputs(frame, self._config, then)
        if now.is_empty or then.is_empty:
            return
        for floor in self._floors:
            self._ms[floor.stage].append(_milliseconds(floor, now, then))

    def figures(self) -> dict[str, Any]:
        """Median of each floor, milliseconds; without those whose library is not installed."""
        return {"floors_ms": {stage: median(ms) for stage, ms in self._ms.items() if ms}}


def _milliseconds(floor: Floor, now: Inputs, before: Inputs) -> float:
    return min(timed(floor.work, now, before)[1] for _ in range(_RUNS))
