"""The mapping node, which looks at its input every second."""

import sys
from unittest.mock import patch

from rgbd_glue_ros.node import input_watch

# before the modules that take the constant from there
with patch.object(input_watch, "LOOK_S", 1.0):
    from rgbd_glue_ros.node import mapping

    sys.exit(mapping.main())
