"""Whether the machine keeps up with the camera."""

from __future__ import annotations

from dataclasses import dataclass

from rgbd_glue_ros.types import TrackingState


@dataclass(frozen=True)
class Load:
    """How many frames this machine keeps up with.

    A search for a lost camera is left out of both: a frame of it takes several times as long.

    Attributes:
        processed: frames with an estimate.
        left_out: frames that a newer one replaced while those were processed.
    """

    processed: int = 0
    left_out: int = 0


class LoadCount:
    """Counts the load; not thread-safe."""

    def __init__(self) -> None:
        """Begins before the first frame."""
        self._state = TrackingState.INITIALIZING
        self._counted = Load()
        self._left_out = 0

    def left_out(self) -> None:
        """Takes a frame that a newer one replaced."""
        self._left_out += 1

    def processed(self, state: TrackingState) -> None:
        """Takes a frame with an estimate, and the state after it."""
        if TrackingState.LOST not in (self._state, state):
            self._counted = self._with_left_out(self._counted.processed + 1)
        self._state, self._left_out = state, 0

    @property
    def load(self) -> Load:
        """The load so far."""
        if self._state is not TrackingState.INITIALIZING:
            return self._counted
        # the first frame may take for ever
        return self._with_left_out(self._counted.processed)

    def _with_left_out(self, processed: int) -> Load:
        return Load(processed, self._counted.left_out + self._left_out)
