"""The common part of the Open3D peers (MIT licence)."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np

from rgbd_glue_ros.errors import MissingExtraError
from rgbd_glue_ros.geometry.camera import back_project
from rgbd_glue_ros.types import View


def load_open3d(peer: str) -> ModuleType:
    """Imports the library, with seeded random choices.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        import open3d  # noqa: PLC0415 - takes seconds and is optional
    except ImportError as error:
        raise MissingExtraError("open3d", "open3d", f"the peer {peer}") from error
    open3d.utility.random.seed(0)
    module: ModuleType = open3d
    return module


def grey_cloud(open3d: ModuleType, view: View) -> Any:
    """The cloud of a frame, with brightness as the points' colour."""
    v, u = np.nonzero(np.isfinite(view.depth))
    uv = np.stack([u, v], axis=1).astype(np.float64)
    points = open3d.geometry.PointCloud(
        open3d.utility.Vector3dVector(
            back_project(uv, view.depth[v, u].astype(np.float64), view.intrinsics)
        )
    )
    brightness = view.grey[v, u].astype(np.float64) / 255
    points.colors = open3d.utility.Vector3dVector(np.repeat(brightness[:, None], 3, axis=1))
    return points
