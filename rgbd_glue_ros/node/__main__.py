"""``python -m rgbd_glue_ros.node`` runs the node by ROS arguments alone."""

import sys

from rgbd_glue_ros.node.node import main

sys.exit(main())
