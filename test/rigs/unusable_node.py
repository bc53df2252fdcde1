"""The node, on a machine where no frame could be processed."""

import sys
from unittest.mock import patch

from rgbd_glue_ros.node import node

with patch.object(node, "warm_up", side_effect=RuntimeError("as where a library is damaged")):
    sys.exit(node.main())
