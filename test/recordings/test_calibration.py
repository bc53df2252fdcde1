"""Calibration files as people have them: one camera in the words of every program."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.parameters import metres_per_unit
from rgbd_glue_ros.recordings.calibration import read_calibration
from rgbd_glue_ros.types import LensModel

K = (600.0, 601.0, 320.5, 240.5)
D = (0.1, -0.2, 0.001, -0.002, 0.05)
SIZE = (640, 480)

ROS = """image_width: 640
image_height: 480
camera_name: head
camera_matrix: {rows: 3, cols: 3, data: [600, 0, 320.5, 0, 601, 240.5, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.1, -0.2, 0.001, -0.002, 0.05]}
rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
"""
ECHO = """header: {stamp: {sec: 1, nanosec: 0}, frame_id: camera}
height: 480
width: 640
distortion_model: plumb_bob
d: [0.1, -0.2, 0.001, -0.002, 0.05, 0.0, 0.0, 0.0]
k: [600.0, 0.0, 320.5, 0.0, 601.0, 240.5, 0.0, 0.0, 1.0]
binning_x: 0
---
"""
ORB_SLAM2 = """%YAML:1.0

# Camera calibration
Camera.fx: 600.0
Camera.fy: 601.0
Camera.cx: 320.5
Camera.cy: 240.5
Camera.k1: 0.1
Camera.k2: -0.2
Camera.p1: 0.001
Camera.p2: -0.002
Camera.k3: 0.05
Camera.width: 640
Camera.height: 480
DepthMapFactor: 5000.0
"""
ORB_SLAM3 = """%YAML:1.0
File.version: "1.0"
Camera.type: "PinHole"
Camera1.fx: 600.0
Camera1.fy: 601.0
Camera1.cx: 320.5
Camera1.cy: 240.5
Camera1.k1: 0.1
Camera1.k2: -0.2
Camera1.p1: 0.001
Camera1.p2: -0.002
Camera1.k3: 0.05
Camera.width: 640
Camera.height: 480
RGBD.DepthMapFactor: 1000.0
"""
OST = """# oST version 5.0 parameters


[image]

width
640

height
480

[narrow_stereo]

camera matrix
600.000000 0.000000 320.500000
0.000000 601.000000 240.500000
0.000000 0.000000 1.000000

distortion
0.100000 -0.200000 0.001000 -0.002000 0.050000

rectification
1.000000 0.000000 0.000000
"""
COLMAP = """# Camera list with one line of data per camera:
#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]
1 OPENCV 640 480 600 601 320.5 240.5 0.1 -0.2 0.001 -0.002
"""
OPENCV_JSON = (
    '{"mtx": [[600, 0, 320.5], [0, 601, 240.5], [0, 0, 1]], '
    '"dist": [[0.1, -0.2, 0.001, -0.002, 0.05]]}'
)
KALIBR = """cam0:
  camera_model: pinhole
  intrinsics: [600.0, 601.0, 320.5, 240.5]
  distortion_model: radtan
  distortion_coeffs: [0.1, -0.2, 0.001, -0.002]
  resolution: [640, 480]
"""
OPEN3D = """{
\t"width": 640, "height": 480,
\t"intrinsic_matrix": [600.0, 0, 0, 0, 601.0, 0, 320.5, 240.5, 1]
}"""
KINECT_OF_OPEN3D = OPEN3D.replace("{\n", '{"depth_scale": 1000.0,\n', 1)
NICE_SLAM = """dataset: replica
cam:
  H: 480
  W: 640
  fx: 600.0
  fy: 601.0
  cx: 320.5
  cy: 240.5
  png_depth_scale: 6553.5
"""
RECORD3D = '{"w": 640, "h": 480, "K": [600.0, 0, 0, 0, 601.0, 0, 320.5, 240.5, 1], "fps": 60}'
NERFSTUDIO = (
    '{"fl_x": 600.0, "fl_y": 601.0, "cx": 320.5, "cy": 240.5, "w": 640, "h": 480, "k1": 0.1, '
    '"k2": -0.2, "p1": 0.001, "p2": -0.002, "camera_model": "OPENCV", "frames": []}'
)
REALSENSE = (
    '{"color": {"width": 640, "height": 480, "ppx": 320.5, "ppy": 240.5, "fx": 600.0, '
    '"fy": 601.0, "model": "Brown Conrady", "coeffs": [0.1, -0.2, 0.001, -0.002, 0.05]}}'
)
OPENLORIS = """%YAML:1.0
---
d400_color_optical_frame:
   sensor_type: camera
   fps: 30
   width: 640
   height: 480
   model: pinhole
   intrinsics: !!opencv-matrix
      rows: 1
      cols: 4
      dt: d
      data: [ 600.0, 320.5, 601.0, 240.5 ]
   distortion_model: radial-tangential
   distortion_coefficients: !!opencv-matrix
      rows: 1
      cols: 5
      dt: d
      data: [ 0.1, -0.2, 0.001, -0.002, 0.05 ]
d400_depth_optical_frame:
   width: 848
   height: 480
   intrinsics: !!opencv-matrix
      rows: 1
      cols: 4
      dt: d
      data: [ 427.0, 428.0, 427.0, 239.0 ]
d400_gyroscope:
   sensor_type: gyroscope
"""
AZURE_BY_OPEN3D = """{"color_mode": "MJPG_3072P", "depth_mode": "NFOV_UNBINNED", "height": 480,
"intrinsic_matrix": [600.0, 0, 0, 0, 601.0, 0, 320.5, 240.5, 1], "serial_number_": "000266700112",
"stream_length_usec": 2666689, "width": 640}"""
BUNDLE_FUSION = """m_versionNumber = 4
m_sensorName = StructureSensor
m_colorWidth = 640
m_colorHeight = 480
m_depthWidth = 320
m_depthHeight = 240
m_depthShift = 1000
m_calibrationColorIntrinsic = 600 0 320.5 0 0 601 240.5 0 0 0 1 0 0 0 0 1\x20
m_calibrationColorExtrinsic = 1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\x20
m_calibrationDepthIntrinsic = 300 0 160 0 0 300 120 0 0 0 1 0 0 0 0 1\x20
m_calibrationDepthExtrinsic = 1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\x20
m_frames.size = 20
"""
ROWS = "600 0 320.5\n0 601 240.5\n0 0 1\n"

# text, size, coefficients and metres per unit
FILES: dict[str, tuple[str, tuple[int, int], tuple[float, ...], float | None]] = {
    "ROS.yaml": (ROS, SIZE, D, None),
    "with a byte-order mark.yaml": ("\ufeff" + ROS, SIZE, D, None),
    "echo.yaml": (ECHO, SIZE, (*D, 0, 0, 0), None),
    "ROS 1 echo.yaml": (ECHO.replace("d:", "D:").replace("k:", "K:"), SIZE, (*D, 0, 0, 0), None),
    "ORB-SLAM2.yaml": (ORB_SLAM2, SIZE, (*D, 0, 0, 0), 0.0002),
    "ORB-SLAM3.yaml": (ORB_SLAM3, SIZE, (*D, 0, 0, 0), 0.001),
    "ORB-SLAM2 without size.yaml": (
        ORB_SLAM2.replace("Camera.width: 640\nCamera.height: 480\n", ""),
        (0, 0),
        (*D, 0, 0, 0),
        0.0002,
    ),
    "Kalibr.yaml": (KALIBR, SIZE, D[:4], None),
    "Open3D.json": (OPEN3D, SIZE, (), None),
    "Azure Kinect by Open3D.json": (KINECT_OF_OPEN3D, SIZE, (), 0.001),
    "NICE-SLAM.yaml": (NICE_SLAM, SIZE, (), 1 / 6553.5),
    "Record3D.json": (RECORD3D, SIZE, (), None),
    "nerfstudio.json": (NERFSTUDIO, SIZE, (*D[:4], 0, 0, 0, 0), None),
    "RealSense.json": (REALSENSE, SIZE, D, None),
    "OpenLORIS sensors.yaml": (OPENLORIS, SIZE, D, None),
    "Azure Kinect by Open3D's reader.json": (AZURE_BY_OPEN3D, SIZE, (), None),
    "ARKitScenes.pincam": ("640 480 600.0 601.0 320.5 240.5", SIZE, (), None),
    "K.txt": (ROWS, (0, 0), (), None),
    "camera_matrix.csv": (ROWS.replace(" ", ","), (0, 0), (), None),
    "numpy.txt": ("[[600. 0. 320.5]\n [0. 601. 240.5]\n [0. 0. 1.]]", (0, 0), (), None),
    "SUN3D.txt": (
        "600 0 320.5 0\n0 601 240.5 0\n0 0 1 0\n0 0 0 1\n",
        (0, 0),
        (),
        None,
    ),
    "ETH3D.txt": ("600.0 601.0 320.5 240.5\n", (0, 0), (), None),
    "ost.txt": (OST, SIZE, D, None),
    "cameras.txt": (COLMAP, SIZE, (*D[:4], 0, 0, 0, 0), None),
    "info.txt": (BUNDLE_FUSION, SIZE, (), 0.001),
    "mtx and dist.json": (OPENCV_JSON, (0, 0), D, None),
    "commented.txt": ("# fx fy cx cy\n600.0 601.0 320.5 240.5\n", (0, 0), (), None),
}


@pytest.mark.parametrize("name", FILES)
def test_a_camera_is_the_same_in_the_words_of_every_program(tmp_path: Path, name: str) -> None:
    text, size, distortion, depth_scale = FILES[name]
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    calibration = read_calibration(path)
    camera = calibration.intrinsics
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == K
    assert (camera.width, camera.height) == size
    assert camera.distortion == distortion
    assert calibration.depth_scale == depth_scale


def test_what_opencv_writes_itself_is_read(tmp_path: Path) -> None:
    path = tmp_path / "opencv.yaml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    storage.write("camera_matrix", np.array([[600, 0, 320.5], [0, 601, 240.5], [0, 0, 1]], float))
    storage.write("distortion_coefficients", np.array([D]))
    storage.release()
    camera = read_calibration(path).intrinsics
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == K
    assert camera.distortion == D


FISHEYES = {
    "Kalibr": KALIBR.replace("radtan", "equidistant"),
    "ORB-SLAM3": ORB_SLAM3.replace("PinHole", "KannalaBrandt8")
    .replace("p1: 0.001", "k3: 0.001")
    .replace("p2: -0.002", "k4: -0.002")
    .replace("Camera1.k3: 0.05\n", ""),
}


@pytest.mark.parametrize("name", FISHEYES)
def test_a_fisheye_lens_is_known_as_one(tmp_path: Path, name: str) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(FISHEYES[name])
    camera = read_calibration(path).intrinsics
    assert camera.lens is LensModel.KANNALA_BRANDT
    assert camera.distortion == (0.1, -0.2, 0.001, -0.002)


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        (KALIBR + KALIBR.replace("cam0", "cam1"), "holds 2 cameras (cam0, cam1)"),
        (KALIBR.replace("pinhole", "omni"), "camera model 'omni' is not supported"),
        ("model_type: MEI\nfx: 600", "camera model 'MEI' is not supported"),
        (COLMAP + COLMAP.replace("1 OPENCV", "2 OPENCV"), "keep only the colour camera"),
        (COLMAP.replace(" -0.002", ""), "cannot be read"),
        (BUNDLE_FUSION.replace("m_colorW", "m_w"), "cannot be read ('colorWidth')"),
        (BUNDLE_FUSION.replace("= 600 0", "= 600"), "a camera matrix of 15 numbers"),
        ("1 2 3", "a camera matrix of 3 numbers"),
        ("", "is not a camera calibration"),
        ("nothing: of that", "is not a camera calibration"),
        ("{", "cannot be read"),
        (ORB_SLAM2.replace("5000.0", "-1"), "a depth scale of -1"),
        (ROS.replace("[600,", "[0,"), "fx of K is 0.0; give values in pixels"),
        ("1e300 0 320 0 1e300 240 0 0 1", "fx of K is 1e+300; give values in pixels"),
        ("0 0 0 0 0 0 0 0 0", "K is all zeros"),
        ("1e999 480 600 600 320 240", "cannot convert float infinity to integer"),
        ("fx: 600\nfy: 600\ncx: 320\ncy: 240\nfx: 60", "line 5: fx is also given in line 1"),
        ('{"fx": 600, "fy": 600,\n "fx": 60}', "line 2: fx is also given in line 1"),
        ("fx: 600\nfy: [600", "line 2: "),
        (ROS.replace("601", "oops"), "is not a camera calibration"),
    ],
)
def test_what_tells_of_no_camera_or_of_several_is_refused_in_one_line(
    tmp_path: Path, text: str, cause: str
) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as error:
        read_calibration(path)
    assert error.value.where == str(path)
    assert cause in str(error.value)
    assert "\n" not in str(error.value)


def test_a_depth_scale_is_metres_of_a_unit_or_units_of_a_metre_by_its_magnitude() -> None:
    assert metres_per_unit(0.001) == 0.001
    assert metres_per_unit(1000.0) == 0.001
    assert metres_per_unit(1.0) == 1.0
