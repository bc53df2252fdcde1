"""The node, where neither matches nor the viewer can be drawn."""

import sys
from unittest.mock import patch

from rgbd_glue_ros.node import node, outputs
from rgbd_glue_ros.node.viewer import NodeViewer


def refuse(*_: object, **__: object) -> None:
    raise ZeroDivisionError(REFUSAL)


REFUSAL = "no picture"

if __name__ == "__main__":
    with patch.object(outputs, "match_image", refuse), patch.object(NodeViewer, "show", refuse):
        sys.exit(node.main())
