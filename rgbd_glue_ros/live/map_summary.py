"""What a mapping node says of its map when it ends."""

from __future__ import annotations

from dataclasses import dataclass

from rgbd_glue_ros.printable import counted


@dataclass(frozen=True)
class SavedState:
    """Where and when a map was saved.

    Attributes:
        path: of the file.
        keyframes: in the map as it was saved.
    """

    path: str
    keyframes: int


def describe_end(
    keyframes: int, loops: int, saved: SavedState | None, service: str, is_changed: bool = True
) -> str:
    """The map in one line, with what of it is lost.

    Args:
        keyframes: in the map.
        loops: that were closed.
        saved: the last time that it was saved; None if it was not.
        service: full name of the service that saves it.
        is_changed: whether anything was added to it at all.
    """
    said = f"Map: {counted(keyframes, 'keyframe')}, {counted(loops, 'loop')} closed"
    how = f"call {service} while the node runs (ros2 service call {service} std_srvs/srv/Trigger)"
    if not is_changed or not keyframes:
        return f"{said}; there was nothing to save"
    if saved is None:
        return f"{said}; it was not saved and is gone: to keep one, {how}"
    if saved.keyframes < keyframes:
        later = counted(keyframes - saved.keyframes, "later keyframe")
        return f"{said}; saved in {saved.path} without {later}: to keep all, {how}"
    return f"{said}; saved in {saved.path}"
