"""The parameters that only the ROS node has."""

from __future__ import annotations

from dataclasses import dataclass

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.parameters.checks import FRAME, POSE, or_nothing
from rgbd_glue_ros.parameters.inputs import MAP_BY_RECEIPT, RECEIPT, InputConfig, read_once
from rgbd_glue_ros.parameters.parameter import parameter


@dataclass(frozen=True)
class NodeConfig(InputConfig):
    """Parameters that only the ROS node has: frames, topics, transport."""

    preset: str = read_once(
        "live", "Preset that the other parameters start from.", choices=("live", "paper")
    )
    frame_id: str = read_once(
        "",
        "Robot frame whose pose is published, such as base_link; empty for the camera's optical "
        "frame.",
        check=or_nothing(FRAME),
    )
    odom_frame_id: str = read_once("odom", "Fixed frame that poses are given in.", check=FRAME)
    camera_pose: str = read_once(
        "",
        "Pose of the camera in frame_id. If empty, it is looked up on TF once available.",
        check=or_nothing(POSE),
    )
    camera_axes: str = read_once(
        "body",
        "Camera axes that camera_pose refers to: body has x forward, y left, z up (the camera_link "
        "of most drivers), optical has x right, y down, z forward. Without frame_id, odom starts "
        "with these axes at the camera.",
        choices=("body", "optical"),
    )
    align_with_gravity: bool = read_once(
        True,
        "Whether odom starts level if an IMU measures which way is up: its z axis points up, and "
        "roll and pitch are true. Not with planar, or with camera_axes optical and no frame_id. "
        "initial_pose is then in the level frame.",
    )
    planar: bool = read_once(
        False,
        "Whether frame_id stays in the plane that it starts in, as a wheeled robot does: only x, y "
        "and yaw are published, without drift of height and tilt.",
    )
    publish_tf: bool = read_once(
        True,
        "Whether odom_frame_id -> frame_id is broadcast on /tf, and by the mapping node "
        "map_frame_id -> odom_frame_id; false where another program broadcasts odom_frame_id, "
        "whose origin is another. Without frame_id the odometry broadcasts nothing: the driver "
        "gives the optical frame its parent.",
    )
    wait_for_transform: float = read_once(
        0.1,
        "How long a frame waits for a transform on TF. After three frames in a row that waited in "
        "vain for guess_frame_id, none waits for it until it comes again.",
        unit="s",
        minimum=0.0,
        maximum=10.0,
    )
    guess_frame_id: str = read_once(
        "",
        "Fixed frame of another odometry, such as that of wheels: the search starts from the "
        "motion guess_frame_id -> frame_id on TF between two frames. What is broadcast is then "
        "odom_frame_id -> guess_frame_id, since frame_id has its parent. Empty for none.",
        check=or_nothing(FRAME),
    )
    image_transport: str = read_once(
        "raw", "Transport of the colour image.", choices=("raw", "compressed")
    )
    depth_transport: str = read_once(
        "raw",
        "Transport of the depth image: compressed is a PNG of 16 bits.",
        choices=("raw", "compressedDepth", "compressed"),
    )
    depth_info_topic: str = read_once(
        "",
        "Topic of the depth camera's info, for depth that is not registered. Empty for "
        "depth/camera_info if that is remapped, otherwise for camera_info beside the depth images.",
    )
    qos: int = read_once(
        0,
        "Reliability of the image subscriptions: 0 as the publisher offers, 1 reliable, 2 best "
        "effort.",
        minimum=0,
        maximum=2,
    )
    qos_camera_info: int = read_once(0, "As qos, for the camera info.", minimum=0, maximum=2)
    topic_queue_size: int = read_once(
        10, "Messages of a topic that wait for the node, at most.", minimum=1, maximum=1000
    )
    sync_queue_size: int = read_once(
        10, "Messages of a topic that wait for their partners, at most.", minimum=1, maximum=1000
    )
    always_process_most_recent_frame: bool = read_once(
        True,
        "Whether a waiting frame is replaced by a newer one. If false, frames queue "
        "(sync_queue_size), and when the queue is full the subscriptions wait: nothing is dropped "
        "as long as topic_queue_size holds what arrives meanwhile.",
    )
    max_update_rate: float = parameter(
        0.0,
        "Frames that arrive faster than this are skipped; 0 takes all.",
        unit="Hz",
        minimum=0.0,
        maximum=1000.0,
    )
    publish_null_when_lost: bool = parameter(
        False,
        "Whether odom also gets a message for a frame without a pose: position, orientation "
        "quaternion and twist all zero, covariances 9999 on their diagonals, as in rtabmap_odom. "
        "If false, nothing is published for such a frame.",
    )
    path_poses: int = read_once(
        1000,
        "Poses in path, at most; the oldest are dropped. One is kept every path_period.",
        minimum=1,
        maximum=100000,
    )
    path_period: float = parameter(
        0.5,
        "Minimum time between poses of path, and between its messages.",
        unit="s",
        minimum=0.0,
        maximum=1e6,
    )
    graph_file: str = parameter(
        "~/.ros/keyframes.g2o",
        "File that ~/save_graph writes for g2o. The file for GTSAM is beside it, with _gtsam in "
        "its name. The default has the node's namespace in its name.",
    )
    rerun: str = read_once(
        "",
        "File for the Rerun viewer, to which all that the node sees is written, or address of a "
        "running viewer, such as rerun+http://127.0.0.1:9876/proxy; empty for none. Needs the "
        "extra viz.",
    )
    map_frame_id: str = read_once(
        "map", "Frame of the map, which the mapping node publishes.", check=FRAME
    )
    map_file: str = read_once(
        "",
        "Map that the mapping node starts with, written by rgbd-glue map --save-map or ~/save_map; "
        "empty starts a new one. map_frame_id -> odom_frame_id is published once a place is "
        "recognised.",
    )
    localize_only: bool = read_once(
        False,
        "Whether the mapping node leaves the map of map_file unchanged, and only localises "
        "odom_frame_id in it.",
    )
    save_map_file: str = parameter(
        "~/.ros/map.rgbdmap",
        "File that ~/save_map of the mapping node writes. The default has the node's namespace in "
        "its name.",
    )
    initial_pose: str = parameter(
        "",
        "Pose in odom_frame_id that the odometry starts at, and restarts at from the next reset "
        "on; empty for the origin.",
        check=or_nothing(POSE),
    )

    def __post_init__(self) -> None:
        """Refuses a frame that would be its own parent.

        Raises:
            InputError: two of the frames have the same name.
        """
        self._check_distinct("odom_frame_id", "frame_id", "guess_frame_id")

    def check_for_mapping(self) -> None:
        """Refuses what the mapping node cannot use; the odometry alone can.

        Raises:
            InputError: the map's frame has the name of another, since no frame is its own parent;
                or stamps are those of receipt, with which no keyframe would find its image: each
                process receives an image at a different time.
        """
        self._check_distinct("odom_frame_id", "frame_id", "guess_frame_id", "map_frame_id")
        if self.stamps == RECEIPT:
            raise InputError(
                "stamps",
                "receipt gives an image another stamp in each process, so that the mapping node "
                "would find none of the odometry's keyframes",
                "have the driver stamp its images by one clock and set stamps to header, or "
                f"{MAP_BY_RECEIPT}",
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
                    "give each its own name, for example map, odom and base_link",
                )
            names[parameter_name] = name
