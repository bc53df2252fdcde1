"""What a peer is."""

from __future__ import annotations

from typing import Any, Protocol

from rgbd_glue_ros.types import Float64, View


class NoTransformError(RuntimeError):
    """The peer found no transform; says why."""


class Peer(Protocol):
    """A way to register two frames: ``prepare`` does what concerns one frame alone."""

    def prepare(self, view: View) -> Any:
        """What ``register`` needs of a frame; may be kept for several registrations.

        Raises:
            NoTransformError: nothing can be registered to this frame.
        """

    def register(self, source: Any, target: Any) -> Float64:
        """T_target_source, float64 [4, 4], of two prepared frames.

        Raises:
            NoTransformError: there is none.
        """
