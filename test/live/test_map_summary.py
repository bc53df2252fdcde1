"""What a mapping node says of its map when it ends."""

from __future__ import annotations

from rgbd_glue_ros.live.map_summary import (
    DroppedMap,
    EndedMap,
    SavedState,
    describe_dropped,
    describe_end,
    describe_left_out,
)

SERVICE = "/rgbd_mapping/save_map"


def ended(*fields: object, **named: object) -> str:
    return describe_end(EndedMap(*fields, **named), SERVICE)  # type: ignore[arg-type]


def test_a_map_that_was_not_saved_is_said_to_be_gone_and_how_to_save_one() -> None:
    said = ended(7, 1)
    assert said.startswith("Map: 7 keyframes, 1 loop closed; it was not saved and is gone")
    assert f"ros2 service call {SERVICE} std_srvs/srv/Trigger" in said


def test_keyframes_since_the_last_saving_are_counted() -> None:
    said = ended(7, 2, SavedState("~/map.rgbdmap", 6))
    assert "2 loops closed; saved in ~/map.rgbdmap without 1 later keyframe" in said
    assert ended(6, 2, SavedState("/x", 6)).endswith("closed; saved in /x")


def test_where_nothing_was_mapped_there_is_nothing_to_save() -> None:
    assert ended(0, 0) == "Map: 0 keyframes, 0 loops closed; there was nothing to save"


def test_of_a_given_map_which_is_in_its_file_only_what_was_added_is_said_to_be_gone() -> None:
    given = {"given": "/room", "keyframes_given": 7}
    nothing = "; nothing was added to /room, so there was nothing to save"
    assert ended(7, 0, **given).endswith(nothing)
    assert ended(7, 0, SavedState("/x", 7), **given).endswith(nothing)
    said = ended(9, 1, **given)
    assert (
        "1 loop closed; 2 added ones were not saved and are gone, and /room is as it was: to"
        in said
    )
    assert "; 1 added keyframe was not saved and is gone, and /room is" in ended(8, 1, **given)
    assert ended(9, 1, SavedState("/x", 9), **given).endswith("closed; saved in /x")
    assert "saved in /x without 1 later keyframe" in ended(9, 1, SavedState("/x", 8), **given)


def test_keyframes_that_waited_for_a_place_of_a_given_map_to_the_end_are_said_to_be_lost() -> None:
    said = ended(7, 0, given="/room", keyframes_given=7, waiting=3)
    assert said.endswith("; 3 keyframes are lost that show no known place of /room")


def test_a_saved_map_is_said_to_lack_the_keyframes_that_wait_for_a_known_place() -> None:
    assert describe_left_out(0) == ""
    assert describe_left_out(1) == "; without 1 keyframe that shows no known place of it yet"
    assert describe_left_out(9) == "; without 9 keyframes that show no known place of it yet"


def dropped(*fields: object, **named: object) -> str:
    return str(describe_dropped(DroppedMap(*fields, **named), SERVICE))  # type: ignore[arg-type]


def test_what_a_restarted_odometry_costs_the_map_is_counted_and_what_is_saved_named() -> None:
    said = dropped(7)
    assert "7 keyframes of the map are dropped, and a new map with another origin begins" in said
    assert said.endswith(
        f"Nothing of it was saved, so it is lost: to keep a map, call {SERVICE} before"
    )
    assert "1 keyframe of the map is dropped" in dropped(1)
    assert dropped(7, SavedState("/x", 7)).endswith("origin begins. All of it is saved in /x")
    said = dropped(7, SavedState("/x", 5))
    assert said.endswith("5 are saved in /x, and 2 later ones are lost")


def test_a_given_map_is_said_to_stay_while_the_keyframes_of_the_session_go() -> None:
    said = dropped(3, SavedState("/x", 6), given="/room", keyframes_given=4)
    assert "3 keyframes of this session are dropped; /room stays, and map -> odom is" in said
    assert said.endswith("2 are saved in /x, and 1 later one is lost")
    # a file with nothing but the given map
    said = dropped(3, SavedState("/x", 4), given="/room", keyframes_given=4, was_placed=False)
    assert "Nothing of it was saved" in said


def test_an_odometry_that_begins_anew_before_there_is_a_map_costs_nothing() -> None:
    service, given = SERVICE, {"given": "/room", "keyframes_given": 4}
    assert describe_dropped(DroppedMap(0), service) is None
    assert dropped(0, **given, was_placed=False) == "None"
    assert dropped(0, **given).endswith(
        "map -> odom is unknown until a place of /room is recognised again"
    )
