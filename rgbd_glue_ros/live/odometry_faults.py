"""Why another node gets nothing from the odometry node."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rgbd_glue_ros.live.topics import RESET_SERVICE
from rgbd_glue_ros.printable import counted


@dataclass(frozen=True)
class OdometryTopic:
    """A topic of the odometry node, as another node sees it.

    Attributes:
        topic: its full name.
        publishers: descriptions of its publishers; empty if there are none.
        received: received messages: of poses since the last check, of the others in total.
        last: when the last message came, of how many, by ``Arrivals``; "" if none ever did.
        nodes: full names of the nodes that publish it, as far as they are known.
    """

    topic: str
    publishers: tuple[str, ...]
    received: int
    last: str = ""
    nodes: tuple[str, ...] = ()


def explain_no_keyframes(
    pose: OdometryTopic, keyframe: OdometryTopic, edge: OdometryTopic
) -> str | None:
    """Why no keyframe arrives, and what to do; None if nothing is wrong.

    A camera at rest gives no keyframes, so none for a while is not a fault.

    Args:
        pose: the topic of every frame's pose.
        keyframe: the topic of keyframe poses.
        edge: the topic of edges between keyframes.
    """
    unpublished = [each.topic for each in (pose, keyframe, edge) if not each.publishers]
    if pose.last and (unpublished or not pose.received):
        return f"No more keyframes: {_stopped(pose, unpublished)}"
    if unpublished:
        return (
            f"No keyframes: {_have_no_publisher(unpublished)}: start the odometry node, or give "
            "this one its namespace and remappings"
        )
    if not pose.received:
        return f"No keyframes: {_silent(pose)}: the odometry has no pose; its log says why"
    if not keyframe.received:
        return (
            f"No keyframes: {_silent(keyframe)}: the odometry creates them only where the view "
            "leaves that of its latest ones, and does not send earlier ones again: "
            f"{_new_keyframes(keyframe.nodes)}"
        )
    if keyframe.received > 1 and not edge.received:
        return f"No keyframes: {_silent(edge)}: check whether type and QoS of the topic match"
    return None


def explain_late_start(first: int, nodes: Sequence[str]) -> str:
    """What a map that begins with a later keyframe than the first lacks, and what to do.

    Args:
        first: number of the first keyframe that came, which is not 0.
        nodes: full names of the nodes that publish keyframes, as far as they are known.
    """
    return (
        f"begins with keyframe {first}, without {counted(first, 'earlier one')}: the odometry "
        "sends none again to a node that subscribes later, or they were lost on the way. To map "
        f"those places, {_new_keyframes(nodes)}"
    )


def _new_keyframes(nodes: Sequence[str]) -> str:
    """How to get keyframes from an odometry that knows where the camera is."""
    reset = f"its service {RESET_SERVICE}"
    if len(nodes) == 1:
        service = RESET_SERVICE.replace("~", nodes[0], 1)
        reset = f"{service} (ros2 service call {service} std_srvs/srv/Empty)"
    return f"move the camera to a new view, or call {reset}, with which the odometry begins anew"


def _stopped(pose: OdometryTopic, unpublished: list[str]) -> str:
    """When an odometry that had poses stopped, and why."""
    if unpublished:
        return (
            f"{_have_no_publisher(unpublished)} any more; {pose.last} on {pose.topic}: the "
            "odometry node has ended; start it again"
        )
    return (
        f"{pose.last} on {pose.topic} from {', '.join(pose.publishers)}: the odometry has no pose "
        "any more; its log says why"
    )


def _have_no_publisher(topics: list[str]) -> str:
    return f"{_listed(topics)} {'has' if len(topics) == 1 else 'have'} no publisher"


def explain_no_poses(
    odom: OdometryTopic,
    heard_of: Sequence[str],
    network: str,
    *,
    was_there: bool,
) -> str:
    """Why no pose arrives, and what to do.

    Args:
        odom: the topic of poses.
        heard_of: full names of odometry nodes that say something on /diagnostics.
        network: where nodes are looked for, by ``describe_network``.
        was_there: whether poses have arrived before.
    """
    if odom.publishers and was_there:
        return f"{_silent(odom)} lately: it hangs, or was killed and is counted for a while yet"
    if odom.publishers:
        return f"{_silent(odom)}: check whether it has images, and whether type and QoS match"
    if heard_of:
        run = "runs: give its namespace"
        if len(heard_of) > 1:
            run = "run: give the namespace of one"
        return (
            f"nobody publishes {odom.topic}, but {_listed([*heard_of])} {run}, "
            "as in --ros-args -r __ns:=/robot, or its topic, -r odom:=/robot/odom"
        )
    if was_there:
        return f"{odom.topic} has no publisher any more: the node has ended; start it again"
    return (
        f"nobody publishes {odom.topic}: start the node, as in `odometry --camera realsense_d400`. "
        f"If it runs, {network}"
    )


def describe_network(environment: Mapping[str, str]) -> str:
    """Where ROS looks for other nodes, and what must be equal for them to be found.

    Args:
        environment: variables of this process.
    """
    domain = environment.get("ROS_DOMAIN_ID") or "0"
    is_here = (
        environment.get("ROS_LOCALHOST_ONLY") == "1"
        or environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE") == "LOCALHOST"
    )
    where = (
        "only nodes of this machine are found: unset ROS_LOCALHOST_ONLY and set "
        "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET for those of others"
        if is_here
        else "the network must let multicast through to those of other machines"
    )
    return f"it must have the same ROS_DOMAIN_ID, which is {domain} here; {where}"


def _silent(silent: OdometryTopic) -> str:
    return f"no message on {silent.topic} arrived from {', '.join(silent.publishers)}"


def _listed(words: list[str]) -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
