"""How the recordings of a run are opened."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Protocol

from rgbd_glue_ros.parameters import InputConfig
from rgbd_glue_ros.recordings import Calibration, Recording, Topics, open_recording


class Opener(Protocol):
    """Opens recordings, and says how; with workers it must be serialisable."""

    @property
    def inputs(self) -> InputConfig:
        """How images are interpreted and paired."""

    def __call__(self, path: Path, /) -> Recording:
        """A recording.

        Raises:
            InputError: it cannot be opened.
        """

    def as_json(self) -> Mapping[str, Any]:
        """Everything that an opened recording depends on besides its path, for a journal."""


@dataclass(frozen=True)
class Opening:
    """What a user specifies about all recordings of a run; an ``Opener``.

    Attributes:
        topics: of a bag; those that are None are detected.
        calibration: of the colour images; None uses the recording's.
        depth_calibration: of the depth images, if they are not registered to colour.
        inputs: how images are interpreted and paired.
    """

    topics: Topics = field(default_factory=Topics)
    calibration: Calibration | None = None
    depth_calibration: Calibration | None = None
    inputs: InputConfig = field(default_factory=InputConfig)

    def __call__(self, path: Path, /) -> Recording:
        """A recording, opened in this way.

        Raises:
            InputError: the path does not exist, has no known format, or is unusable.
        """
        return open_recording(
            path, self.topics, self.calibration, self.inputs, self.depth_calibration
        )

    def as_json(self) -> Mapping[str, Any]:
        """What is specified; calibrations by their content."""
        content: dict[str, Any] = json.loads(
            json.dumps(asdict(self), default=lambda member: member.value)
        )
        for calibration in (content["calibration"], content["depth_calibration"]):
            if calibration is not None:
                del calibration["source"]
        return content
