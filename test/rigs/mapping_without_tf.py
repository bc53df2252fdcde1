"""The mapping node, on a machine that has neither tf2_ros nor tf2_msgs."""

import sys
from unittest.mock import patch

with patch.dict(sys.modules, {"tf2_ros": None, "tf2_msgs": None, "tf2_msgs.msg": None}):
    from rgbd_glue_ros.node import mapping

    sys.exit(mapping.main())
