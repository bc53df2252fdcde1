"""``rgbd-glue watch`` as a process whose arguments are those of ROS; a variable names its file."""

import os
import sys

from rgbd_glue_ros.cli.main import main

TO = "RIG_WATCH_TO"

if __name__ == "__main__":
    to = os.environ.get(TO)
    sys.exit(main(["watch", *(["-o", to] if to else []), *sys.argv[1:]]))
