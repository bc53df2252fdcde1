"""Why a map does not grow, where the odometry of another process is what is missing."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class OdometryTopic:
    """A topic of the odometry node, as another node sees it.

    Attributes:
        topic: its full name.
        publishers: who publishes it, in words; none if there is no publisher.
        received: messages that came: since the last look for poses, in all for the others.
    """

    topic: str
    publishers: tuple[str, ...]
    received: int


def explain_no_keyframes(
    pose: OdometryTopic, keyframe: OdometryTopic, edge: OdometryTopic
) -> str | None:
    """Why no keyframe comes, and what to do; None where nothing is amiss.

    Keyframes come as the camera moves, so that none for a while tells nothing.

    Args:
        pose: of every frame.
        keyframe: poses of keyframes.
        edge: between keyframes; none for the first.
    """
    unpublished = [each.topic for each in (pose, keyframe, edge) if not each.publishers]
    if unpublished:
        have = "has" if len(unpublished) == 1 else "have"
        return (
            f"No keyframes: {_listed(unpublished)} {have} no publisher: start the odometry node, "
            "or give this one its namespace and remappings"
        )
    if not pose.received:
        return f"No keyframes: {_silent(pose)}: the odometry has no pose, and its log says why"
    if not keyframe.received:
        return f"No keyframes: {_silent(keyframe)}: they come as the camera moves"
    if keyframe.received > 1 and not edge.received:
        return f"No keyframes: {_silent(edge)}: see whether type and QoS of the topic fit"
    return None


def _silent(silent: OdometryTopic) -> str:
    return f"no message of {silent.topic} came from {', '.join(silent.publishers)}"


def _listed(words: list[str]) -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
