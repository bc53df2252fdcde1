"""The node, whose warm-up computes in PyTorch and does not come to an end."""

import sys
from unittest.mock import patch

from rgbd_glue_ros.features.torch_library import F, inference, torch
from rgbd_glue_ros.node import node


def convolve_for_ever(*_: object) -> None:
    image, kernel = torch.ones(1, 16, 256, 256), torch.ones(16, 16, 3, 3)
    with inference(torch.device("cpu")):
        sys.stdout.write("convolving\n")
        sys.stdout.flush()
        while True:
            F.conv2d(image, kernel)


with patch.object(node, "warm_up", convolve_for_ever):
    sys.exit(node.main())
