"""Opens recordings that exist in memory."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rgbd_glue_ros.parameters import InputConfig
from rgbd_glue_ros.recordings import Recording


class OpenerByName:
    """Opens the recording with the last name of a path.

    Attributes:
        inputs: the defaults.
    """

    def __init__(self, **recordings: Recording) -> None:
        """Takes the recordings by their names."""
        self.inputs = InputConfig()
        self._recordings = recordings

    def __call__(self, path: Path, /) -> Recording:
        """The recording of that name."""
        return self._recordings[path.name]

    def as_json(self) -> dict[str, Any]:
        """Nothing is specified."""
        return {}
