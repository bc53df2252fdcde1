"""The package keeps its shape: who imports whom, what is optional, what is written once."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from rigs.paths import ROOT

PACKAGE = ROOT / "rgbd_glue_ros"

# A folder imports only from those above it. The modules at the root are the ground they stand on.
ORDER = """
    types
    files
    parameters
    geometry
    features
    registration
    refinement
    odometry
    trajectories
    messages
    recordings
    live
    slam
    evaluation
    viz
    node
    experiments
    cli
""".split()  # noqa: SIM905 - a line a floor
ROOT_MODULES = {
    "__main__",
    "closing",
    "code_cache",
    "compiled",
    "errors",
    "printable",
    "stopwatch",
}
ROS_PLACES = ("node", "experiments/demo/player.py")
CORE = {"geometry", "features", "registration", "refinement", "odometry"}
MOST_LINES, MOST_LINES_OF_THE_CORE = 400, 300
MOST_AT_THE_ROOT = 8
OPTIONAL_LIBRARIES = {
    "argcomplete",
    "cryptography",
    "dask",
    "distributed",
    "open3d",
    "torch",
    "onnxruntime",
    "pyorbslam3",
    "small_gicp",
    "networkx",
    "evo",
    "gtsam",
    "g2opy",
    "pyhbst",
    "rerun",
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
    """The folder of the package that a source file is in; its own name at the root."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def _may_import_ros(path: Path) -> bool:
    return path.relative_to(PACKAGE).as_posix().startswith(ROS_PLACES)


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


def test_the_root_holds_folders_and_few_files() -> None:
    assert {path.name for path in PACKAGE.iterdir() if (path / "__init__.py").is_file()} == {*ORDER}
    assert {path.stem for path in PACKAGE.glob("*.py")} == ROOT_MODULES | {"__init__"}
    assert len(ROOT_MODULES) < MOST_AT_THE_ROOT


@pytest.mark.parametrize("path", _sources(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_a_module_imports_only_from_its_folder_and_those_above(path: Path) -> None:
    place = _place(path)
    imported = {
        module.split(".")[1] for module in _imports(path) if module.startswith(f"{PACKAGE.name}.")
    }
    if place == "__main__":
        assert imported == {"cli"}
        return
    above = [] if place in ROOT_MODULES else ORDER[: ORDER.index(place) + 1]
    assert imported <= {*above, *ROOT_MODULES} - {"__main__"}


@pytest.mark.parametrize("path", _sources(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_ros_is_imported_by_the_node_and_the_player_alone(path: Path) -> None:
    if not _may_import_ros(path):
        assert not [module for module in _imports(path) if _is_ros(module)]


@pytest.mark.parametrize(
    "path",
    sorted({path.parent for path in _sources()} - {PACKAGE}),
    ids=lambda path: str(path.relative_to(PACKAGE)),
)
def test_every_folder_says_what_it_is_for_in_one_sentence(path: Path) -> None:
    docstring = ast.get_docstring(ast.parse((path / "__init__.py").read_text(encoding="utf-8")))
    assert docstring
    assert docstring.split("\n\n", maxsplit=1)[0].endswith(".")


@pytest.mark.parametrize("path", _sources(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_a_module_is_read_in_one_sitting(path: Path) -> None:
    most = MOST_LINES_OF_THE_CORE if _place(path) in CORE else MOST_LINES
    assert len(path.read_text(encoding="utf-8").splitlines()) <= most


@pytest.mark.slow
@pytest.mark.every_python
def test_everything_but_the_ros_modules_imports_without_ros_and_without_the_extras() -> None:
    modules = [
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        for path in _sources()
        if not _may_import_ros(path) and path.name != "__main__.py"
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


@pytest.mark.slow
def test_without_the_experiments_the_robot_still_drives() -> None:
    pytest.importorskip("rclpy", reason="ROS is not installed")
    program = """
import sys
sys.modules["rgbd_glue_ros.experiments"] = None
import rgbd_glue_ros.node.node
import rgbd_glue_ros.odometry.odometry
import rgbd_glue_ros.recordings
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
