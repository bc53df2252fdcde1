"""Names of the node's topics and services, before remapping."""

from __future__ import annotations

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.synchronizer import Channel

SUBSCRIBED = {
    Channel.COLOR: "rgb/image",
    Channel.DEPTH: "depth/image",
    Channel.INFO: "rgb/camera_info",
}
DEPTH_INFO = "depth/camera_info"
"""Only for depth that is not registered to colour."""

IMU = "imu"
"""Optional."""

POSE = "pose"
ODOM = "odom"
KEYFRAME_POSE = "keyframe/pose"
KEYFRAME_EDGES = "keyframe/edges"
PATH = "path"
MATCHES = "debug/matches"
DIAGNOSTICS = "/diagnostics"

RESET_SERVICE = "~/reset_odom"
PAUSE_SERVICE = "~/pause_odom"
RESUME_SERVICE = "~/resume_odom"
SAVE_GRAPH_SERVICE = "~/save_graph"
SAVE_MAP_SERVICE = "~/save_map"

MAP_PATH = "map/path"

KEYFRAME_FRAME = "keyframe_{}"
"""The name of a keyframe's frame in ``KEYFRAME_EDGES``, from its number."""

_KEYFRAME = KEYFRAME_FRAME.format("")
# Digits of a keyframe's number, at most: no odometry creates more keyframes.
_DIGITS = 9

RAW = "raw"
"""The transport of images that are not compressed."""


_IMAGES = (SUBSCRIBED[Channel.COLOR], SUBSCRIBED[Channel.DEPTH])
_TRANSPORTS = ("compressed", "compressedDepth")

NAMES = (
    *SUBSCRIBED.values(),
    *(f"{image}/{transport}" for image in _IMAGES for transport in _TRANSPORTS),
    *(DEPTH_INFO, IMU, POSE, ODOM, KEYFRAME_POSE, KEYFRAME_EDGES, PATH, MATCHES, MAP_PATH),
    *("tf", "tf_static", "rosout", "parameter_events", "clock", "diagnostics"),
)
"""The relative names of all topics that the nodes have, in every transport, and those of ROS."""


def transported(topic: str, transport: str) -> str:
    """The topic of an image in a transport; ``topic`` is the base topic, of the raw image."""
    return topic if transport == RAW else f"{topic}/{transport}"


def full_name(namespace: str, name: str) -> str:
    """The name of a node with its namespace, such as ``/robot/camera``."""
    return f"{namespace.rstrip('/')}/{name}"


def is_keyframe(frame_id: str) -> bool:
    """Whether a frame is named as that of a keyframe, as in ``KEYFRAME_FRAME``."""
    digits = frame_id.removeprefix(_KEYFRAME)
    return digits != frame_id and digits.isdecimal() and len(digits) <= _DIGITS


def keyframe_number(frame_id: str) -> int:
    """The number of a keyframe from the name of its frame.

    Raises:
        InputError: it is not the frame of a keyframe.
    """
    if not is_keyframe(frame_id):
        raise InputError(KEYFRAME_EDGES, f"{frame_id!r} is no keyframe", "use the odometry node's")
    return int(frame_id.removeprefix(_KEYFRAME))
