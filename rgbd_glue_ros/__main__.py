"""``python -m rgbd_glue_ros`` is ``rgbd-glue``."""

import sys

from rgbd_glue_ros.cli.main import main

sys.exit(main())
