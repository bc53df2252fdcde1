"""Maps of any size."""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.slam.map_file import SavedMap
from rgbd_glue_ros.slam.packed_view import packed
from rgbd_glue_ros.types import PoseGraph, PoseGraphEdge, Trajectory, View
from rigs.pan import Pan


def map_of(count: int) -> SavedMap:
    """A map of one view many times."""
    frame = next(iter(Pan(1)))
    view = packed(View(frame.color[..., 0].copy(), frame.depth, frame.intrinsics))
    poses = np.tile(np.eye(4), (count, 1, 1))
    edges = tuple(PoseGraphEdge(i, i + 1, np.eye(4), np.eye(6)) for i in range(count - 1))
    graph = PoseGraph(Trajectory(np.arange(count, dtype=np.int64), poses), edges)
    return SavedMap(graph, (view,) * count)
