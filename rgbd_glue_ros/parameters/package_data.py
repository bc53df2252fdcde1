"""The files that come with the package: presets, launch files, the profile of DDS."""

from __future__ import annotations

from pathlib import Path

from rgbd_glue_ros.errors import InputError

PACKAGE = "rgbd_glue_ros"

PROFILES_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"
"""The environment variable that gives Fast DDS its profile."""


def profiles_file() -> Path:
    """The DDS profile with which images arrive between processes without loss."""
    return share_directory() / "config" / "fastdds.xml"


def share_directory() -> Path:
    """The folder that holds ``config/``, ``launch/`` and ``package.xml``: source tree or share.

    Raises:
        InputError: the package was copied without its data files.
    """
    here = Path(__file__).resolve()
    for parent in here.parents:
        for candidate in (parent, parent / "share" / PACKAGE):
            if (candidate / "package.xml").is_file() and (candidate / "config").is_dir():
                return candidate
    raise InputError(here.parent, "the package's data files are missing", "install it again")
