"""A wheel in an empty environment, far from any checkout, is all that there has to be."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest
from rigs.paths import ROOT

NAME = "rgbd_glue_ros"
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
    ignored = shutil.ignore_patterns(".*", "*.egg-info", "build", "install", "log", "out")
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


@pytest.mark.slow
def test_a_wheel_finds_its_launch_file_and_all_presets(environment: Path, tmp_path: Path) -> None:
    found = json.loads(run(environment, tmp_path, "python", "-c", LOOK))
    assert Path(found["share"]).resolve() == (environment / "share" / NAME).resolve()
    assert found["same"]
    cameras = {path.stem for path in (ROOT / "config" / "cameras").glob("*.yaml")}
    assert {*found["cameras"]} == cameras
    assert len(found["presets"]) == 2
    assert found["profiles"]


@pytest.mark.slow
def test_a_wheel_has_a_help_and_runs_the_demonstration(environment: Path, tmp_path: Path) -> None:
    pytest.importorskip("rclpy", reason="ROS is not installed")
    for node in ("odometry", "mapping"):
        assert "--camera PRESET" in run(environment, tmp_path, node, "--help")
    said = run(environment, tmp_path, "rgbd-glue", "demo", "--duration", "1", "-o", "out")
    assert "APE" in said
    figures = json.loads((tmp_path / "out" / "metrics.json").read_text(encoding="utf-8"))
    assert figures["tracked"] > 0
    assert (tmp_path / "out" / "report.html").is_file()
