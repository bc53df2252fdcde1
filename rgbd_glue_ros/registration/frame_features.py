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
class _OfView:
    """What is known of a frame whose images are there.

    Attributes:
        view: the frame as the features see it.
    """

    view: View

    def points_at(self, uv: Float32) -> tuple[Float64, Mask]:
        """Points [M, 3] at pixels uv [N, 2], metres, and which pixels [N] have one."""
        return keypoints_to_points(uv, self.view)


@dataclass(frozen=True)
class FrameFeatures(_OfView):
    """A frame and what was extracted from it; ``Described``.

    Attributes:
        view: the frame as the features saw it.
        visual: features of the configured visual kind.
        geometric: features of the configured geometric kind.
        stages_ms: wall time of each extraction, milliseconds.
    """

    visual: Any
    geometric: Any
    stages_ms: dict[str, float]


@dataclass(frozen=True)
class FeaturesInProgress(_OfView):
    """A frame whose geometric features may still be extracted; ``Described``.

    Attributes:
        view: the frame as the features see it.
        timed_visual: features of the configured visual kind, and the milliseconds they took.
        timed_geometric: gives those of the configured geometric kind, and their milliseconds.
    """

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

    def complete(self) -> FrameFeatures:
        """All features; waits for them."""
        (visual, visual_ms), (geometric, geometric_ms) = self.timed_visual, self.timed_geometric()
        times = {stages.VISUAL_FEATURES: visual_ms, stages.GEOMETRIC_FEATURES: geometric_ms}
        return FrameFeatures(self.view, visual, geometric, times)


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
