"""A map in a file is the same map, and another session finds itself in it."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import make_bag
import numpy as np
import pytest
from rigs.bag_frames import recorded_frames, write_small_bag
from rigs.drifted import CHANGED, config, drifted
from rigs.hamming_votes import HammingVotes
from rigs.pan import Pan
from rigs.pose_graphs import random_graph

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.slam.edge_composition import assumed_edge
from rgbd_glue_ros.slam.live_map import LiveMap, PublishedKeyframe
from rgbd_glue_ros.slam.loop_finder import LoopFinder
from rgbd_glue_ros.slam.map_file import SavedMap, read_map, write_map
from rgbd_glue_ros.slam.mapper import Mapper
from rgbd_glue_ros.slam.packed_view import packed
from rgbd_glue_ros.trajectories.tum import read_tum
from rgbd_glue_ros.types import EdgeOrigin, Float64, PoseGraph, Trajectory, View

pytest.importorskip("gtsam", reason="GTSAM is not installed")
pytest.importorskip("pyhbst", reason="pyHBST is not installed")

# where the odometry of another session starts, in the frame of the first one
T_MAP_ODOM = se3.exp(np.array([0.8, -0.3, 0.2, 0.1, -0.2, 0.4]))


@lru_cache(maxsize=1)
def first_session() -> SavedMap:
    """The keyframes of the bundled recording where they were tracked."""
    live = LiveMap(config())
    for number, keyed in enumerate(keyframes(np.eye(4))):
        live.add(number, keyed)
    return live.saved()


def keyframes(T_map_odom: Float64) -> list[PublishedKeyframe]:
    """The same, by an odometry that starts elsewhere; edges do not know of it."""
    kept = [keyframe.keyframe for keyframe in drifted()]
    found = []
    for keyframe, drifting in zip(kept, drifted(), strict=True):
        edges = tuple(
            replace(
                edge,
                T_parent_child=se3.inverse(kept[edge.parent].T_odom_camera)
                @ keyframe.T_odom_camera,
            )
            for edge in drifting.edges
        )
        T = se3.inverse(T_map_odom) @ keyframe.T_odom_camera
        found.append(PublishedKeyframe(recorded_frames()[drifting.row], T, edges))
    return found


@pytest.mark.slow
@pytest.mark.every_python
def test_a_map_comes_back_from_its_file(tmp_path: Path) -> None:
    saved = first_session()
    write_map(tmp_path / "room.rgbdmap", saved)
    read = read_map(tmp_path / "room.rgbdmap")
    for name in ("stamps_ns", "poses"):
        before, after = (getattr(m.graph.keyframes, name) for m in (saved, read))
        np.testing.assert_array_equal(after, before)
    assert [(e.parent, e.child, e.origin) for e in read.graph.edges] == [
        (e.parent, e.child, e.origin) for e in saved.graph.edges
    ]
    for packed_before, packed_after in zip(saved.views, read.views, strict=True):
        ours, theirs = packed_before.unpacked(), packed_after.unpacked()
        np.testing.assert_array_equal(theirs.grey, ours.grey)
        # half of the unit
        np.testing.assert_allclose(theirs.depth, ours.depth, rtol=0, atol=0.000126)
        assert theirs.intrinsics == ours.intrinsics
        np.testing.assert_array_equal(theirs.twist, ours.twist)
        assert theirs.contrast == ours.contrast


@pytest.mark.slow
def test_another_session_is_placed_where_it_is_once_it_shows_a_place_of_the_map(
    tmp_path: Path,
) -> None:
    write_map(tmp_path / "room.rgbdmap", first_session())
    live = LiveMap(config(), read_map(tmp_path / "room.rgbdmap"))
    assert not live.is_placed
    session = keyframes(T_MAP_ODOM)
    for number, keyed in enumerate(session):
        live.add(number, keyed)
    assert live.T_map_odom is not None
    assert se3.difference(live.T_map_odom, T_MAP_ODOM) < 0.005
    count = len(first_session())
    assert len(live.saved()) == count + len(session)
    expected = [T_MAP_ODOM @ keyed.T_odom_camera for keyed in session]
    apart = [se3.difference(live.poses[count + row], T) for row, T in enumerate(expected)]
    assert max(apart) < 0.01


@pytest.mark.slow
def test_who_only_locates_leaves_the_map_as_it_is() -> None:
    live = LiveMap(config(), first_session())
    located = [live.locate(keyed) for keyed in keyframes(T_MAP_ODOM)]
    assert all(located)
    assert live.T_map_odom is not None
    assert se3.difference(live.T_map_odom, T_MAP_ODOM) < 0.005
    assert len(live.saved()) == len(first_session())


@pytest.mark.slow
def test_keyframes_that_no_edge_links_wait_for_a_place_of_the_map_and_are_placed_with_it() -> None:
    live = LiveMap(config(), first_session())
    elsewhere = [PublishedKeyframe(frame, np.eye(4)) for frame in Pan(2)]
    for number, keyed in enumerate(elsewhere):
        live.add(number, keyed)
    assert not live.is_placed
    seen = replace(keyframes(T_MAP_ODOM)[0], edges=())
    live.add(len(elsewhere), seen)
    assert live.T_map_odom is not None
    assert se3.difference(live.T_map_odom, T_MAP_ODOM) < 0.005
    assert len(live.saved()) == len(first_session()) + len(elsewhere) + 1
    assert live.loops >= 1


def test_a_place_that_is_not_in_the_map_has_no_pose_in_it() -> None:
    live = LiveMap(config(), first_session())
    for number, frame in enumerate(Pan(3)):
        live.add(number, PublishedKeyframe(frame, np.eye(4)))
    assert not live.is_placed
    assert live.loops == 0


@pytest.mark.slow
def test_a_recording_goes_on_with_a_map_in_its_frame(tmp_path: Path) -> None:
    from rgbd_glue_ros.cli.main import main

    near = [word for name, value in CHANGED.items() for word in ("--set", f"{name}={value}")]
    first, second = tmp_path / "first", tmp_path / "second"
    room = tmp_path / "room.rgbdmap"
    bag = write_small_bag(tmp_path / "bag", make_bag.FRAME_COUNT)
    command = ["map", str(bag), *near]
    assert main([*command, "--limit", "60", "-o", str(first), "--save-map", str(room)]) == 0
    moved = read_map(room)
    poses = T_MAP_ODOM @ moved.graph.keyframes.poses
    graph = replace(moved.graph, keyframes=replace(moved.graph.keyframes, poses=poses))
    write_map(room, replace(moved, graph=graph))
    assert main([*command, "-o", str(second), "--map", str(room), "--save-map", str(room)]) == 0
    before, after = (read_tum(folder / "trajectory.txt") for folder in (first, second))
    np.testing.assert_array_equal(after.stamps_ns[: len(before.stamps_ns)], before.stamps_ns)
    for T_first, T_second in zip(before.poses, after.poses, strict=False):
        assert se3.difference(poses[0] @ T_first, T_second) < 0.005
    assert len(read_map(room)) > len(moved)


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-500])


def _compress(path: Path) -> None:
    with zipfile.ZipFile(path) as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in entries.items():
            archive.writestr(name, data)


def _without_an_image(path: Path) -> None:
    with zipfile.ZipFile(path) as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in entries.items():
            if name != "grey_1.npy":
                archive.writestr(name, data)


def _with_contrast(path: Path, contrast: float) -> None:
    saved = read_map(path)
    views = tuple(packed(replace(v.unpacked(), contrast=contrast)) for v in saved.views)
    write_map(path, replace(saved, views=views))


def _without_contrast(path: Path) -> None:
    _with_contrast(path, 0.0)


def _text(path: Path) -> None:
    path.write_text("no map")


def _change(path: Path, name: str, value: object, rows: object = 0) -> None:
    """Sets entries of an array in a map."""
    with np.load(path) as file:
        arrays = dict(file)
    arrays[name][rows] = value
    with path.open("wb") as changed:
        np.savez(changed, **arrays)


@pytest.mark.parametrize("damage", [_cut, _compress, _without_an_image, _without_contrast, _text])
def test_a_file_that_holds_no_map_is_refused_in_one_line(damage: object, tmp_path: Path) -> None:
    path = tmp_path / "room.rgbdmap"
    write_map(path, first_session())
    assert callable(damage)
    damage(path)
    with pytest.raises(InputError, match="holds no valid map") as refused:
        read_map(path)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("share", "said"),
    [(0.0, "is empty"), (0.5, "holds no valid map (it is cut off or damaged, or of another kind)")],
)
def test_an_empty_map_and_one_that_is_cut_off_are_said_to_be_that(
    share: float, said: str, tmp_path: Path
) -> None:
    path = tmp_path / "room.rgbdmap"
    write_map(path, first_session())
    data = path.read_bytes()
    path.write_bytes(data[: round(share * len(data))])
    with pytest.raises(InputError) as refused:
        read_map(path)
    assert str(refused.value) == f"{path}: {said}; give one of --save-map"


@pytest.mark.parametrize(
    ("name", "rows", "value", "said"),
    [
        ("poses", 1, 2 * np.eye(4), "poses: row 1 is no rotation and translation"),
        ("poses", (1, slice(3), slice(3)), 2 * np.eye(3), "poses: row 1 is no rotation and"),
        ("poses", (1, slice(3), slice(3)), -np.eye(3), "poses: row 1 is no rotation and"),
        ("poses", (1, 3), [0, 0, 0, 2], "poses: row 1 is no rotation and translation"),
        ("poses", (1, 0, 3), 1e300, "poses: row 1 is no rotation and translation"),
        ("poses", (1, 0, 3), np.nan, "poses: row 1 is not finite"),
        ("edge_poses", (0, 0, 0), np.nan, "edge_poses: row 0 is not finite"),
        ("edge_poses", 0, np.zeros((4, 4)), "edge_poses: row 0 is no rotation and translation"),
        ("edge_covariances", 1, np.nan, "edge_covariances: row 1 is not finite"),
        ("edge_covariances", 1, np.zeros((6, 6)), "edge_covariances: row 1 is not positive def"),
        ("edge_covariances", 1, np.ones((6, 6)), "edge_covariances: row 1 is not positive def"),
        ("edge_covariances", (1, 0, 1), 1.0, "edge_covariances: row 1 is not symmetric"),
        ("edge_ends", 0, 0, "an edge of keyframe 0 to itself"),
        ("edge_ends", (0, 0), -1, "an edge of a keyframe that is missing"),
        ("edge_ends", slice(None), [0, 1], "no edges lead from keyframe 2 to the first"),
        ("edge_origins", 0, "hearsay", "unknown origin hearsay of an edge"),
        ("twists", (2, 3), np.nan, "twists: row 2 is not finite"),
        ("times", (2, 1), np.inf, "times: row 2 is not finite"),
        ("cameras", (0, 1), 0.0, "the camera of keyframe 0: CameraIntrinsics.fy is 0.0"),
        ("contrasts", 3, np.nan, "contrasts: row 3 is not finite"),
    ],
)
def test_a_map_from_which_nothing_can_be_computed_is_refused_with_its_file_and_the_row(
    name: str, rows: object, value: object, said: str, tmp_path: Path
) -> None:
    path = tmp_path / "room.rgbdmap"
    write_map(path, walk())
    assert len(read_map(path)) == 5
    _change(path, name, value, rows)
    with pytest.raises(InputError) as refused:
        read_map(path)
    assert str(refused.value).startswith(f"{path}: holds no valid map ({said}")
    assert "\n" not in str(refused.value)


def walk() -> SavedMap:
    """A map of five keyframes, of which each is linked to the one before."""
    graph = random_graph(1, 5)
    views = [packed(View(f.color[..., 0].copy(), f.depth, f.intrinsics)) for f in Pan(5)]
    return SavedMap(graph, tuple(views))


@pytest.mark.parametrize("count", [1, 5])
def test_a_map_that_was_gone_on_with_a_lost_camera_and_stamps_of_before_is_read(
    count: int, tmp_path: Path
) -> None:
    saved, path = walk(), tmp_path / "room.rgbdmap"
    lost = [assumed_edge(i, i + 1, np.eye(4), 10**18) for i in range(count - 1)]
    keyframes = saved.graph.keyframes
    graph = PoseGraph(Trajectory(keyframes.stamps_ns[::-1][:count], keyframes.poses[:count]), ())
    write_map(path, SavedMap(replace(graph, edges=tuple(lost)), saved.views[:count]))
    read = read_map(path)
    assert len(read) == count
    assert [edge.origin for edge in read.graph.edges] == [EdgeOrigin.ASSUMED] * (count - 1)


@pytest.mark.parametrize(
    ("text", "origin"),
    [
        ("the child was tracked from the parent", EdgeOrigin.TRACKING),
        (
            "the camera was lost in between, and hardly moved as far as the covariance says",
            EdgeOrigin.ASSUMED,
        ),
        (
            "the child saw again what the parent, an anchor of long ago, had seen",
            EdgeOrigin.REVISIT,
        ),
        ("recognised by appearance and verified by registration", EdgeOrigin.LOOP),
        *((origin.value, origin) for origin in EdgeOrigin),
        *((origin.name.lower(), origin) for origin in EdgeOrigin),
    ],
)
def test_origins_of_edges_are_read_from_earlier_maps_whatever_describes_them_now(
    text: str, origin: EdgeOrigin, tmp_path: Path
) -> None:
    path = tmp_path / "room.rgbdmap"
    write_map(path, walk())
    with np.load(path) as file:
        arrays = dict(file)
    arrays["edge_origins"] = np.array([text] * len(arrays["edge_origins"]), np.str_)
    with path.open("wb") as changed:
        np.savez(changed, **arrays)
    assert {edge.origin for edge in read_map(path).graph.edges} == {origin}


def test_a_map_of_another_version_is_told_from_what_is_no_map(tmp_path: Path) -> None:
    path = tmp_path / "room.rgbdmap"
    write_map(path, walk())
    _change(path, "format", "rgbd_glue_ros map 2", ())
    with pytest.raises(InputError) as refused:
        read_map(path)
    assert str(refused.value) == (
        f"{path}: is a map of another version of this package (rgbd_glue_ros map 2; this one reads "
        "rgbd_glue_ros map 1); make the map anew, or use that version"
    )


def test_a_map_of_another_place_is_named_by_its_file(tmp_path: Path) -> None:
    path = tmp_path / "room.rgbdmap"
    write_map(path, walk())
    mapper = Mapper(LoopFinder(config(), Glue(config()), HammingVotes))
    mapper.restore(read_map(path))
    with pytest.raises(InputError) as refused:
        mapper.finish()
    assert str(refused.value) == (
        f"{path}: shows none of the places of this recording; give the map of this place, or none"
    )
