"""What a replay writes besides its folder of results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rgbd_glue_ros.experiments.replay.sinks import FrameSink


@dataclass(frozen=True)
class FurtherOutputs:
    """Outputs that a run has only if they are asked for.

    Attributes:
        sinks: receive each frame and its estimate, and are finally closed.
        cloud: PLY file for a coloured cloud of the keyframes, which the report also shows; None for
            none.
        files: what the sinks write.
    """

    sinks: Sequence[FrameSink] = ()
    cloud: Path | None = None
    files: tuple[Path, ...] = ()
