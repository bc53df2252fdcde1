from __future__ import annotations

from pathlib import Path

import pytest

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.recordings.bag.file import RecordedTopic
from rgbd_glue_ros.recordings.bag.topics import (
    find_color,
    find_depth,
    find_ground_truth,
    find_info,
)

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
INFO, POSE, TF = (
    "sensor_msgs/msg/CameraInfo",
    "geometry_msgs/msg/PoseStamped",
    "tf2_msgs/msg/TFMessage",
)
BAG = Path("some.bag")

# What drivers and simulators publish; the last three are what should be found.
LAYOUTS = {
    "TUM": (
        {
            "/camera/depth/camera_info": INFO,
            "/camera/depth/image": IMAGE,
            "/camera/rgb/camera_info": INFO,
            "/camera/rgb/image_color": IMAGE,
            "/cortex_marker_array": "visualization_msgs/msg/MarkerArray",
            "/tf": TF,
        },
        ("/camera/rgb/image_color", "/camera/depth/image", "/camera/rgb/camera_info"),
    ),
    "RealSense": (
        {
            "/camera/camera/color/image_raw": IMAGE,
            "/camera/camera/color/image_raw/compressed": COMPRESSED,
            "/camera/camera/color/camera_info": INFO,
            "/camera/camera/depth/image_rect_raw": IMAGE,
            "/camera/camera/depth/camera_info": INFO,
            "/camera/camera/aligned_depth_to_color/image_raw": IMAGE,
            "/camera/camera/aligned_depth_to_color/image_raw/compressedDepth": COMPRESSED,
            "/camera/camera/aligned_depth_to_color/camera_info": INFO,
            "/camera/camera/infra1/image_rect_raw": IMAGE,
            "/camera/camera/infra1/camera_info": INFO,
        },
        (
            "/camera/camera/color/image_raw",
            "/camera/camera/aligned_depth_to_color/image_raw",
            "/camera/camera/color/camera_info",
        ),
    ),
    "Azure Kinect": (
        {
            "/rgb/image_raw/compressed": COMPRESSED,
            "/rgb/camera_info": INFO,
            "/depth/image_raw/compressedDepth": COMPRESSED,
            "/depth/camera_info": INFO,
            "/depth_to_rgb/image_raw/compressedDepth": COMPRESSED,
            "/depth_to_rgb/camera_info": INFO,
            "/ir/image_raw/compressed": COMPRESSED,
        },
        (
            "/rgb/image_raw/compressed",
            "/depth_to_rgb/image_raw/compressedDepth",
            "/rgb/camera_info",
        ),
    ),
    "ZED": (
        {
            "/zed/zed_node/rgb/image_rect_color": IMAGE,
            "/zed/zed_node/rgb/camera_info": INFO,
            "/zed/zed_node/depth/depth_registered": IMAGE,
            "/zed/zed_node/depth/camera_info": INFO,
        },
        (
            "/zed/zed_node/rgb/image_rect_color",
            "/zed/zed_node/depth/depth_registered",
            "/zed/zed_node/rgb/camera_info",
        ),
    ),
    "OpenNI": (
        {
            "/camera/rgb/image_raw": IMAGE,
            "/camera/rgb/image_rect_color": IMAGE,
            "/camera/rgb/camera_info": INFO,
            "/camera/depth/image_raw": IMAGE,
            "/camera/depth_registered/image_raw": IMAGE,
            "/camera/depth_registered/camera_info": INFO,
        },
        (
            "/camera/rgb/image_raw",
            "/camera/depth_registered/image_raw",
            "/camera/rgb/camera_info",
        ),
    ),
    "Gazebo": (
        {
            "/rgbd_camera/image": IMAGE,
            "/rgbd_camera/depth_image": IMAGE,
            "/rgbd_camera/camera_info": INFO,
        },
        ("/rgbd_camera/image", "/rgbd_camera/depth_image", "/rgbd_camera/camera_info"),
    ),
}


def topics_of(types: dict[str, str]) -> dict[str, RecordedTopic]:
    return {name: RecordedTopic(name, kind, 7) for name, kind in types.items()}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_topics_of_common_drivers_are_found(layout: str) -> None:
    types, expected = LAYOUTS[layout]
    topics = topics_of(types)
    color = find_color(topics, None, BAG)
    depth = find_depth(topics, None, BAG)
    assert (color, depth, find_info(topics, None, color, BAG)) == expected


def test_a_given_topic_is_taken_even_if_another_looks_better() -> None:
    topics = topics_of(LAYOUTS["RealSense"][0])
    plain = "/camera/camera/depth/image_rect_raw"
    assert find_depth(topics, plain, BAG) == plain
    compressed = "/camera/camera/color/image_raw/compressed"
    assert find_color(topics, compressed, BAG) == compressed


def test_a_topic_given_without_its_transport_is_found() -> None:
    topics = topics_of(LAYOUTS["Azure Kinect"][0])
    assert find_color(topics, "/rgb/image_raw", BAG) == "/rgb/image_raw/compressed"
    assert find_depth(topics, "depth/image_raw", BAG) == "/depth/image_raw/compressedDepth"


def test_a_missing_topic_is_refused_with_a_list_of_those_it_may_be() -> None:
    topics = topics_of({"/scan": "sensor_msgs/msg/LaserScan", "/rgb/image": IMAGE})
    with pytest.raises(InputError) as caught:
        find_depth(topics, None, BAG)
    assert str(caught.value) == (
        "some.bag: no topic of depth found; give one of its topics (--depth-topic TOPIC), "
        "which are /rgb/image (sensor_msgs/msg/Image, 7)"
    )
    with pytest.raises(InputError, match="there is no topic /scan of colour"):
        find_color(topics, "/scan", BAG)
    # none can be given if the bag has none of the type
    with pytest.raises(InputError) as caught:
        find_info(topics, None, "/rgb/image", BAG)
    assert str(caught.value) == (
        "some.bag: no topic of camera info found; give --calibration FILE; the bag has only "
        "/scan (sensor_msgs/msg/LaserScan, 7), /rgb/image (sensor_msgs/msg/Image, 7)"
    )


def test_two_cameras_are_refused_with_their_names() -> None:
    names = ["/front/color/image_raw", "/rear/color/image_raw"]
    with pytest.raises(InputError, match=f"2 topics may be colour: {', '.join(names)}"):
        find_color(topics_of(dict.fromkeys(names, IMAGE)), None, BAG)


def test_only_what_is_named_so_is_ground_truth() -> None:
    topics = topics_of({"/odom": "nav_msgs/msg/Odometry", "/slam/pose": POSE})
    assert find_ground_truth(topics, None, BAG) is None
    assert find_ground_truth(topics, "/slam/pose", BAG) == "/slam/pose"
    for name in ("/ground_truth/pose", "/groundtruth", "/gt", "/mocap/camera", "/vrpn/body/pose"):
        assert find_ground_truth({**topics, **topics_of({name: POSE})}, None, BAG) == name
    with pytest.raises(InputError, match="there is no topic /tf of ground truth"):
        find_ground_truth(topics, "/tf", BAG)


# Where names fail: topics with the encoding of their first image; what should be found of them
ENCODED = {
    "OAK-D": (
        {"/oak/rgb/image_raw": "bgr8", "/oak/stereo/image_raw": "16UC1"},
        ("/oak/rgb/image_raw", "/oak/stereo/image_raw"),
    ),
    "TurtleBot 4": (
        {"/oakd/rgb/preview/image_raw": "bgr8", "/oakd/stereo/image_raw": "16UC1"},
        ("/oakd/rgb/preview/image_raw", "/oakd/stereo/image_raw"),
    ),
    "another word": ({"/d435/rgb": "rgb8", "/d435/range": "32FC1"}, ("/d435/rgb", "/d435/range")),
    "no word at all": ({"/a/image": "rgb8", "/b/image": "16UC1"}, ("/a/image", "/b/image")),
    "infrared and depth": (
        {
            "/camera/infra1/image_rect_raw": "mono8",
            "/camera/infra2/image_rect_raw": "mono8",
            "/camera/depth/image_rect_raw": "16UC1",
        },
        ("/camera/infra1/image_rect_raw", "/camera/depth/image_rect_raw"),
    ),
    "two resolutions": (
        {
            "/kinect2/qhd/image_color": "bgr8",
            "/kinect2/qhd/image_depth_rect": "16UC1",
            "/kinect2/sd/image_color_rect": "bgr8",
            "/kinect2/sd/image_depth_rect": "16UC1",
        },
        ("/kinect2/qhd/image_color", "/kinect2/qhd/image_depth_rect"),
    ),
    "three views": (
        {
            "/zed/left/color/rect/image": "bgra8",
            "/zed/right/color/rect/image": "bgra8",
            "/zed/rgb/color/rect/image": "bgra8",
            "/zed/depth/depth_registered": "32FC1",
        },
        ("/zed/rgb/color/rect/image", "/zed/depth/depth_registered"),
    ),
    "no leading slash": (
        {"camera/rgb/image_color": "bgr8", "camera/depth/image": "16UC1"},
        ("camera/rgb/image_color", "camera/depth/image"),
    ),
}


# Everything that a driver publishes
ENCODED |= {
    "all of Azure Kinect": (
        {
            "/depth/image_raw": "16UC1",
            "/depth_to_rgb/image_raw": "16UC1",
            "/ir/image_raw": "mono16",
            "/rgb/image_raw": "bgra8",
            "/rgb_to_depth/image_raw": "bgra8",
        },
        ("/rgb/image_raw", "/depth_to_rgb/image_raw"),
    ),
    "all of Azure Kinect, compressed": (
        {
            "/depth_to_rgb/image_raw/compressed": "16UC1; png compressed ",
            "/rgb/image_raw/compressed": "jpeg",
            "/rgb_to_depth/image_raw/compressed": "bgra8; jpeg compressed bgr8",
        },
        ("/rgb/image_raw/compressed", "/depth_to_rgb/image_raw/compressed"),
    ),
    "ARKit": (
        {
            "/arkit/camera/image": "nv12",
            "/arkit/depth/confidence": "8UC1",
            "/arkit/depth/image": "32FC1",
        },
        ("/arkit/camera/image", "/arkit/depth/image"),
    ),
    "confidence of 16 bits": (
        {"/l515/rgb": "rgb8", "/l515/depth/confidence": "16UC1", "/l515/depth/image": "16UC1"},
        ("/l515/rgb", "/l515/depth/image"),
    ),
    "depth by encoding beside its confidence": (
        {"/oak/rgb": "rgb8", "/oak/depth_confidence": "8UC1", "/oak/stereo/image_raw": "16UC1"},
        ("/oak/rgb", "/oak/stereo/image_raw"),
    ),
    "all of OpenNI": (
        {
            "/camera/rgb/image_raw": "bgr8",
            "/camera/rgb/image_rect_color": "bgr8",
            "/camera/depth/image": "32FC1",
            "/camera/depth/image_raw": "16UC1",
            "/camera/depth/image_rect": "32FC1",
            "/camera/depth_registered/image": "32FC1",
            "/camera/depth_registered/image_raw": "16UC1",
            "/camera/depth_registered/sw_registered/image_rect_raw": "16UC1",
        },
        ("/camera/rgb/image_raw", "/camera/depth_registered/image_raw"),
    ),
    "rectified alone": (
        {
            "/camera/rgb/image_rect_color": "bgr8",
            "/camera/depth_registered/image_raw": "16UC1",
            "/camera/depth_registered/image_rect": "32FC1",
        },
        ("/camera/rgb/image_rect_color", "/camera/depth_registered/image_rect"),
    ),
}


@pytest.mark.parametrize("layout", ENCODED)
def test_encodings_decide_where_names_do_not(layout: str) -> None:
    encodings, expected = ENCODED[layout]
    topics = topics_of(dict.fromkeys(encodings, IMAGE))
    color = find_color(topics, None, BAG, encodings.__getitem__)
    assert (color, find_depth(topics, None, BAG, encodings.__getitem__, color)) == expected


# A camera with depth, and one without whose colour has the better name
WITHOUT_DEPTH = {
    "rgb": ("/wrist/rgb/image_raw", "/head/color/image_raw", "/head/aligned_depth_to_color/image"),
    "color": ("/wrist/color/image_raw", "/head/rgb/image_raw", "/head/depth_registered/image_raw"),
    "image_color": ("/usb_cam/image_color", "/camera/image_raw", "/camera/depth/image_raw"),
    "no word": ("/fisheye/left/image_raw", "/camera/image_raw", "/camera/depth/image_raw"),
    "deeper": ("/robot/wrist/rgb", "/robot/head/image_raw", "/robot/head/depth/image_raw"),
    "one folder": ("/webcam/image_color", "/rgbd_camera/image", "/rgbd_camera/depth_image"),
    "rectified": ("/wrist/rgb/image_raw", "/head/color/image_rect", "/head/depth/image_rect"),
    "infrared": ("/wrist/rgb/image_raw", "/head/infra1/image_raw", "/head/depth/image_raw"),
    "by encoding": ("/webcam/rgb/image_raw", "/oak/right/image_raw", "/oak/stereo/image_raw"),
}


@pytest.mark.parametrize("layout", WITHOUT_DEPTH)
def test_colour_beside_depth_comes_before_colour_with_a_better_name(layout: str) -> None:
    names = WITHOUT_DEPTH[layout]
    encodings = dict(zip(names, ("rgb8", "mono8", "16UC1"), strict=True))
    topics = topics_of(dict.fromkeys(names, IMAGE))
    color = find_color(topics, None, BAG, encodings.__getitem__)
    assert (color, find_depth(topics, None, BAG, encodings.__getitem__, color)) == names[1:]


def test_of_two_cameras_with_depth_none_is_taken_for_the_name_of_its_colour() -> None:
    names = ["/wrist/rgb/image_raw", "/head/color/image_rect_color"]
    depths = ["/wrist/aligned_depth_to_color/image_raw", "/head/depth/image_rect"]
    topics = topics_of(dict.fromkeys([*names, *depths], IMAGE))
    with pytest.raises(InputError, match=f"2 topics may be colour: {', '.join(names)}"):
        find_color(topics, None, BAG)
    # the depth of one tells which is meant
    assert find_color(topics, None, BAG, near=depths[1]) == names[1]
    assert find_depth(topics, None, BAG, near=names[1]) == depths[1]


def test_one_image_in_two_transports_is_one_image() -> None:
    base = "/camera/aligned_depth_to_color/image_raw"
    names = [f"{base}/compressed", f"{base}/compressedDepth"]
    assert find_depth(topics_of(dict.fromkeys(names, COMPRESSED)), None, BAG) == names[1]


def test_of_two_cameras_the_depth_of_the_given_colour_is_taken() -> None:
    names = [f"/{c}/{k}/image_raw" for c in ("front", "rear") for k in ("color", "depth")]
    topics = topics_of(dict.fromkeys(names, IMAGE))
    assert find_depth(topics, None, BAG, near="/rear/color/image_raw") == "/rear/depth/image_raw"
    with pytest.raises(InputError, match=r"give one of them \(--color-topic TOPIC\)"):
        find_color(topics, None, BAG)


@pytest.mark.parametrize(
    ("topic", "kind", "what", "remedy"),
    [
        # voxblox#325
        ("/points", "sensor_msgs/msg/PointCloud2", "depth", "pointcloud_to_depthimage"),
        ("/disparity", "stereo_msgs/msg/DisparityImage", "depth", "disparity_to_depth"),
        # depthai-ros#653
        ("/rgb/ffmpeg", "ffmpeg_image_transport_msgs/msg/FFMPEGPacket", "colour", "republish"),
        ("/rgb/theora", "theora_image_transport/msg/Packet", "colour", "republish"),
        ("/rgbd", "rtabmap_msgs/msg/RGBDImage", "depth", "rgbd_split"),
        ("/color", "foxglove_msgs/msg/CompressedImage", "colour", "sensor_msgs/msg/Image"),
        # of JSON and protobuf
        ("/depth", "/msg/foxglove.RawImage", "depth", "sensor_msgs/msg/Image"),
        # rtabmap_ros#1302
        ("/camera/rgbd", "realsense2_camera_msgs/msg/RGBD", "depth", "record the images"),
    ],
)
def test_images_in_another_form_are_told_with_what_makes_images_of_them(
    topic: str, kind: str, what: str, remedy: str
) -> None:
    find = find_depth if what == "depth" else find_color
    told = f"no topic of {what} found; {topic} (holds|is) .*{remedy}"
    with pytest.raises(InputError, match=told):
        find(topics_of({topic: kind, "/camera_info": INFO}), None, BAG)


def test_a_type_of_another_package_with_the_name_of_an_image_is_no_image() -> None:
    topics = topics_of({"/my/rgb/image": "my_cam/msg/Image", "/cam/image": IMAGE})
    assert find_color(topics, None, BAG) == "/cam/image"
