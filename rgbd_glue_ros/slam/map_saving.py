"""Saves a map that grows, and replaces no file of another map without keeping it."""

from __future__ import annotations

from pathlib import Path

from rgbd_glue_ros.files.reading import FileIdentity, file_identity
from rgbd_glue_ros.live.map_summary import SavedState
from rgbd_glue_ros.printable import counted
from rgbd_glue_ros.slam.map_file import SavedMap, write_map


def backup_of(path: Path) -> Path:
    """Where the file of another map is kept when a map is saved in its place."""
    return path.with_name(f"{path.name}.bak")


class MapSaving:
    """Saves one map, again and again; another map has another one of these.

    Attributes:
        state: the last time that it was saved; None if it was not.
    """

    def __init__(self) -> None:
        """Before the map is saved for the first time."""
        self.state: SavedState | None = None
        self._written: dict[Path, FileIdentity | None] = {}

    def save(self, path: Path, saved: SavedMap) -> str:
        """Writes the map, and returns what was done in a line.

        A file that holds an earlier state of this map is replaced. Any other is kept, one at most:
        it may be of another session, of another node, or of the map before a reset.

        Args:
            path: of the file.
            saved: the present state of the map.

        Raises:
            InputError: the file cannot be written.
        """
        is_other = path.is_file() and self._written.get(path) != file_identity(path)
        backup = backup_of(path) if is_other else None
        write_map(path, saved, backup)
        self._written[path] = file_identity(path)
        self.state = SavedState(str(path), len(saved))
        text = f"{path}: {counted(len(saved), 'keyframe')}"
        if backup is not None:
            text += f"; the file that was there, of another map, is kept as {backup}"
        return text
