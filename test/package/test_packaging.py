"""What pip and colcon install is complete, and what it needs is declared."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from email.parser import Parser
from pathlib import Path
from typing import Any

import pytest
from rigs.paths import ROOT

NAME = "rgbd_glue_ros"
FOLDERS = ("bags", "config", "launch")

# the oldest versions are those with numpy 1
NUMPY_2_ALONE = {"rerun-sdk"}


@pytest.fixture(scope="module")
def prefix(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A prefix that pip has installed a copy of the package into."""
    pytest.importorskip("pip", reason="pip installs the package")
    pytest.importorskip("wheel", reason="older versions of setuptools build with it")
    folder = tmp_path_factory.mktemp("packaging")
    shutil.copytree(
        ROOT,
        folder / "source",
        ignore=shutil.ignore_patterns(".*", "*.egg-info", "build", "install", "log", "out"),
    )
    options = [
        "--no-deps",
        "--no-build-isolation",
        "--ignore-installed",
        "--no-warn-script-location",
    ]
    subprocess.run(
        [sys.executable, "-m", "pip", "install", *options, "--prefix", folder / "prefix", "."],
        cwd=folder / "source",
        env={**os.environ, "PIP_BREAK_SYSTEM_PACKAGES": "1"},  # the prefix is not the system's
        check=True,
    )
    return folder / "prefix"


def _only(prefix: Path, pattern: str) -> Path:
    (path,) = prefix.rglob(pattern)
    return path


@pytest.mark.slow
@pytest.mark.every_python
def test_an_installed_package_has_every_module_and_its_types(prefix: Path) -> None:
    installed = _only(prefix, f"{NAME}/py.typed").parent
    assert {p.relative_to(ROOT / NAME) for p in (ROOT / NAME).rglob("*.py")} == {
        p.relative_to(installed) for p in installed.rglob("*.py")
    }


def test_an_installed_package_finds_its_own_data_files(prefix: Path) -> None:
    site_packages = _only(prefix, f"{NAME}/py.typed").parents[1]
    program = f"import {NAME}.parameters.files as c; print(c.__file__); print(c.share_directory())"
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=prefix,
        env={"PYTHONPATH": str(site_packages)},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    module, share = (Path(line) for line in done.stdout.splitlines())
    assert module == site_packages / NAME / "parameters" / "files.py"
    assert share == _only(prefix, f"share/{NAME}")
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


def test_ros_finds_the_installed_package_in_the_resource_index(prefix: Path) -> None:
    assert _only(prefix, f"share/ament_index/resource_index/packages/{NAME}").is_file()
    assert _only(prefix, f"share/{NAME}/package.xml").read_bytes() == (
        (ROOT / "package.xml").read_bytes()
    )


def test_the_executables_are_installed(prefix: Path) -> None:
    assert {"mapping", "odometry", "rgbd-glue"} <= {path.name for path in prefix.rglob("bin/*")}


def test_pip_and_ros_agree_on_version_and_licence(prefix: Path) -> None:
    manifest = _manifest()
    metadata = Parser().parsestr(_only(prefix, "*.dist-info/METADATA").read_text())
    assert metadata["Version"] == manifest.version
    assert metadata["License"] == manifest.licenses[0] == "Apache-2.0"


def test_every_requirement_is_locked(prefix: Path) -> None:
    metadata = Parser().parsestr(_only(prefix, "*.dist-info/METADATA").read_text())
    required = {_project(line) for line in metadata.get_all("Requires-Dist", [])}
    for file, left_out in (("constraints.txt", set()), ("constraints-oldest.txt", NUMPY_2_ALONE)):
        lines = (ROOT / "scripts" / file).read_text().splitlines()
        assert required - left_out <= {_project(line) for line in lines}, (
            f"run scripts/lock for {file}"
        )


def _project(requirement: str) -> str:
    """The normalised name of the project that a requirement starts with."""
    return re.sub("[._]", "-", re.split(r"[^\w.-]", requirement, maxsplit=1)[0]).lower()


def test_package_xml_is_valid_for_an_ament_python_package() -> None:
    warnings: list[str] = []
    manifest = _manifest()
    manifest.validate(warnings=warnings)
    assert not warnings
    assert manifest.package_format == 3
    assert manifest.get_build_type() == "ament_python"
    assert (ROOT / manifest.licenses[0].file).read_text().strip().startswith("Apache License")


def _manifest() -> Any:
    return pytest.importorskip("catkin_pkg.package").parse_package(str(ROOT))


@pytest.mark.parametrize(
    ("heading", "change", "says"),
    [
        ("Forthcoming", "", "says Forthcoming; write '1.2.0 ("),
        ("1.1.0 (2026-01-02)", "", "version 1.2.0, but CHANGELOG.rst begins with '1.1.0 ("),
        ("1.2.0 (soon)", "", "but CHANGELOG.rst begins with '1.2.0 (soon)'"),
        ("1.2.0 (2026-01-02)", "echo >more", "changes that are not committed"),
        ("1.2.0 (2026-01-02)", "git tag 1.2.0", "there is a tag 1.2.0 already"),
        ("1.2.0 (2026-01-02)", "", "all checks ran and failed"),
    ],
)
def test_a_release_is_refused_unless_version_changelog_and_checks_agree(
    tmp_path: Path, heading: str, change: str, says: str
) -> None:
    for folder in ("scripts", ".ci"):
        (tmp_path / folder).mkdir()
    shutil.copy(ROOT / "scripts" / "release", tmp_path / "scripts")
    (tmp_path / ".ci" / "run").write_text("#!/bin/sh\necho all checks ran and failed >&2\nexit 1\n")
    (tmp_path / ".ci" / "run").chmod(0o755)
    (tmp_path / "package.xml").write_text("<package>\n  <version>1.2.0</version>\n</package>\n")
    (tmp_path / "CHANGELOG.rst").write_text(f"Changes\n=======\n\n{heading}\n-------\n* x\n")
    commit = "git -c user.name=a -c user.email=b commit -qm x"
    prepare = f"git init -q && git add -A && {commit} && {change or 'true'}"
    subprocess.run(["sh", "-c", prepare], cwd=tmp_path, check=True)
    done = subprocess.run(
        [tmp_path / "scripts" / "release"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert says in done.stderr
