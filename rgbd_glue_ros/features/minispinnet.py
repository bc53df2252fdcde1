"""MiniSpinNet: the learned descriptor of surfaces of BUFFER (Ao et al. 2023).

The surroundings of a point are turned so that its normal is the z axis, sampled around the centres
of a cylinder's cells, and described by a network that is invariant to turns about that axis.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.features import voxels
from rgbd_glue_ros.features.geometric import DescribedPoints, nearest_matches
from rgbd_glue_ros.features.layers import Tensor, Weights, batch_norm, convolution
from rgbd_glue_ros.features.torch_library import F, device_of, inference, torch
from rgbd_glue_ros.features.weights import load
from rgbd_glue_ros.geometry.camera import cloud
from rgbd_glue_ros.parameters import FeaturesConfig
from rgbd_glue_ros.types import Correspondences, Float32, Float64, TransformPrior, View

# The values that the published weights were trained with.
_SURFACE_VOXEL_M = 0.02
_RADIUS_M = 0.3
_PATCH_POINTS = 512
_RADII, _ELEVATIONS, _AZIMUTHS = 3, 7, 20
_CELL_RADIUS = 0.8 / _RADII
"""Radius of the sampled ball around the centre of a cell; that of the surroundings is 1."""
_CELL_POINTS = 10
_DIMENSIONS = 32

_BATCH = 128
"""Points described at once: 128 take 70 MB."""


class MiniSpinNet:
    """Points spread over the cloud and described, at most ``features.geometric_keypoints``."""

    def __init__(self, config: FeaturesConfig) -> None:
        self._device = device_of(config.device)
        self._weights = load("buffer_3dmatch_desc.pth", config, self._device).below("Desc")
        self._voxel = config.voxel
        self._most = config.geometric_keypoints

    def extract(self, view: View) -> DescribedPoints:
        """Thins the cloud and describes as many of its points as are allowed."""
        points = cloud(view.depth, view.intrinsics)
        surface = voxels.voxel_means(points, _SURFACE_VOXEL_M)
        keypoints = _spread(voxels.voxel_means(points, self._voxel), self._most)
        if not len(keypoints):
            return DescribedPoints(keypoints, np.empty((0, _DIMENSIONS), np.float32))
        patches = surroundings(surface, keypoints)
        descriptors = [
            self._described(patches[start : start + _BATCH])
            for start in range(0, len(patches), _BATCH)
        ]
        return DescribedPoints(keypoints, np.concatenate(descriptors))

    def match(
        self,
        source: DescribedPoints,
        target: DescribedPoints,
        prior: TransformPrior | None,  # noqa: ARG002 - the paper matches first and filters after
    ) -> Correspondences:
        """Section 3.1."""
        return nearest_matches(source, target)

    def _described(self, patches: Float64) -> Float32:
        sampled = cells(patches, centres(), _CELL_RADIUS, _CELL_POINTS)
        with inference(self._device):
            descriptors = describe(torch.from_numpy(sampled).to(self._device), self._weights)
            result: Float32 = descriptors.float().cpu().numpy()
        return result


def _spread(points: Float64, most: int) -> Float64:
    """At most a given number of the points, spread evenly over their order."""
    count = min(len(points), most)
    chosen: Float64 = points[np.arange(count) * len(points) // max(count, 1)]
    return chosen


def surroundings(surface: Float64, keypoints: Float64) -> Float64:
    """The surface around each keypoint in its own frame, in units of the radius.

    Args:
        surface: float64 [N, 3], in the optical frame, metres.
        keypoints: float64 [K, 3], likewise.

    Returns:
        float64 [K, 512, 3]: the keypoint at 0, its normal along z; if there are fewer points, the
        rest is 0, as is the last one.
    """
    # of more points a selection is used, the same one every time
    order = np.random.default_rng(0).permutation(len(surface))
    shuffled = surface[order]
    near = cKDTree(shuffled).query_ball_point(keypoints, _RADIUS_M, return_sorted=True)
    patches = np.zeros((len(keypoints), _PATCH_POINTS, 3))
    for patch, keypoint, numbers in zip(patches, keypoints, near, strict=True):
        chosen = shuffled[numbers[: _PATCH_POINTS - 1]]
        patch[: len(chosen)] = (chosen - keypoint) / _RADIUS_M
    turns = upright(_normals(patches, keypoints))
    turned: Float64 = np.einsum("kij,knj->kni", turns, patches)
    return turned


def _normals(patches: Float64, keypoints: Float64) -> Float64:
    """Directions of least spread around the keypoint, towards the camera, [K, 3]."""
    spread = np.einsum("kni,knj->kij", patches, patches)
    directions = np.linalg.eigh(spread)[1][:, :, 0]
    away = np.einsum("ki,ki->k", directions, keypoints) > 0
    return np.where(away[:, None], -directions, directions)


def upright(directions: Float64) -> Float64:
    """The smallest rotations [K, 3, 3] that turn unit vectors [K, 3] to the z axis."""
    x, y, z = directions.T
    opposite = z < -1 + 1e-9
    scale = 1 / np.where(opposite, 1.0, 1 + z)
    R = np.empty((len(directions), 3, 3))
    R[:, 0] = np.stack([1 - x * x * scale, -x * y * scale, -x], axis=1)
    R[:, 1] = np.stack([-x * y * scale, 1 - y * y * scale, -y], axis=1)
    R[:, 2] = directions
    R[opposite] = np.diag([1.0, -1.0, -1.0])
    return R


def centres() -> Float64:
    """Centres of the cells, [3 * 7 * 20, 3]: by radius, by elevation, by azimuth."""
    radius = (np.arange(_RADII) + 0.5) / _RADII
    elevation = (np.arange(_ELEVATIONS) + 0.5) * np.pi / _ELEVATIONS
    azimuth = (np.arange(_AZIMUTHS) + 0.5) * 2 * np.pi / _AZIMUTHS
    r, e, a = (grid.ravel() for grid in np.meshgrid(radius, elevation, azimuth, indexing="ij"))
    return np.stack([r * np.sin(e) * np.cos(a), r * np.sin(e) * np.sin(a), r * np.cos(e)], axis=1)


@compiled
def cells(patches: Float64, centre: Float64, radius: float, most: int) -> Float32:
    """The first points of each patch in the ball around each centre, seen from that azimuth.

    Args:
        patches: float64 [K, N, 3].
        centre: float64 [C, 3], by azimuth last, as ``centres`` gives them.
        radius: of the balls.
        most: points of each.

    Returns:
        float32 [K, 3, C, most]; 0 where there are fewer points.
    """
    sampled = np.zeros((len(patches), 3, len(centre), most), np.float32)
    for k in range(len(patches)):
        for c in range(len(centre)):
            turn = -2 * np.pi / _AZIMUTHS * (c % _AZIMUTHS)
            cosine, sine = np.cos(turn), np.sin(turn)
            count = 0
            for n in range(patches.shape[1]):
                x, y, z = patches[k, n, 0], patches[k, n, 1], patches[k, n, 2]
                dx, dy, dz = x - centre[c, 0], y - centre[c, 1], z - centre[c, 2]
                if dx * dx + dy * dy + dz * dz < radius * radius:
                    sampled[k, 0, c, count] = cosine * x - sine * y
                    sampled[k, 1, c, count] = sine * x + cosine * y
                    sampled[k, 2, c, count] = z
                    count += 1
                    if count == most:
                        break
    return sampled


def describe(sampled: Tensor, w: Weights) -> Tensor:
    """The network.

    Args:
        sampled: [K, 3, C, S], as ``cells`` gives them.
        w: weights of the descriptor.

    Returns:
        Unit descriptors [K, 32].
    """
    x = F.relu(batch_norm(convolution(sampled, w.below("pnt_layer", 0)), w.below("pnt_layer", 1)))
    x = x.amax(dim=3).unflatten(2, (_RADII, _ELEVATIONS, _AZIMUTHS))
    first = w.below("conv_net", "ops")
    x = F.conv3d(_around(x), first["0.weight"], first["0.bias"])
    x = F.relu(batch_norm(x, first.below(1))).squeeze(2)
    for layer in range(3, 21, 3):
        x = F.relu(batch_norm(convolution(_around(x), first.below(layer)), first.below(layer + 1)))
    x = convolution(_around(x), first.below(21))
    pool = w.below("pool_layer")
    weight = F.relu(batch_norm(convolution(x, pool.below(0)), pool.below(1)))
    weight = F.relu(batch_norm(convolution(weight, pool.below(3)), pool.below(4)))
    return F.normalize((x * weight).mean(dim=(2, 3)), dim=1)


def _around(x: Tensor) -> Tensor:
    """Pads the last two dimensions by a cell at each side: azimuth wraps around, elevation ends."""
    round_about = torch.cat([x[..., -1:], x, x[..., :1]], dim=-1)
    return F.pad(round_about, (0, 0, 1, 1))
