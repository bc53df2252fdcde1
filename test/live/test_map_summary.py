"""What a mapping node says of its map when it ends."""

from __future__ import annotations

from rgbd_glue_ros.live.map_summary import SavedState, describe_end

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
