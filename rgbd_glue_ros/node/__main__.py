"""``python -m rgbd_glue_ros.node`` is the executable ``odometry``."""

from rgbd_glue_ros.node.node import main

main()
