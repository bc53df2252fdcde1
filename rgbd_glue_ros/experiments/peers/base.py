"""The interface of a peer."""

from __future__ import annotations

from typing import Any, Protocol

from rgbd_glue_ros.types import Float64, View


class NoTransformError(RuntimeError):
    """The peer found no transform; the message says why."""


class Peer(Protocol):
    """A registration method for two frames: ``prepare`` does the work for a single frame."""

    def prepare(self, view: View) -> Any:
        """The input of ``register`` for a frame; can be reused for several registrations.

        Raises:
            NoTransformError: nothing can be registered to this frame.
        """

    def register(self, source: Any, target: Any) -> Float64:
        """T_target_source, float64 [4, 4], of two prepared frames.

        Raises:
            NoTransformError: there is none.
        """
