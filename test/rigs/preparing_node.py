"""The node, on a machine where compiling takes forever."""

import sys
import threading
from unittest.mock import patch

from rgbd_glue_ros.node import node

with patch.object(node, "warm_up", side_effect=lambda *_: threading.Event().wait()):
    sys.exit(node.main())
