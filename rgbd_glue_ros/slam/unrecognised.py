"""What is said while no place of a given map is recognised."""

from __future__ import annotations

from rgbd_glue_ros.printable import counted

FIRST_SAID = 10
"""Keyframes compared in vain until that is said; then again after ten times as many."""


class Unrecognised:
    """Counts keyframes that were compared with a given map in vain."""

    def __init__(self) -> None:
        """Before the first."""
        self.recognised()

    def recognised(self) -> None:
        """Begins anew: a place was recognised, or another session has begun."""
        self._compared = 0
        self._said_at = FIRST_SAID

    def add(self, map_name: str, keyframes: int) -> str | None:
        """Counts a keyframe; a line if that is to be said now.

        Args:
            map_name: what the map is called: its file.
            keyframes: in the map.
        """
        self._compared += 1
        if self._compared < self._said_at:
            return None
        self._said_at *= 10
        return (
            f"{self._compared} keyframes were compared with the {counted(keyframes, 'keyframe')} "
            f"of {map_name}, and none shows a place of it, so map -> odom is unknown: check that "
            "it is the map of this room, and show the camera a place of it, from where and in "
            "what light it was mapped"
        )
