"""A camera driver as a process of its own, to be killed: publishes the corner of a room for ever.

Arguments: ROS domain, RELIABLE or BEST_EFFORT.
"""

from __future__ import annotations

import sys
import time

from rclpy.qos import ReliabilityPolicy

from rigs.ros import Rig, corner_frame


def main(domain: int, reliability: ReliabilityPolicy) -> None:
    with Rig(domain, reliability=reliability) as rig:
        while True:
            rig.publish(corner_frame(time.time_ns()))
            rig.spin_for(1 / 15)


if __name__ == "__main__":
    main(int(sys.argv[1]), ReliabilityPolicy[sys.argv[2]])
