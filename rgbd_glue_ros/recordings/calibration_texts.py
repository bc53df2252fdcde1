"""Calibrations in special text formats.

COLMAP's ``cameras.txt``, the ``ost.txt`` of ROS, and the ``info.txt`` of BundleFusion.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

# What follows width and height in a line of COLMAP, by the name of the model
_COLMAP = {
    "SIMPLE_PINHOLE": ("fx", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("fx", "cx", "cy", "k1"),
    "RADIAL": ("fx", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    "OPENCV_FISHEYE": ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"),
    "FULL_OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
}
_COLMAP_LINE = re.compile(r"^(\d+)\s+([A-Z_]+)\s+(\d+)\s+(\d+)\s+(\S.*)$", re.MULTILINE)
_OST_START = re.compile(r"^\s*(?:#.*\n\s*)*\[image\]", re.MULTILINE)
_OST_NAMES = ("width", "height", "camera matrix", "distortion")
# Lines of BundleFusion's names and values; its matrices are [4, 4]
_BUNDLE_FUSION_LINE = re.compile(r"^m_(\w+) *= *(\S.*?)\s*$", re.MULTILINE)


def colmap_cameras(text: str) -> Mapping[str, Any] | None:
    """The cameras in COLMAP's text by their numbers; None if it is not such a text.

    Raises:
        ValueError: a line does not have the numbers of its model.
    """
    cameras = {}
    for number, model, width, height, rest in _COLMAP_LINE.findall(text):
        if model in _COLMAP:
            values = map(float, rest.split())
            cameras[number] = {
                "width": int(width),
                "height": int(height),
                "model": "fisheye" if "FISHEYE" in model else "pinhole",
                **dict(zip(_COLMAP[model], values, strict=True)),
            }
    return cameras or None


def ost_camera(text: str) -> Mapping[str, Any] | None:
    """The camera in a text that begins with ``[image]``, as by camera_calibration; otherwise None.

    Raises:
        ValueError: expected numbers are not numbers.
    """
    if not _OST_START.match(text):
        return None
    values = {}
    for name in _OST_NAMES:
        given = re.search(rf"^{name}\s*=?\s*\n?([-+.\deE\s]+)", text, re.MULTILINE)
        if given:
            values[name.replace(" ", "_")] = [float(word) for word in given[1].split()]
    return {**values, "width": int(values["width"][0]), "height": int(values["height"][0])}


def bundle_fusion_cameras(text: str) -> Mapping[str, Any] | None:
    """The cameras ``color`` and ``depth``, and the unit of depth; None if it is not such a text.

    Raises:
        KeyError: a value is missing.
        ValueError: expected numbers are not numbers.
    """
    values = dict(_BUNDLE_FUSION_LINE.findall(text))
    if "calibrationColorIntrinsic" not in values:
        return None
    cameras = {
        name.lower(): {
            "width": int(values[f"{name.lower()}Width"]),
            "height": int(values[f"{name.lower()}Height"]),
            "k": [float(word) for word in values[f"calibration{name}Intrinsic"].split()],
        }
        for name in ("Color", "Depth")
    }
    return {**cameras, "depth_scale": float(values["depthShift"])}
