"""Records poses as they come, without knowing whether there will be any."""

from __future__ import annotations

from pathlib import Path

from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.files.writing import not_written
from rgbd_glue_ros.trajectories.tum import TumWriter
from rgbd_glue_ros.types import Float64


class PoseRecorder(Closing):
    """Writes a new TUM file pose by pose; without any, there is no file in the end.

    Attributes:
        path: of the file.
        count: number of recorded poses.
    """

    def __init__(self, path: Path) -> None:
        """Creates the file, and its folder.

        Raises:
            InputError: it exists, or cannot be written.
        """
        self.path = path
        self.count = 0
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise not_written(path, error) from error
        self._writer = TumWriter(path, must_be_new=True)

    def append(self, stamp_ns: int, T_world_body: Float64) -> None:
        """Adds one pose [4, 4]; raises InputError if it cannot be written."""
        self._writer.append(stamp_ns, T_world_body)
        self.count += 1

    def begin_anew(self) -> None:
        """Notes that the following poses are in another frame than those before."""
        if self.count:
            self._writer.note("the odometry began anew: what follows is in a new frame")

    def close(self) -> None:
        """Closes the file, and removes it if it has no pose."""
        self._writer.close()
        if not self.count:
            self.path.unlink(missing_ok=True)
