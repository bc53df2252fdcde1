"""What a mapping node says of its map when it ends, and when the odometry begins anew."""

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


@dataclass(frozen=True)
class DroppedMap:
    """What a mapping node had when the odometry began anew.

    Attributes:
        keyframes: of this session, also those that wait for a place of a given map.
        saved: the last time that the map was saved; None if it was not.
        given: name of the given map; "" if there is none.
        keyframes_given: of the given map.
        was_placed: whether ``map`` -> ``odom`` was known.
    """

    keyframes: int
    saved: SavedState | None = None
    given: str = ""
    keyframes_given: int = 0
    was_placed: bool = True


def describe_dropped(dropped: DroppedMap, service: str) -> str | None:
    """What is lost as a new map begins, in one line; None if nothing is.

    Args:
        dropped: what there was.
        service: full name of the service that saves a map.
    """
    begun = "The odometry has begun anew (it was restarted or reset, or the clock went back)"
    again = f"map -> odom is unknown until a place of {dropped.given} is recognised"
    if not dropped.keyframes:
        return f"{begun}: {again} again" if dropped.given and dropped.was_placed else None
    of = "this session" if dropped.given else "the map"
    count = counted(dropped.keyframes, f"keyframe of {of} is", f"keyframes of {of} are")
    now = (
        f"; {dropped.given} stays, and {again}"
        if dropped.given
        else ", and a new map with another origin begins"
    )
    said = f"{begun}: {count} dropped{now}"
    return f"{said}. {_what_is_left(dropped, service)}"


def _what_is_left(dropped: DroppedMap, service: str) -> str:
    """Which keyframes of a map that is dropped are in a file."""
    saved = dropped.saved
    in_file = 0 if saved is None else max(0, saved.keyframes - dropped.keyframes_given)
    lost = dropped.keyframes - in_file
    if saved is None or not in_file:
        return f"Nothing of it was saved, so it is lost: to keep a map, call {service} before"
    if lost > 0:
        later = counted(lost, "later one is", "later ones are")
        return f"{counted(in_file, 'is', 'are')} saved in {saved.path}, and {later} lost"
    return f"All of it is saved in {saved.path}"
