"""Who publishes a topic, and with which QoS."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

from rgbd_glue_ros.live import topics

# What DDS says before a node has announced its name, and after it was killed.
_UNKNOWN = "_NODE_NAME_UNKNOWN_"


def describe_publishers(node: Node, topic: str, message_type: type) -> tuple[str, ...]:
    """Descriptions of a topic's publishers: node, type and reliability.

    Args:
        node: any node; its view of the ROS graph is used.
        topic: full name of the topic.
        message_type: the type that the topic should have.
    """
    expected = message_type.__module__.split(".")[0] + "/msg/" + message_type.__name__
    words = []
    for info in node.get_publishers_info_by_topic(topic):
        name = describe_node(info)
        wrong = "" if info.topic_type == expected else f", not {expected}"
        words.append(f"{name} ({info.topic_type}{wrong}, {_describe_offer(info.qos_profile)})")
    return tuple(words)


def describe_node(endpoint: TopicEndpointInfo) -> str:
    """The name of the node of a publisher or subscription, which DDS may not know."""
    if endpoint.node_name == _UNKNOWN:
        return "a node that has ended or just begun"
    return topics.full_name(endpoint.node_namespace, endpoint.node_name)


def publishing_nodes(node: Node, topic: str) -> tuple[str, ...]:
    """Full names of the nodes that publish a topic, sorted; of some DDS does not know the name.

    Args:
        node: any node; its view of the ROS graph is used.
        topic: full name of the topic.
    """
    infos = node.get_publishers_info_by_topic(topic)
    return tuple(sorted({describe_node(i) for i in infos if i.node_name != _UNKNOWN}))


def message_number(info: dict[str, Any]) -> int | None:
    """The number of a message among those of its publisher; None if the middleware gives none."""
    return info.get("publication_sequence_number")


def describe_mixture(topic: str, publishers: Sequence[str]) -> str:
    """A warning that a topic has several publishers, and what to do.

    Args:
        topic: its full name.
        publishers: their descriptions.
    """
    return (
        f"{topic} has {len(publishers)} publishers, whose messages mix: {', '.join(publishers)}; "
        "keep one"
    )


def describe_qos(profile: QoSProfile) -> str:
    """Reliability and durability, which must be compatible, such as ``reliable, volatile``."""
    return f"{_policy_name(profile.reliability)}, {_policy_name(profile.durability)}"


def _describe_offer(profile: QoSProfile) -> str:
    """The reliability, and the durability if it is not volatile, as with nearly all cameras."""
    if profile.durability == DurabilityPolicy.TRANSIENT_LOCAL:
        return describe_qos(profile)
    return _policy_name(profile.reliability)


def _policy_name(policy: ReliabilityPolicy | DurabilityPolicy) -> str:
    return str(policy.name).lower().replace("_", " ")
