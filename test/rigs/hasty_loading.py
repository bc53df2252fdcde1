"""The mapping node, which logs the progress of loading a map a hundred times as often."""

import sys
from unittest.mock import patch

from rgbd_glue_ros.node import map_loading

if __name__ == "__main__":
    with patch.object(map_loading, "PROGRESS_S", map_loading.PROGRESS_S / 100):
        from rgbd_glue_ros.node import mapping

        sys.exit(mapping.main())
