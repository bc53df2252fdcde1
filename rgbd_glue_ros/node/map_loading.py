"""Loads the map that the mapping node starts with, on a thread of its own.

Of a large map that takes minutes, and a signal has to end the node meanwhile.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Callable
from pathlib import Path

from rclpy.exceptions import InvalidHandle

from rgbd_glue_ros import parameters as cfg
from rgbd_glue_ros.errors import InputError, MissingExtraError
from rgbd_glue_ros.files.user_paths import expanded
from rgbd_glue_ros.node.base_node import BaseNode
from rgbd_glue_ros.node.runtime import GiveUp
from rgbd_glue_ros.slam.live_map import LiveMap
from rgbd_glue_ros.slam.map_file import read_map

logger = logging.getLogger(__name__)

# Time between two lines about the progress.
PROGRESS_S = 2.0


class MapLoading:
    """Creates the map, and passes it to the node."""

    def __init__(
        self,
        node: BaseNode,
        path: Path | None,
        config: cfg.Config,
        loaded: Callable[[LiveMap], None],
        give_up: GiveUp,
    ) -> None:
        """Starts the thread.

        Args:
            node: runs ``loaded``, and provides the log.
            path: file of the map; None starts with an empty one.
            config: how keyframes are compared.
            loaded: called with the map, as a callback of the node.
            give_up: called from the thread if there is no map.
        """
        self._node = node
        self._path = path
        self._config = config
        self._give_up = give_up
        self._map: LiveMap | None = None

        def pass_on() -> None:
            if self._map is not None:
                loaded(self._map)

        self._is_loaded = node.create_guard_condition(pass_on)
        # a daemon, so that the process ends while it runs
        self._thread = threading.Thread(target=self._run, name="map-loading", daemon=True)
        self._thread.start()

    @property
    def is_over(self) -> bool:
        """Whether the thread has ended."""
        return not self._thread.is_alive()

    def _run(self) -> None:
        try:
            self._map = self._load()
        except (InputError, MissingExtraError) as fault:
            self._give_up(fault)
        except Exception:
            logger.exception("The map could not be loaded: the node ends")
            self._give_up()
        else:
            with contextlib.suppress(InvalidHandle):  # the node has ended meanwhile
                self._is_loaded.trigger()

    def _load(self) -> LiveMap:
        if self._path is None:
            return LiveMap(self._config)
        saved = read_map(self._path, _Progress(self._node, f"{self._path}: read"))
        extracted = _Progress(self._node, f"{self._path}: features extracted of")
        return LiveMap(self._config, saved, extracted)


class _Progress:
    """Logs how many keyframes are done, from time to time."""

    def __init__(self, node: BaseNode, what: str) -> None:
        self._node = node
        self._what = what
        self._said_s = time.monotonic()

    def __call__(self, done: int, total: int) -> None:
        now_s = time.monotonic()
        if now_s - self._said_s > PROGRESS_S:
            self._said_s = now_s
            self._node.get_logger().info(f"{self._what} {done} of {total} keyframes")


def given_map_file(config: cfg.NodeConfig) -> Path | None:
    """The map in ``map_file``, to start with; None if no file is given.

    Raises:
        InputError: its folder has no name, or ``localize_only`` is set without a map.
    """
    if config.map_file:
        return expanded(config.map_file, "map_file")
    if config.localize_only:
        raise InputError("localize_only", "there is no map", "set map_file")
    return None
