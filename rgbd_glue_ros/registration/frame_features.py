"""What registration knows of a frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from rgbd_glue_ros.features.lifting import KeypointPoints
from rgbd_glue_ros.geometry.motion_compensation import keypoints_to_points
from rgbd_glue_ros.types import Float32, Float64, Mask, View, stages


class Described(Protocol):
    """Visual and geometric features of a frame, and where its pixels are in 3D."""

    @property
    def visual(self) -> Any:
        """Features of the configured visual kind."""

    @property
    def geometric(self) -> Any:
        """Features of the configured geometric kind."""

    def points_at(self, uv: Float32) -> tuple[Float64, Mask]:
        """Points [M, 3] at pixels uv [N, 2], metres, and which pixels [N] have one."""


@dataclass(frozen=True)
class FrameFeatures:
    """A frame and what was extracted from it; ``Described``.

    Attributes:
        view: the frame as the features saw it.
        visual: features of the configured visual kind.
        geometric: features of the configured geometric kind.
        stages_ms: wall time of each extraction, milliseconds.
    """

    view: View
    visual: Any
    geometric: Any
    stages_ms: dict[str, float]

    @staticmethod
    def timed(view: View, visual: tuple[Any, float], geometric: tuple[Any, float]) -> FrameFeatures:
        """Features of a view, each with the milliseconds that its extraction took."""
        times = {stages.VISUAL_FEATURES: visual[1], stages.GEOMETRIC_FEATURES: geometric[1]}
        return FrameFeatures(view, visual[0], geometric[0], times)

    def points_at(self, uv: Float32) -> tuple[Float64, Mask]:
        """Points [M, 3] at pixels uv [N, 2], metres, and which pixels [N] have one."""
        return keypoints_to_points(uv, self.view)


@dataclass(frozen=True)
class FeaturesInProgress:
    """A frame whose geometric features another thread extracts; ``Described``.

    Attributes:
        view: the frame as the features see it.
        timed_visual: features of the configured visual kind, and the milliseconds they took.
        timed_geometric: waits for those of the configured geometric kind, and their milliseconds.
    """

    view: View
    timed_visual: tuple[Any, float]
    timed_geometric: Callable[[], tuple[Any, float]]

    @property
    def visual(self) -> Any:
        """Features of the configured visual kind."""
        return self.timed_visual[0]

    @property
    def geometric(self) -> Any:
        """Features of the configured geometric kind; waits for them."""
        return self.timed_geometric()[0]

    def points_at(self, uv: Float32) -> tuple[Float64, Mask]:
        """Points [M, 3] at pixels uv [N, 2], metres, and which pixels [N] have one."""
        return keypoints_to_points(uv, self.view)

    def complete(self) -> FrameFeatures:
        """All features; waits for them."""
        return FrameFeatures.timed(self.view, self.timed_visual, self.timed_geometric())


@dataclass(frozen=True)
class KeypointFeatures:
    """What was extracted from a frame whose images were not kept; ``Described``.

    Attributes:
        visual: features of the configured visual kind.
        geometric: features of the configured geometric kind.
        points: the points at the keypoints.
    """

    visual: Any
    geometric: Any
    points: KeypointPoints

    def points_at(self, uv: Float32) -> tuple[Float64, Mask]:
        """Points [M, 3] at keypoints uv [N, 2], metres, and which [N] have one."""
        return self.points.at(uv)
