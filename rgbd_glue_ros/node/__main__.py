"""``python -m rgbd_glue_ros.node`` runs the odometry node with ROS arguments only."""

import sys

from rgbd_glue_ros.live.end_signals import EndSignals
from rgbd_glue_ros.live.heap import keep_freed_memory

# before the slow imports below, which also start threads
end_signals = EndSignals()
keep_freed_memory()

from rgbd_glue_ros.node.node import main  # noqa: E402

sys.exit(main(end_signals=end_signals))
