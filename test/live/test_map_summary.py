"""What a mapping node says of its map when it ends."""

from __future__ import annotations

from rgbd_glue_ros.live.map_summary import (
    DroppedMap,
    SavedState,
    describe_dropped,
    describe_end,
)

SERVICE = "/rgbd_mapping/save_map"


def test_a_map_that_was_not_saved_is_said_to_be_gone_and_how_to_save_one() -> None:
    said = describe_end(7, 1, None, SERVICE)
    assert said.startswith("Map: 7 keyframes, 1 loop closed; it was not saved and is gone")
    assert f"ros2 service call {SERVICE} std_srvs/srv/Trigger" in said


def test_keyframes_since_the_last_saving_are_counted() -> None:
    said = describe_end(7, 2, SavedState("~/map.rgbdmap", 6), SERVICE)
    assert "2 loops closed; saved in ~/map.rgbdmap without 1 later keyframe" in said
    assert describe_end(6, 2, SavedState("/x", 6), SERVICE).endswith("closed; saved in /x")


def test_where_nothing_was_mapped_there_is_nothing_to_save() -> None:
    for said in (
        describe_end(0, 0, None, SERVICE),
        describe_end(7, 0, None, SERVICE, is_changed=False),
    ):
        assert said.endswith("there was nothing to save")


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
