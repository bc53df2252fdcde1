"""The package keeps its shape: who imports whom, what is optional, what is written once."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "rgbd_glue_ros"

# A module imports only what stands above it; a folder's modules may also import one another.
ORDER = """
    errors types config compiled se3 stopwatch
    camera depth_registration normals matching estimation baselines features glue peers
    model residuals refinement evidence shutter timing moving keyframes drift
    alignment motion odometry
    warm_up
    parallel journal
    sync topics cameras worker transform_tree image_files rvl message_fields messages
    depth_source frames monitor arrivals match_image
    trajectory sequences evaluation registration_errors chart_axes charts page markdown
    run report replay replays convert
    pair_methods pair_evaluation paper_tables pair_jobs pair_charts pair_gallery
    pairs_figures pairs_report pairs_page pairs
    fetch
    node_process node_runtime node_parameters node_inputs node_tf node_framing node_depth
    node_outputs node_watch node_diagnostics node player demo bench cli __main__
""".split()  # noqa: SIM905 - a line a layer
ROS_MODULES = {
    "node_runtime",
    "node_parameters",
    "node_inputs",
    "node_tf",
    "node_framing",
    "node_depth",
    "node_outputs",
    "node_watch",
    "node_diagnostics",
    "node",
    "player",
}
OPTIONAL_LIBRARIES = {
    "dask",
    "distributed",
    "open3d",
    "torch",
    "onnxruntime",
    "pyorbslam3",
    "small_gicp",
    "networkx",
    "evo",
}
ROSDEP_KEYS = {
    "backports": "python3-rosbags-pip",  # comes with rosbags, as lz4
    "cv2": "python3-opencv",
    "lz4": "python3-rosbags-pip",
    "rosbags": "python3-rosbags-pip",
    "tf2_ros": "tf2_ros_py",
}


def _sources() -> list[Path]:
    return sorted(path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")


def _place(path: Path) -> str:
    """The name in ``ORDER`` of a source file: its module, or the folder it is in."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def _imports(path: Path) -> Iterator[str]:
    """The dotted names of all modules that a file imports, at its top or later."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} has a relative import"
            assert node.module is not None
            if node.module == PACKAGE.name:
                yield from (f"{PACKAGE.name}.{alias.name}" for alias in node.names)
            else:
                yield node.module


def _top(module: str) -> str:
    return module.split(".", maxsplit=1)[0]


def _is_ros(module: str) -> bool:
    top = _top(module)
    return top.endswith("_msgs") or top in {
        "ament_index_python",
        "builtin_interfaces",
        "launch",
        "launch_ros",
        "rcl_interfaces",
        "rclpy",
        "std_srvs",
        "tf2_ros",
    }


@pytest.mark.parametrize("path", _sources(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_a_module_imports_only_what_stands_above_it(path: Path) -> None:
    place = _place(path)
    assert place in ORDER, f"give {place} its place in ORDER"
    above = {*ORDER[: ORDER.index(place)]}
    if path.parent != PACKAGE:
        above.add(place)
    imported = {
        module.split(".")[1] for module in _imports(path) if module.startswith(f"{PACKAGE.name}.")
    }
    assert imported <= above


@pytest.mark.parametrize("path", _sources(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_ros_is_imported_by_the_ros_modules_alone(path: Path) -> None:
    if _place(path) not in ROS_MODULES:
        assert not [module for module in _imports(path) if _is_ros(module)]


def test_everything_but_the_ros_modules_imports_without_ros_and_without_the_extras() -> None:
    modules = [
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        for path in _sources()
        if _place(path) not in {*ROS_MODULES, "__main__"}
    ]
    absent = OPTIONAL_LIBRARIES | {
        module.split(".")[0] for path in _sources() for module in _imports(path) if _is_ros(module)
    }
    program = f"""
import importlib, sys

class Absent:
    @staticmethod
    def find_spec(name, path=None, target=None):
        if name.split(".")[0] in {absent}:
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, Absent)
for name in {modules}:
    importlib.import_module(name)
"""
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_rosdep_brings_every_library_that_is_imported() -> None:
    imported = {_top(module) for path in _sources() for module in _imports(path)}
    imported -= {PACKAGE.name, *sys.stdlib_module_names, *OPTIONAL_LIBRARIES}
    keys = {
        ROSDEP_KEYS.get(library, library if _is_ros(library) else f"python3-{library}")
        for library in imported
    }
    manifest = (ROOT / "package.xml").read_text()
    assert keys <= {*re.findall(r"<exec_depend>(.+)</exec_depend>", manifest)}


def test_the_newest_released_version_in_the_changelog_is_that_of_package_xml() -> None:
    version = re.findall(r"<version>(.+)</version>", (ROOT / "package.xml").read_text())
    headings = re.findall(r"^(\S+).*\n-+$", (ROOT / "CHANGELOG.rst").read_text(), re.MULTILINE)
    released = [heading for heading in headings if heading != "Forthcoming"]
    assert released[:1] in ([], version)


def test_no_file_names_a_folder_of_somebodys_machine() -> None:
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if listed.returncode != 0:
        pytest.skip("not a git checkout")
    paths = [ROOT / name for name in listed.stdout.split("\0") if name]
    private = re.compile(rb"(?<![\w.])/(work|root|home|Users)/\w")
    assert not [path for path in paths if path.is_file() and private.search(path.read_bytes())]
