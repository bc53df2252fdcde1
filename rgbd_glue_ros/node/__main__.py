"""``python -m rgbd_glue_ros.node`` is the executable ``odometry``."""

import sys

from rgbd_glue_ros.node.node import main

sys.exit(main())
