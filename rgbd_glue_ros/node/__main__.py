"""``python -m rgbd_glue_ros.node`` runs the node by ROS arguments alone."""

import sys

from rgbd_glue_ros.live.end_signals import EndSignals

end_signals = EndSignals()  # before what takes long to load

from rgbd_glue_ros.node.node import main  # noqa: E402

sys.exit(main(end_signals=end_signals))
