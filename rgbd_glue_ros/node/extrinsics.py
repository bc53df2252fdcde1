"""The camera's pose on the robot, from parameters or TF; it is never assumed."""

from __future__ import annotations

import time

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.live.camera_frame import explain_moved_camera
from rgbd_glue_ros.live.extrinsics import Extrinsics, parse_extrinsics, robot_extrinsics
from rgbd_glue_ros.messages.poses import pose_parameter
from rgbd_glue_ros.node.base_node import BaseNode
from rgbd_glue_ros.node.tf import Transforms
from rgbd_glue_ros.parameters import NodeConfig
from rgbd_glue_ros.types import Float64

# Period of the checks whether the camera has moved on the robot, according to TF.
MOUNT_LOOK_S = 1.0


class NodeExtrinsics:
    """The extrinsics between the camera and the published frames, once they are known."""

    def __init__(self, node: BaseNode, config: NodeConfig, transforms: Transforms | None) -> None:
        """Reads the parameters.

        Raises:
            InputError: a parameter cannot be read, or TF is needed and not available.
        """
        self._node = node
        self._config = config
        self._transforms = transforms
        self._at_origin = self._given()
        self._looked_up: Float64 | None = None
        self._looked_s = 0.0
        self._T_odom_start = pose_parameter("initial_pose", config.initial_pose)
        self._level: Extrinsics | None = None

    def _given(self) -> Extrinsics | None:
        """The extrinsics from the parameters; None if they must come from TF."""
        config = self._config
        if config.frame_id and not config.camera_pose and self._transforms is not None:
            return None
        return parse_extrinsics(
            config.frame_id, config.camera_pose, config.camera_axes, planar=config.planar
        )

    def start_at(self, T_odom_start: Float64 | None) -> None:
        """Sets the start pose [4, 4] in odom; None for the origin."""
        self._T_odom_start = T_odom_start
        self._level = None

    def level(self, up: Float64 | None) -> Extrinsics | None:
        """Levels odom until the next start, if the parameters ask for it.

        Args:
            up: the upward direction in the first optical frame, a unit vector [3]; None if it is
                unknown.

        Returns:
            The extrinsics; None if they are not known yet.
        """
        config = self._config
        is_optical = not config.frame_id and config.camera_axes == "optical"
        is_wanted = config.align_with_gravity and not (config.planar or is_optical)
        if is_wanted and up is not None and self._at_origin is not None:
            self._level = self._at_origin.levelled(up)
            self._node.get_logger().info(f"Gravity: odom is level. {self.description}")
        return self.known

    @property
    def known(self) -> Extrinsics | None:
        """The extrinsics; None if they are not known yet."""
        extrinsics = self._level or self._at_origin
        if extrinsics is None or self._T_odom_start is None:
            return extrinsics
        return extrinsics.starting_at(self._T_odom_start)

    def of(self, camera_frame: str) -> Extrinsics | None:
        """The extrinsics of a camera, looked up if necessary; None if they are not known yet.

        Args:
            camera_frame: the optical frame of the camera.
        """
        if self._at_origin is None:
            T_robot_camera = self._lookup_camera(camera_frame)
            if T_robot_camera is not None:
                self._looked_up, self._looked_s = T_robot_camera, time.monotonic()
                self._at_origin = robot_extrinsics(T_robot_camera, planar=self._config.planar)
                self._node.get_logger().info(f"TF: found {camera_frame}. {self.description}")
        elif self._looked_up is not None and time.monotonic() - self._looked_s > MOUNT_LOOK_S:
            self._watch_mount(self._looked_up, camera_frame)
        return self.known

    def forget(self) -> None:
        """Forgets the camera's pose, so that it is looked up again, as for another camera."""
        self._at_origin, self._looked_up, self._level = self._given(), None, None

    def _watch_mount(self, T_robot_camera: Float64, camera_frame: str) -> None:
        """Warns once if, according to TF, the camera has moved on the robot since the look-up."""
        self._looked_s = time.monotonic()
        if self._transforms is None:
            return
        T_now = self._transforms.lookup(self._config.frame_id, camera_frame, None, 0.0)
        moved = None if T_now is None else explain_moved_camera(T_robot_camera, T_now)
        self._node.warn_once(camera_frame, moved)

    def _lookup_camera(self, camera_frame: str) -> Float64 | None:
        """The camera's pose [4, 4] on the robot; None if it is not known yet."""
        if self._transforms is None:
            return None
        wait_s = self._config.wait_for_transform
        robot_frame = self._config.frame_id
        found = self._transforms.lookup(robot_frame, camera_frame, None, wait_s)
        what = f"from {camera_frame or 'images without a frame'} to {robot_frame}"
        if found is None:
            remedy = (
                "make sure that robot_state_publisher or static_transform_publisher runs, or set "
                "camera_pose"
            )
            self._node.report(InputError("TF", f"no transform {what} within {wait_s} s", remedy))
        return found

    @property
    def description(self) -> str:
        """Where the camera is at the start and where it looks, for the user to check."""
        extrinsics, odom = self.known, self._config.odom_frame_id
        if extrinsics is None:
            return f"The camera's pose in {self._config.frame_id} will come from TF"
        x, y, z = extrinsics.T_fixed_odom[:3, 3]
        ahead, up = extrinsics.T_fixed_odom[:3, 2], -extrinsics.T_fixed_odom[:3, 1]
        return (
            f"At the start the camera is at ({x:.3f} {y:.3f} {z:.3f}) in {odom}, looks along "
            f"({_vector(ahead)}), and the top of its image points to ({_vector(up)})"
        )


def _vector(v: Float64) -> str:
    return " ".join(f"{x + 0.0:.2f}" for x in v)
