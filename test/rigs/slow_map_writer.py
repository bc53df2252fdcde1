"""The mapping node, whose maps are written once somebody opens the named pipe SLOW_MAP_WRITER."""

import os
import sys
from pathlib import Path
from unittest.mock import patch

from rgbd_glue_ros.node import mapping
from rgbd_glue_ros.slam import map_saving
from rgbd_glue_ros.slam.map_file import SavedMap, write_map

PIPE = "SLOW_MAP_WRITER"


def write_later(path: Path, saved: SavedMap, backup: Path | None) -> None:
    sys.stdout.write("writing the map\n")
    sys.stdout.flush()
    Path(os.environ[PIPE]).read_bytes()
    write_map(path, saved, backup)


if __name__ == "__main__":
    with patch.object(map_saving, "write_map", write_later):
        sys.exit(mapping.main())
