"""In which transport an image is published, if not in the one that the node subscribes to."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

from rgbd_glue_ros.live import topics
from rgbd_glue_ros.messages.images import base_name
from rgbd_glue_ros.messages.synchronizer import Channel
from rgbd_glue_ros.parameters import NodeConfig, parameters

PARAMETERS = {Channel.COLOR: "image_transport", Channel.DEPTH: "depth_transport"}
"""The parameter that sets the transport of a channel's images."""

IMAGE, COMPRESSED_IMAGE = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"


@dataclass(frozen=True)
class OtherTransport:
    """An image that is published, but not where the node subscribes.

    Attributes:
        topic: where it is published.
        arguments: ROS arguments of the node that subscribe to it.
    """

    topic: str
    arguments: str


def type_in(transport: str) -> str:
    """The type of an image's messages in a transport."""
    return IMAGE if transport == topics.RAW else COMPRESSED_IMAGE


def other_transport(
    channel: Channel, base: str, transport: str, types_on: Callable[[str], Collection[str]]
) -> OtherTransport | None:
    """The same image in another transport; None if it has none, or comes in this one.

    Args:
        channel: what the topic carries.
        base: full name of the topic that the node's name is remapped to, to which the transport is
            appended.
        transport: of the node's subscription.
        types_on: returns the types that the publishers of a topic have.
    """
    parameter = PARAMETERS.get(channel)
    if parameter is None or type_in(transport) in types_on(topics.transported(base, transport)):
        return None
    # the name of a transport, instead of that of the image
    image = base_name(base)
    for other in next(p.choices for p in parameters(NodeConfig) if p.name == parameter):
        topic = topics.transported(image, other)
        if type_in(other) in types_on(topic):
            set_it = [] if other == transport else [f"-p {parameter}:={other}"]
            remap = [] if image == base else [f"-r {topics.SUBSCRIBED[channel]}:={image}"]
            return OtherTransport(topic, " ".join(remap + set_it))
    return None


def explain_transports(found: Sequence[OtherTransport]) -> str:
    """That images come in another transport, and what to do."""
    names = " and ".join(other.topic for other in found)
    are = "is" if len(found) == 1 else "are"
    arguments = " ".join(other.arguments for other in found)
    return f"{names} {are} published: start the node with --ros-args {arguments}"
