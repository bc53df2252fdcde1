"""The mapping node: closes loops on top of the odometry node, and publishes map -> odom.

It subscribes to keyframes and their edges from the odometry node, and to images from the camera.
``odom`` stays smooth; loop closures correct only ``map`` -> ``odom``.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

from rgbd_glue_ros import parameters as cfg
from rgbd_glue_ros.live import topics
from rgbd_glue_ros.live.end_signals import EndSignals
from rgbd_glue_ros.messages.synchronizer import Match
from rgbd_glue_ros.node.base_node import CLOSE_S, BaseNode
from rgbd_glue_ros.node.extrinsics import NodeExtrinsics
from rgbd_glue_ros.node.map_loading import MapLoading, given_map_file
from rgbd_glue_ros.node.map_run import MapRun
from rgbd_glue_ros.node.parameters import NO_CAMERA, declare_parameters, follow_changes
from rgbd_glue_ros.node.rgbd_input import RgbdInput
from rgbd_glue_ros.node.runtime import GiveUp, run_node
from rgbd_glue_ros.node.saving import create_save_service
from rgbd_glue_ros.node.tf import Broadcaster, listen
from rgbd_glue_ros.parameters.inputs import MAP_BY_RECEIPT
from rgbd_glue_ros.slam.live_map import LiveMap

NODE_NAME = "rgbd_mapping"
# All others are fixed: keyframes of a map are comparable only if made with the same parameters.
CHANGEABLE = ("save_map_file",)


class MappingNode(BaseNode):
    """Publishes ``map`` -> ``odom`` and ``map/path``."""

    def __init__(self, give_up: GiveUp, camera: Mapping[str, cfg.Value] = NO_CAMERA) -> None:
        """Declares the parameters, and loads the map; subscribes as soon as that is done.

        Args:
            give_up: called from another thread if the map cannot be loaded, or the libraries of the
                extra slam are not installed.
            camera: as for ``declare_parameters``.

        Raises:
            InputError: a parameter has an invalid value.
        """
        super().__init__(NODE_NAME)
        self._config, config = declare_parameters(self, camera, CHANGEABLE)
        self._config.check_for_mapping()
        transforms = listen(self, self._config)
        self._extrinsics = NodeExtrinsics(self, self._config, transforms)
        does_broadcast = transforms is not None and self._config.publish_tf
        self._broadcaster = Broadcaster(self) if does_broadcast else None
        self._input = RgbdInput(
            self, self._config, transforms, self._receive, with_two_clocks=MAP_BY_RECEIPT
        )
        self._map_run: MapRun | None = None
        follow_changes(self, self._config, config, self._take_parameters, CHANGEABLE)
        given = given_map_file(self._config)
        self._loading = MapLoading(self, given, config, self._begin, give_up)

    def _begin(self, live_map: LiveMap) -> None:
        """Subscribes and publishes."""
        run = self._map_run = MapRun(
            self, self._config, live_map, self._input, self._extrinsics, self._broadcaster
        )
        self._input.subscribe()
        create_save_service(
            self, topics.SAVE_MAP_SERVICE, "map", lambda: run.save(self._config.save_map_file)
        )
        self.get_logger().info(run.description)

    def _receive(self, match: Match[Any], _arrived_ns: int) -> None:
        if self._map_run is not None:
            self._map_run.take_images(match)

    def _finish(self) -> bool:
        """Finishes the current keyframe; a map is not loaded to the end."""
        run = self._map_run
        has_ended = (run is None or run.close(CLOSE_S)) and self._loading.is_over
        if has_ended:
            self._input.close()
            if run is not None:
                run.say_what_is_left()
        return has_ended

    def _take_parameters(self, config: cfg.NodeConfig, _: cfg.Config) -> None:
        self._config = config


def main(
    args: list[str] | None = None,
    end_signals: EndSignals | None = None,
    camera: Mapping[str, cfg.Value] = NO_CAMERA,
) -> int:
    """Runs the node until a signal ends it; arguments and exit code as for the odometry node."""
    return run_node(NODE_NAME, lambda give_up: MappingNode(give_up, camera), args, end_signals)


if __name__ == "__main__":
    sys.exit(main())
