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


def describe_left_out(waiting: int) -> str:
    """What a saved map lacks, to be added to what was saved; "" if nothing.

    Args:
        waiting: keyframes that are not in the map, since they show no known place of it.
    """
    if not waiting:
        return ""
    lacks = counted(waiting, "keyframe that shows", "keyframes that show")
    return f"; without {lacks} no known place of it yet"


@dataclass(frozen=True)
class EndedMap:
    """What a mapping node has when it ends.

    Attributes:
        keyframes: in the map, also those of a given one.
        loops: that were closed.
        saved: the last time that the map was saved; None if it was not.
        given: name of the given map; "" if there is none.
        keyframes_given: of the given map.
        waiting: keyframes that are not in the map, since they show no known place of it.
    """

    keyframes: int
    loops: int
    saved: SavedState | None = None
    given: str = ""
    keyframes_given: int = 0
    waiting: int = 0


def describe_end(ended: EndedMap, service: str) -> str:
    """The map in one line, with what of it is lost.

    Args:
        ended: what there is.
        service: full name of the service that saves the map.
    """
    counts = f"{counted(ended.keyframes, 'keyframe')}, {counted(ended.loops, 'loop')} closed"
    said = [f"Map: {counts}", _what_is_saved(ended, service)]
    if ended.waiting:
        lost = counted(ended.waiting, "keyframe is lost that shows", "keyframes are lost that show")
        said.append(f"{lost} no known place of {ended.given}")
    return "; ".join(said)


def _what_is_saved(ended: EndedMap, service: str) -> str:
    added, saved = ended.keyframes - ended.keyframes_given, ended.saved
    if not added:
        nothing = "there was nothing to save"
        return f"nothing was added to {ended.given}, so {nothing}" if ended.given else nothing
    how = f"call {service} while the node runs (ros2 service call {service} std_srvs/srv/Trigger)"
    if saved is None and ended.given:
        lost = counted(
            added, "added keyframe was not saved and is", "added ones were not saved and are"
        )
        return f"{lost} gone, and {ended.given} is as it was: to keep what is added, {how}"
    if saved is None:
        return f"it was not saved and is gone: to keep one, {how}"
    if saved.keyframes < ended.keyframes:
        later = counted(ended.keyframes - saved.keyframes, "later keyframe")
        return f"saved in {saved.path} without {later}: to keep all, {how}"
    return f"saved in {saved.path}"


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
