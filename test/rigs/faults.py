"""The node under test for faults, and its memory."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

from rgbd_glue_ros.experiments.demo.node_process import NodeProcess, ros_environment
from rigs.paths import ROOT

# Where nothing is compiled yet, on a busy machine.
COMPILE_S = 180.0
# What the allocator keeps or gives back from one moment to the next.
BREATH_MB = 25


@contextmanager
def shown(node: NodeProcess) -> Iterator[NodeProcess]:
    """A node whose log is in the output, which is shown when the test fails."""
    with node:
        try:
            yield node
        finally:
            sys.stdout.write("\n".join(node.lines))


def running_node(
    domain: int, *arguments: str, **parameters: Any
) -> AbstractContextManager[NodeProcess]:
    """A node that may end."""
    return shown(NodeProcess(parameters, ros_environment(domain), arguments))


def rig_environment(domain: int) -> dict[str, str]:
    """The environment of a node that a module beside this one runs."""
    return {**ros_environment(domain), "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'test'}"}


def rig_node(domain: int, module: str, **parameters: Any) -> AbstractContextManager[NodeProcess]:
    """A node that a module beside this one runs; it may end."""
    return shown(NodeProcess(parameters, rig_environment(domain), module=f"rigs.{module}"))


@contextmanager
def healthy(running: AbstractContextManager[NodeProcess]) -> Iterator[NodeProcess]:
    """A node that has to be alive in the end and must not have logged an error of its own."""
    with running as node:
        node.wait_for_line("Subscribed", COMPILE_S)
        yield node
        assert node.is_running
        assert not [line for line in node.lines if "Traceback" in line]


def node_in(domain: int, **parameters: Any) -> AbstractContextManager[NodeProcess]:
    """A healthy node."""
    return healthy(running_node(domain, **parameters))


def rss_mb(node: NodeProcess) -> float:
    """The memory that the node holds now."""
    status = Path(f"/proc/{node.pid}/status").read_text(encoding="ascii")
    found = re.search(r"VmRSS:\s*(\d+) kB", status)
    assert found
    return int(found[1]) / 1024


def cpu_ms(node: NodeProcess) -> float:
    """The time that the node has had of all processors so far."""
    stat = Path(f"/proc/{node.pid}/stat").read_text(encoding="ascii")
    # the name may hold blanks; after it, user and system time are the 12th and 13th field
    user, system = stat.rpartition(")")[2].split()[11:13]
    return 1e3 * (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")
