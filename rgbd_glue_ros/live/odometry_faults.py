"""Why the mapping node gets no keyframes from the odometry node."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class OdometryTopic:
    """A topic of the odometry node, as another node sees it.

    Attributes:
        topic: its full name.
        publishers: descriptions of its publishers; empty if there are none.
        received: received messages: of poses since the last check, of the others in total.
    """

    topic: str
    publishers: tuple[str, ...]
    received: int


def explain_no_keyframes(
    pose: OdometryTopic, keyframe: OdometryTopic, edge: OdometryTopic
) -> str | None:
    """Why no keyframe arrives, and what to do; None if nothing is wrong.

    Keyframes are created as the camera moves, so none for a while is not a fault.

    Args:
        pose: the topic of every frame's pose.
        keyframe: the topic of keyframe poses.
        edge: the topic of edges between keyframes; the first keyframe has none.
    """
    unpublished = [each.topic for each in (pose, keyframe, edge) if not each.publishers]
    if unpublished:
        have = "has" if len(unpublished) == 1 else "have"
        return (
            f"No keyframes: {_listed(unpublished)} {have} no publisher: start the odometry node, "
            "or give this one its namespace and remappings"
        )
    if not pose.received:
        return f"No keyframes: {_silent(pose)}: the odometry has no pose; its log says why"
    if not keyframe.received:
        return f"No keyframes: {_silent(keyframe)}: they are created as the camera moves"
    if keyframe.received > 1 and not edge.received:
        return f"No keyframes: {_silent(edge)}: check whether type and QoS of the topic match"
    return None


def _silent(silent: OdometryTopic) -> str:
    return f"no message on {silent.topic} arrived from {', '.join(silent.publishers)}"


def _listed(words: list[str]) -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
