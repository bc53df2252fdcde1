"""Packaging for pip and colcon; what package.xml says (name, version, licence) is read from it."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

from setuptools import find_packages, setup

ROOT = Path(__file__).resolve().parent
MANIFEST = ET.parse(ROOT / "package.xml").getroot()  # noqa: S314 - our own file


def manifest(tag: str) -> str:
    """The text of an element of package.xml."""
    text = MANIFEST.findtext(tag)
    if text is None:
        raise ValueError(f"package.xml has no <{tag}>")
    return text


NAME = manifest("name")

# 0.20 integrates nothing in its legacy TSDF volume; open3d-cpu exists for x86-64 alone, and neither
# for Python 3.13.
OPEN3D = [
    "open3d-cpu>=0.19,<0.20; platform_machine == 'x86_64' and python_version < '3.13'",
    "open3d>=0.19,<0.20; platform_machine != 'x86_64' and python_version < '3.13'",
]


def shared(folder: str, *patterns: str) -> list[tuple[str, list[str]]]:
    """The ``data_files`` that install a folder, with its structure, below ``share/<package>``."""
    files = sorted(
        path.relative_to(ROOT) for pattern in patterns for path in (ROOT / folder).rglob(pattern)
    )
    return [(f"share/{NAME}/{path.parent}", [str(path)]) for path in files]


setup(
    name=NAME,
    version=manifest("version"),
    description=manifest("description"),
    long_description=(ROOT / "README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    maintainer=manifest("maintainer"),
    maintainer_email=MANIFEST.find("maintainer").get("email"),
    license=manifest("license"),
    python_requires=">=3.10",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "experiments/pairs/*.yaml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        *shared("bags", "*.mcap", "*.md", "*.yaml"),
        *shared("config", "*.rviz", "*.xml", "*.yaml"),
        *shared("launch", "*.py"),
    ],
    entry_points={
        "console_scripts": [
            f"rgbd-glue = {NAME}.cli.main:main",
            f"odometry = {NAME}.cli.odometry:main",
            f"mapping = {NAME}.cli.mapping:main",
        ]
    },
    zip_safe=True,
    # scripts/test-colcon tests with the oldest. Those of numpy, scipy, PyYAML and tqdm are Ubuntu
    # 24.04's. What rosdep installs there as python3-opencv is 4.6, which no script tests.
    install_requires=[
        "backports.zstd>=1.0",
        "lz4>=4.3",
        "numba>=0.59",
        "numpy>=1.26.4,<3",
        "opencv-python-headless>=4.10,<5",
        "PyYAML>=6.0.1",
        "rosbags>=0.11.9,<0.12",
        "scipy>=1.11.4",
        "tqdm>=4.66",
    ],
    extras_require={
        "ros": [
            "ros-jazzy-common-interfaces>=5.3.6,<5.4",
            "ros-jazzy-rclpy[fastrtps]>=7.1.6,<7.2",
        ],
        "open3d": OPEN3D,
        # loops closed, and the optimum of the pose graph
        "slam": [
            "gtsam>=4.2",
            "pyHBST>=0.2",
        ],
        # recordings for the Rerun viewer
        "viz": ["rerun-sdk>=0.31"],
        # methods of others, measured beside ours
        "bench": [
            *OPEN3D,
            "g2opy>=2.1",
            "networkx>=3.2",
            "small_gicp>=1.0",
        ],
        # commands, options and parameters completed by the shell
        "completion": [
            "argcomplete>=3.1",
        ],
        # learned features; their weights come by 'rgbd-glue weights'
        "learned": ["torch>=2.3"],
        # pairs and replays on many processes or machines
        "scale": [
            "cryptography>=42.0.0",
            "dask>=2024.8",
            "distributed>=2024.8",
        ],
        "test": [
            "catkin-pkg>=1.0",
            "hypothesis>=6.98",
            "mcap-ros2-support>=0.5",
            "pytest>=7.4",
            "pytest-timeout>=2.3",
        ],
        "lint": [
            "mypy>=1.13",
            "ruff>=0.12",
            "types-PyYAML>=6.0.12",
            "types-tqdm>=4.66",
        ],
    },
)
