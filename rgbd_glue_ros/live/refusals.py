"""Why frames that arrive are not processed."""

from __future__ import annotations

from rgbd_glue_ros.live.frame_counts import Drop
from rgbd_glue_ros.types import NANOSECONDS

# Reasons that the user has asked for.
_WISHED = {Drop.PAUSED, Drop.TOO_SOON}
# Seconds without an estimate after which the last drop is reported as the node's fault.
_NO_ESTIMATE_S = 2.0


class Refusals:
    """What became of the frames since the last one that was processed; not thread-safe."""

    def __init__(self, now_ns: int) -> None:
        """Begins, by a monotonic clock, before the first frame."""
        self._last_estimate_ns = now_ns
        self._refused = ""
        self._is_unplaced = False

    def processed(self, now_ns: int) -> None:
        """Takes a frame with an estimate."""
        self._refused, self._is_unplaced = "", False
        self._last_estimate_ns = now_ns

    def dropped(self, reason: Drop, error: str) -> None:
        """Takes a frame without an estimate, and the error that caused this; "" if none did."""
        # while the camera's pose is awaited, frames are left out because of this wait
        is_effect = reason is Drop.SUPERSEDED and self._is_unplaced
        self._is_unplaced = is_effect or reason is Drop.UNPLACED
        if reason not in _WISHED and not is_effect:
            self._refused = f"{reason.value}: {error}" if error else reason.value

    def why(self, now_ns: int) -> str:
        """Why arriving frames are not processed; "" while they are."""
        # not since the last pose: a lost camera has none, although its frames are processed
        seconds = (now_ns - self._last_estimate_ns) / NANOSECONDS
        if not self._refused or seconds < _NO_ESTIMATE_S:
            return ""
        return f"no frame was processed for {seconds:.0f} s, because {self._refused}"
