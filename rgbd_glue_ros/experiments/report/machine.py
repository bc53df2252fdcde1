"""The machine of a benchmark, so that its figures can be judged."""

from __future__ import annotations

import os
import platform
import re
from importlib import metadata
from pathlib import Path
from typing import Any

import cv2

_PACKAGE = "rgbd_glue_ros"
_LIBRARIES = (
    _PACKAGE,
    "numpy",
    "numba",
    "scipy",
    "open3d",
    "open3d-cpu",
    "small_gicp",
)


def machine() -> dict[str, Any]:
    """Processor, memory, system, and the versions of the libraries that are installed."""
    return {
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)),
        "memory_gb": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30),
        "system": _system(),
        "niceness": os.nice(0),
        "python": platform.python_version(),
        "versions": {
            "opencv": cv2.__version__,
            **{library: version for library in _LIBRARIES if (version := _version(library))},
        },
    }


def package_version() -> str | None:
    """The version of this package; None if it is not installed."""
    return _version(_PACKAGE)


def load() -> float:
    """Number of runnable processes on the whole machine during the last minute."""
    return os.getloadavg()[0]


def resident_mb() -> float:
    """Current memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def _system() -> str:
    try:
        return platform.freedesktop_os_release()["PRETTY_NAME"]
    except (OSError, KeyError):
        return platform.system()


def _processor() -> str:
    try:
        found = re.search(r"model name\s*: (.+)", Path("/proc/cpuinfo").read_text(encoding="utf-8"))
    except OSError:
        found = None
    return found[1] if found else platform.machine()


def _version(library: str) -> str | None:
    try:
        return metadata.version(library)
    except metadata.PackageNotFoundError:
        return None
