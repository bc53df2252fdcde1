"""A wheel is complete: in an empty environment, far from any checkout, nothing else has to be."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import venv
from email.parser import Parser
from pathlib import Path

import pytest
from rigs.paths import ROOT

NAME = "rgbd_glue_ros"
FOLDERS = ("bags", "config", "launch")

# the oldest versions are those with numpy 1
NUMPY_2_ALONE = {"rerun-sdk"}

LOOK = f"""
import json, sys
from pathlib import Path
from {NAME}.live.camera_presets import camera_names, load_camera
from {NAME}.parameters import load_preset, profiles_file, share_directory
try:
    from ament_index_python import get_package_share_directory
except ImportError:
    found = share_directory()
else:
    found = Path(get_package_share_directory("{NAME}"))
launch = found / "launch" / "odometry.launch.py"
compile(launch.read_text(), launch, "exec")
print(json.dumps({{
    "share": str(found),
    "same": found == share_directory(),
    "cameras": [name for name in camera_names() if load_camera(name).topics],
    "presets": [load_preset(name).features.visual for name in ("live", "paper")],
    "profiles": profiles_file().is_file(),
}}))
"""


def without_pythonpath() -> dict[str, str]:
    """This process's variables; on PYTHONPATH may be the package, which pip would leave alone."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}


def python(*words: object, cwd: Path) -> None:
    command = [sys.executable, *map(str, words)]
    subprocess.run(command, cwd=cwd, env=without_pythonpath(), check=True, capture_output=True)


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment that holds a wheel made from the source archive, and borrows the libraries."""
    pytest.importorskip("pip", reason="pip installs the package")
    pytest.importorskip("wheel", reason="older versions of setuptools build with it")
    folder = tmp_path_factory.mktemp("wheel")
    ignored = shutil.ignore_patterns(
        ".*", "__pycache__", "*.egg-info", "build", "install", "log", "out"
    )
    shutil.copytree(ROOT, folder / "source", ignore=ignored)
    python("setup.py", "-q", "sdist", "-d", folder, cwd=folder / "source")
    (archive,) = folder.glob("*.tar.gz")
    options = ["--no-deps", "--no-build-isolation", "--no-index", "-q"]
    python("-m", "pip", "wheel", *options, "-w", folder, archive, cwd=folder)
    (wheel,) = folder.glob("*.whl")
    home = folder / "environment"
    venv.create(home, with_pip=False, symlinks=True)
    python(
        "-m",
        "pip",
        "--python",
        home / "bin/python",
        "install",
        *options[:1],
        "--no-index",
        "-q",
        wheel,
        cwd=folder,
    )
    site_packages = next(home.glob("lib/python*/site-packages"))
    # a folder to look in after this one; an editable installation there is not taken up
    (site_packages / "borrowed.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return home


def run(environment: Path, cwd: Path, *words: str) -> str:
    """What a program of the environment prints, from a folder that has nothing to do with it."""
    variables = without_pythonpath()
    # the libraries of ROS are borrowed, too
    variables["AMENT_PREFIX_PATH"] = f"{environment}{os.pathsep}{sys.prefix}"
    done = subprocess.run(
        [str(environment / "bin" / words[0]), *words[1:]],
        cwd=cwd,
        env=variables,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def _only(environment: Path, pattern: str) -> Path:
    (path,) = environment.rglob(pattern)
    return path


@pytest.mark.slow
@pytest.mark.every_python
def test_an_installed_package_has_every_module_and_its_types(environment: Path) -> None:
    installed = _only(environment, f"{NAME}/py.typed").parent
    assert {p.relative_to(ROOT / NAME) for p in (ROOT / NAME).rglob("*.py")} == {
        p.relative_to(installed) for p in installed.rglob("*.py")
    }


@pytest.mark.slow
@pytest.mark.every_python
def test_an_installed_package_finds_its_own_data_files(environment: Path) -> None:
    site_packages = _only(environment, f"{NAME}/py.typed").parents[1]
    program = (
        f"import {NAME}.parameters.package_data as c; print(c.__file__); print(c.share_directory())"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=environment,
        env={"PYTHONPATH": str(site_packages)},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    module, share = (Path(line) for line in done.stdout.splitlines())
    assert module == site_packages / NAME / "parameters" / "package_data.py"
    assert share == _only(environment, f"share/{NAME}")
    for folder in FOLDERS:
        assert _files(share, folder) == _files(ROOT, folder)


def _files(root: Path, folder: str) -> set[Path]:
    """The files in a folder of data; the programs that make the bags are none."""
    return {
        path.relative_to(root)
        for path in (root / folder).rglob("*")
        if path.is_file()
        and "__pycache__" not in path.parts
        and not (folder == "bags" and path.suffix == ".py")
    }


@pytest.mark.slow
@pytest.mark.every_python
def test_ros_finds_the_installed_package_in_the_resource_index(environment: Path) -> None:
    assert _only(environment, f"share/ament_index/resource_index/packages/{NAME}").is_file()
    assert _only(environment, f"share/{NAME}/package.xml").read_bytes() == (
        (ROOT / "package.xml").read_bytes()
    )


@pytest.mark.slow
@pytest.mark.every_python
def test_the_executables_are_installed(environment: Path) -> None:
    assert {"mapping", "odometry", "rgbd-glue"} <= {
        path.name for path in environment.rglob("bin/*")
    }


@pytest.mark.slow
@pytest.mark.every_python
def test_pip_and_ros_agree_on_version_and_licence(environment: Path) -> None:
    manifest = pytest.importorskip("catkin_pkg.package").parse_package(str(ROOT))
    metadata = Parser().parsestr(_only(environment, "*.dist-info/METADATA").read_text())
    assert metadata["Version"] == manifest.version
    assert metadata["License"] == manifest.licenses[0] == "Apache-2.0"


@pytest.mark.slow
@pytest.mark.every_python
def test_every_requirement_is_locked(environment: Path) -> None:
    metadata = Parser().parsestr(_only(environment, "*.dist-info/METADATA").read_text())
    required = {_project(line) for line in metadata.get_all("Requires-Dist", [])}
    for file, left_out in (("constraints.txt", set()), ("constraints-oldest.txt", NUMPY_2_ALONE)):
        lines = (ROOT / "scripts" / file).read_text().splitlines()
        assert required - left_out <= {_project(line) for line in lines}, (
            f"run scripts/lock for {file}"
        )


def _project(requirement: str) -> str:
    """The normalised name of the project that a requirement starts with."""
    return re.sub("[._]", "-", re.split(r"[^\w.-]", requirement, maxsplit=1)[0]).lower()


@pytest.mark.slow
def test_a_wheel_finds_its_launch_file_and_all_presets(environment: Path, tmp_path: Path) -> None:
    found = json.loads(run(environment, tmp_path, "python", "-c", LOOK))
    assert Path(found["share"]).resolve() == (environment / "share" / NAME).resolve()
    assert found["same"]
    cameras = {path.stem for path in (ROOT / "config" / "cameras").glob("*.yaml")}
    assert {*found["cameras"]} == cameras
    assert len(found["presets"]) == 2
    assert found["profiles"]


def lend_machine_code(environment: Path) -> None:
    """Copies that of the checkout, whose sources are the same: compiling takes half a minute."""
    package = _only(environment, f"{NAME}/py.typed").parent
    for file in (ROOT / NAME).rglob("__pycache__/*.nb[ci]"):
        copy = package / file.relative_to(ROOT / NAME)
        copy.parent.mkdir(exist_ok=True)
        shutil.copy(file, copy)


@pytest.mark.slow
def test_a_wheel_has_a_help_and_runs_the_demonstration(environment: Path, tmp_path: Path) -> None:
    pytest.importorskip("rclpy", reason="ROS is not installed")
    lend_machine_code(environment)
    for node in ("odometry", "mapping"):
        assert "--camera PRESET" in run(environment, tmp_path, node, "--help")
    said = run(environment, tmp_path, "rgbd-glue", "demo", "--duration", "1", "-o", "out")
    assert "APE" in said
    figures = json.loads((tmp_path / "out" / "metrics.json").read_text(encoding="utf-8"))
    assert figures["tracked"] > 0
    assert (tmp_path / "out" / "report.html").is_file()
