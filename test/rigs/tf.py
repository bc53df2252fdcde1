"""A robot that tells where its camera is; needs tf2_msgs."""

from __future__ import annotations

from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live.extrinsics import T_BODY_OPTICAL
from rgbd_glue_ros.messages.making import copy_fields, header
from rgbd_glue_ros.messages.poses import parse_pose
from rgbd_glue_ros.messages.transform_tree import TF, TF_STATIC
from rgbd_glue_ros.node.tf import TF_QOS, TF_STATIC_QOS
from rgbd_glue_ros.types import Float64
from rigs.ros import OPTICAL_FRAME, Rig

T_BASE_LINK = parse_pose("", "0.2 0 0.5 0 0.3 0")


class Robot(Rig):
    """A rig that publishes and hears /tf."""

    def __init__(self, domain: int) -> None:
        super().__init__(domain)
        self.heard: list[TransformStamped] = []
        self.node.create_subscription(
            TFMessage, TF, lambda m: self.heard.extend(m.transforms), TF_QOS
        )
        self.moving = self.node.create_publisher(TFMessage, TF, TF_QOS)
        self.static = self.node.create_publisher(TFMessage, TF_STATIC, TF_STATIC_QOS)

    def tell(self, *transforms: TransformStamped) -> None:
        """As robot_state_publisher does it."""
        self.static.publish(TFMessage(transforms=transforms))

    def tell_where_the_camera_is(self) -> None:
        self.tell(
            transform("base_link", "camera_link", T_BASE_LINK),
            transform("camera_link", OPTICAL_FRAME, T_BODY_OPTICAL),
        )


def transform(parent: str, child: str, T: Float64, at_ns: int = 0) -> TransformStamped:
    message = TransformStamped(child_frame_id=child)
    copy_fields(header(at_ns, parent), message.header)
    to, turn = message.transform.translation, message.transform.rotation
    to.x, to.y, to.z = T[:3, 3].tolist()
    turn.x, turn.y, turn.z, turn.w = se3.quaternion(T).tolist()
    return message
