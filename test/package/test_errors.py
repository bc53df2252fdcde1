"""Errors arrive in another process as they were raised."""

from __future__ import annotations

import pickle
import re
import shlex

import pytest

from rgbd_glue_ros import errors
from rgbd_glue_ros.errors import InputError, MissingExtraError, install_command


@pytest.mark.parametrize(
    "error",
    [
        InputError("frame 3", "is\ndamaged", "restore it"),
        MissingExtraError("Dask", "scale", "working in parallel"),
    ],
)
def test_an_error_survives_the_way_to_another_process(error: Exception) -> None:
    copy = pickle.loads(pickle.dumps(error))  # noqa: S301 - our own
    assert type(copy) is type(error)
    assert str(copy) == str(error)
    assert vars(copy) == vars(error)


def test_the_command_for_an_extra_names_its_libraries_and_finds_no_package_of_ours() -> None:
    command = install_command("scale")
    assert command.startswith("pip install ")
    projects = [re.split("[^a-z]", word)[0] for word in shlex.split(command)[2:]]
    assert sorted(projects) == ["cryptography", "dask", "distributed"]


def test_a_missing_library_names_the_extra_and_how_large_pytorch_is() -> None:
    said = str(MissingExtraError("torch", "learned", "xfeat"))
    assert "(the extra learned: in a clone pip install -e '.[learned]')" in said
    assert "under 1 GB without: --extra-index-url https://download.pytorch.org/whl/cpu" in said
    assert "whl/cpu" not in str(MissingExtraError("Dask", "scale", "working in parallel"))


def test_a_requirement_keeps_the_machines_that_it_is_for() -> None:
    words = shlex.split(install_command("open3d"))[2:]
    assert all("platform_machine" in word and "extra" not in word for word in words)


def test_without_an_installed_package_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(errors, "_requirements", list)
    assert install_command("slam") == "pip install 'rgbd_glue_ros[slam]'"
