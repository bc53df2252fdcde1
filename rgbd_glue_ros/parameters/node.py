"""The parameters that the ROS node alone has."""

from __future__ import annotations

from dataclasses import dataclass

from rgbd_glue_ros.parameters.method import FIXED
from rgbd_glue_ros.parameters.parameter import parameter, values


@dataclass(frozen=True)
class NodeConfig:
    """What the ROS node alone has: frames, topics, transport."""

    preset: str = parameter(
        "live", "Preset that the other parameters start from.", choices=("live", "paper")
    )
    frame_id: str = parameter(
        "",
        "Robot frame whose pose is published, as base_link; empty for the camera's optical frame.",
    )
    odom_frame_id: str = parameter("odom", "Fixed frame that poses are given in.")
    camera_pose: str = parameter(
        "",
        "Pose of the camera in frame_id: 'x y z roll pitch yaw' (m, rad) or 'x y z qx qy qz qw'. "
        "Empty, it is looked up on TF once it is there.",
    )
    camera_axes: str = parameter(
        "body",
        "Axes of the camera that camera_pose is given for: body has x forward, y left, z up (the "
        "camera_link of most drivers), optical has x right, y down, z forward. Without frame_id, "
        "odom starts with these axes at the camera.",
        choices=("body", "optical"),
    )
    publish_tf: bool = parameter(
        True,
        "Whether odom_frame_id -> frame_id is broadcast on /tf. Without frame_id nothing is: the "
        "optical frame has its parent from the driver.",
    )
    wait_for_transform: float = parameter(
        0.1, "How long a frame waits for a transform on TF.", unit="s", minimum=0.0, maximum=10.0
    )
    guess_frame_id: str = parameter(
        "",
        "Fixed frame of another odometry, as of wheels: the motion guess_frame_id -> frame_id on "
        "TF between two frames is where the search starts. What is broadcast is then "
        "odom_frame_id -> guess_frame_id, since frame_id has its parent. Empty for none.",
    )
    image_transport: str = parameter(
        "raw", "Transport of the colour image.", choices=("raw", "compressed")
    )
    depth_transport: str = parameter(
        "raw", "Transport of the depth image.", choices=("raw", "compressedDepth")
    )
    depth_is_registered: bool = parameter(
        False,
        "Depth is registered to colour whatever its frame says, and depth/camera_info of no "
        "interest. Without it, depth in another frame than colour is registered here or refused.",
    )
    depth_camera_pose: str = parameter(
        "",
        "Pose of the depth camera in the colour camera, for depth that is not registered: "
        "'x y z roll pitch yaw' (m, rad) or 'x y z qx qy qz qw', between the optical frames.",
    )
    qos: int = parameter(
        0,
        "Reliability of the image subscriptions: 0 as the publisher offers, 1 reliable, 2 best "
        "effort.",
        minimum=0,
        maximum=2,
    )
    qos_camera_info: int = parameter(0, "The same for the camera info.", minimum=0, maximum=2)
    topic_queue_size: int = parameter(
        10, "Messages of a topic that wait for the node, at most.", minimum=1, maximum=1000
    )
    sync_queue_size: int = parameter(
        10, "Messages of a topic that wait for their partners, at most.", minimum=1, maximum=1000
    )
    approx_sync: bool = parameter(
        True, "Whether stamps of colour and depth may differ; without it only equal ones pair."
    )
    approx_sync_max_interval: float = parameter(
        0.02,
        "Stamps of colour and depth that are further apart than this do not belong together.",
        unit="s",
        minimum=0.0,
    )
    always_process_most_recent_frame: bool = parameter(
        True,
        "Whether a frame that waits gives way to a newer one. Without it frames queue "
        "(sync_queue_size), and when the queue is full the subscriptions wait: nothing is dropped "
        "as long as topic_queue_size holds what comes meanwhile.",
    )
    max_update_rate: float = parameter(
        0.0, "Frames that come faster than this are left out; 0 takes all.", unit="Hz", minimum=0.0
    )
    publish_null_when_lost: bool = parameter(
        False,
        "Whether odom gets a message for a frame without a pose too: position, orientation "
        "quaternion and twist all zero, covariances 9999 on their diagonals, as rtabmap_odom does. "
        "Without it nothing is published for such a frame.",
    )
    path_poses: int = parameter(
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
    )
    initial_pose: str = parameter(
        "",
        "Pose in odom_frame_id that the odometry starts at, and starts anew at when it is reset: "
        "'x y z roll pitch yaw' (m, rad) or 'x y z qx qy qz qw'; empty for the origin.",
    )


NODE_CHANGEABLE = ("max_update_rate", "publish_null_when_lost", "path_period", "initial_pose")
"""Parameters of the node that can change while it runs; ``initial_pose`` counts at a reset."""


def fixed_because(name: str) -> str | None:
    """Why a parameter (dotted name) cannot change while the node runs; None if it can."""
    if name in values(NodeConfig()):
        return None if name in NODE_CHANGEABLE else "it is read once, when the node starts"
    return FIXED.get(name) or FIXED.get(name.partition(".")[0])
