"""The parameters that the ROS node alone has."""

from __future__ import annotations

from dataclasses import dataclass

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.parameters.checks import FRAME, POSE, or_nothing
from rgbd_glue_ros.parameters.inputs import RECEIPT, InputConfig, read_once
from rgbd_glue_ros.parameters.parameter import parameter


@dataclass(frozen=True)
class NodeConfig(InputConfig):
    """What the ROS node alone has: frames, topics, transport."""

    preset: str = read_once(
        "live", "Preset that the other parameters start from.", choices=("live", "paper")
    )
    frame_id: str = read_once(
        "",
        "Robot frame whose pose is published, as base_link; empty for the camera's optical frame.",
        check=or_nothing(FRAME),
    )
    odom_frame_id: str = read_once("odom", "Fixed frame that poses are given in.", check=FRAME)
    camera_pose: str = read_once(
        "",
        "Pose of the camera in frame_id. Empty, it is looked up on TF once it is there.",
        check=or_nothing(POSE),
    )
    camera_axes: str = read_once(
        "body",
        "Axes of the camera that camera_pose is given for: body has x forward, y left, z up (the "
        "camera_link of most drivers), optical has x right, y down, z forward. Without frame_id, "
        "odom starts with these axes at the camera.",
        choices=("body", "optical"),
    )
    align_with_gravity: bool = read_once(
        True,
        "Whether odom starts level where an IMU tells which way is up: its z axis points there, "
        "and roll and pitch are true ones. Not with planar, or with camera_axes optical and no "
        "frame_id. initial_pose is then in the level frame.",
    )
    planar: bool = read_once(
        False,
        "Whether frame_id keeps to the plane that it starts on, as a robot on wheels does: x, y "
        "and yaw alone are published, and nothing of the height and tilt that drift.",
    )
    publish_tf: bool = read_once(
        True,
        "Whether odom_frame_id -> frame_id is broadcast on /tf. Without frame_id nothing is: the "
        "optical frame has its parent from the driver.",
    )
    wait_for_transform: float = read_once(
        0.1, "How long a frame waits for a transform on TF.", unit="s", minimum=0.0, maximum=10.0
    )
    guess_frame_id: str = read_once(
        "",
        "Fixed frame of another odometry, as of wheels: the motion guess_frame_id -> frame_id on "
        "TF between two frames is where the search starts. What is broadcast is then "
        "odom_frame_id -> guess_frame_id, since frame_id has its parent. Empty for none.",
        check=or_nothing(FRAME),
    )
    image_transport: str = read_once(
        "raw", "Transport of the colour image.", choices=("raw", "compressed")
    )
    depth_transport: str = read_once(
        "raw", "Transport of the depth image.", choices=("raw", "compressedDepth")
    )
    depth_info_topic: str = read_once(
        "",
        "Topic of the depth camera's info, for depth that is not registered. Empty for "
        "depth/camera_info if that is remapped, and else for camera_info beside the depth images.",
    )
    qos: int = read_once(
        0,
        "Reliability of the image subscriptions: 0 as the publisher offers, 1 reliable, 2 best "
        "effort.",
        minimum=0,
        maximum=2,
    )
    qos_camera_info: int = read_once(
        0,
        "Reliability of the subscription to camera info, as qos for images.",
        minimum=0,
        maximum=2,
    )
    topic_queue_size: int = read_once(
        10, "Messages of a topic that wait for the node, at most.", minimum=1, maximum=1000
    )
    sync_queue_size: int = read_once(
        10, "Messages of a topic that wait for their partners, at most.", minimum=1, maximum=1000
    )
    always_process_most_recent_frame: bool = read_once(
        True,
        "Whether a frame that waits gives way to a newer one. Without it frames queue "
        "(sync_queue_size), and when the queue is full the subscriptions wait: nothing is dropped "
        "as long as topic_queue_size holds what comes meanwhile.",
    )
    max_update_rate: float = parameter(
        0.0,
        "Frames that come faster than this are left out; 0 takes all.",
        unit="Hz",
        minimum=0.0,
        maximum=1000.0,
    )
    publish_null_when_lost: bool = parameter(
        False,
        "Whether odom gets a message for a frame without a pose too: position, orientation "
        "quaternion and twist all zero, covariances 9999 on their diagonals, as rtabmap_odom does. "
        "Without it nothing is published for such a frame.",
    )
    path_poses: int = read_once(
        1000,
        "Poses that path holds, at most; the oldest go. One is kept every path_period.",
        minimum=1,
        maximum=100000,
    )
    path_period: float = parameter(
        0.5,
        "Time between poses of path, and between its messages, at least.",
        unit="s",
        minimum=0.0,
        maximum=1e6,
    )
    graph_file: str = parameter(
        "~/.ros/keyframes.g2o",
        "File that ~/save_graph writes for g2o. That for GTSAM is beside it, with _gtsam in its "
        "name.",
    )
    rerun: str = read_once(
        "",
        "File that all the node sees is written to for the Rerun viewer, or address of a viewer "
        "that runs, as rerun+http://127.0.0.1:9876/proxy; empty for none. Needs the extra viz.",
    )
    map_frame_id: str = read_once(
        "map", "Frame of the map, which the mapping node publishes.", check=FRAME
    )
    map_file: str = read_once(
        "",
        "Map that the mapping node begins with, as rgbd-glue map --save-map or ~/save_map wrote "
        "it; empty begins one. map_frame_id -> odom_frame_id is published once a place is "
        "recognised.",
    )
    localize_only: bool = read_once(
        False,
        "Whether the mapping node leaves the map of map_file as it is, and only finds "
        "odom_frame_id in it.",
    )
    save_map_file: str = parameter(
        "~/.ros/map.rgbdmap", "File that ~/save_map of the mapping node writes."
    )
    initial_pose: str = parameter(
        "",
        "Pose in odom_frame_id that the odometry starts at, and from the next reset on starts anew "
        "at; empty for the origin.",
        check=or_nothing(POSE),
    )

    def __post_init__(self) -> None:
        """Refuses a frame that would be its own parent.

        Raises:
            InputError: two of the frames have one name.
        """
        self._check_distinct("odom_frame_id", "frame_id", "guess_frame_id")

    def check_for_mapping(self) -> None:
        """Refuses what the mapping node cannot go by; the odometry alone can.

        Raises:
            InputError: the map's frame has the name of another, since none is its own parent; or
                stamps are those of receipt, by which no keyframe would find its image: each process
                receives an image at a time of its own.
        """
        self._check_distinct("odom_frame_id", "frame_id", "guess_frame_id", "map_frame_id")
        if self.stamps == RECEIPT:
            raise InputError(
                "stamps",
                "receipt gives an image another stamp in each process, so that the mapping node "
                "would find none of the odometry's keyframes",
                "have the driver stamp its images by one clock and set stamps to header, or record "
                "them and map the recording (rgbd-glue map RECORDING --set stamps=receipt)",
            )

    def _check_distinct(self, *frames: str) -> None:
        names: dict[str, str] = {}
        for parameter_name in frames:
            name = getattr(self, parameter_name)
            same = next((other for other, value in names.items() if value == name), None)
            if name and same:
                raise InputError(
                    parameter_name,
                    f"is {name!r}, as {same} is, and a frame is not its own parent",
                    "give each its own name, as map, odom and base_link",
                )
            names[parameter_name] = name
