"""The scripts' virtual environment: where it is, and when it is made; and what scripts print."""

from __future__ import annotations

import os
import runpy
import shutil
import subprocess
import sys
import venv
from collections.abc import Callable
from pathlib import Path

import pytest
from rigs.paths import ROOT


def sourced(commands: str, **variables: str) -> str:
    """What commands print after scripts/environment.sh."""
    return subprocess.run(
        ["bash", "-ec", f". scripts/environment.sh; {commands}"],
        cwd=ROOT,
        env={**os.environ, "PYTHON": sys.executable, **variables},
        check=True,
        capture_output=True,
        text=True,
    ).stdout


@pytest.mark.parametrize(
    "written",
    [str, lambda path: f"{path}/", lambda path: os.path.relpath(path, ROOT)],
    ids=["absolute", "with a slash", "relative"],
)
def test_an_environment_is_kept_and_its_commands_are_found_however_its_folder_is_written(
    tmp_path: Path, written: Callable[[Path], str]
) -> None:
    folder = tmp_path / "environment"
    venv.create(folder, with_pip=False, symlinks=True)
    said = sourced("make_environment; command -v python", VENV=written(folder))
    assert said == f"{folder}/bin/python\n"


def test_an_environment_that_was_moved_is_made_again(tmp_path: Path) -> None:
    venv.create(tmp_path / "old", with_pip=False, symlinks=True)
    (tmp_path / "old").rename(tmp_path / "new")
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    stub = "python=echo; make_environment"
    said = sourced(stub, VENV=str(tmp_path / "new"))
    assert said.startswith(f"Making {tmp_path / 'new'} with Python {version}\n")


@pytest.mark.slow
def test_packages_come_from_where_pip_has_been_told_that_they_are(tmp_path: Path) -> None:
    settings = tmp_path / "pip.conf"
    settings.write_text("[global]\nextra-index-url =\n    https://one/simple\n    file:///two\n")
    told = {"PIP_CONFIG_FILE": str(settings), "PIP_FIND_LINKS": "/wheels"}
    said = sourced("pip_sources", VENV=sys.prefix, **told).splitlines()
    one, two = "--extra-index-url=https://one/simple", "--extra-index-url=file:///two"
    assert {one, two, "--find-links=/wheels"} <= {*said}


def test_without_a_name_the_environment_is_in_the_clone() -> None:
    assert sourced('echo "$VENV"', VENV="").startswith(f"{ROOT}/.venv-3.")


def test_the_demonstration_takes_and_leaves_files_in_the_folder_that_it_is_called_from(
    tmp_path: Path,
) -> None:
    clone, elsewhere, programs = (tmp_path / name for name in ("clone", "elsewhere", "env/bin"))
    for folder in (clone / "scripts", elsewhere, programs):
        folder.mkdir(parents=True)
    for name in ("demo", "environment.sh"):
        shutil.copy(ROOT / "scripts" / name, clone / "scripts")
    with (clone / "scripts" / "environment.sh").open("a") as file:
        file.write("install() { pwd; }\n")
    stub = programs / "rgbd-glue"
    stub.write_text('#!/bin/sh\necho "$PWD" "$@"\n')
    stub.chmod(0o755)
    done = subprocess.run(
        [os.path.relpath(clone / "scripts" / "demo", elsewhere), "my recording"],
        cwd=elsewhere,
        env={**os.environ, "PYTHON": sys.executable, "VENV": str(programs.parent)},
        check=True,
        capture_output=True,
        text=True,
    )
    assert done.stdout.splitlines() == [str(clone), f"{elsewhere} demo my recording"]


def test_the_times_of_features_are_asked_for_with_a_recording() -> None:
    done = subprocess.run(
        [sys.executable, str(ROOT / "scripts" / "feature_times.py")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert done.stderr == "usage: python scripts/feature_times.py RECORDING [NAME...]\n"


@pytest.mark.parametrize(
    ("step", "head"),
    [(1, "Every frame"), (2, "Every 2nd frame"), (3, "Every 3rd frame"), (5, "Every 5th frame")],
)
def test_tables_of_parts_are_headed_by_the_frames_that_were_tracked(step: int, head: str) -> None:
    assert runpy.run_path(str(ROOT / "scripts" / "ablation.py"))["rate"](step) == head
