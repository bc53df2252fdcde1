"""Checks whether the machine has enough shared memory for the DDS profile."""

from __future__ import annotations

import re
from pathlib import Path

SHARED_MEMORY = Path("/dev/shm")  # noqa: S108 - it is where DDS has its memory
# Processes with one segment each: the driver and the node.
_PROCESSES = 2
_SEGMENT = re.compile(r"<segment_size>\s*(\d+)\s*</segment_size>")


def explain_shared_memory(profiles: str, size_bytes: int) -> str | None:
    """A warning that /dev/shm is too small for a DDS profile; None if it is not.

    Args:
        profiles: the XML of the DDS profiles in use; "" for none.
        size_bytes: size of /dev/shm.
    """
    found = _SEGMENT.search(profiles)
    needed = _PROCESSES * int(found[1]) if found else 0
    if size_bytes >= needed:
        return None
    return (
        f"{SHARED_MEMORY} holds {size_bytes / 2**20:.0f} MB, but with the DDS profile each process "
        f"that publishes or receives images needs {needed / _PROCESSES / 2**20:.0f} MB: images "
        "will be sent in pieces over the network and lost. Start the container with "
        "--shm-size=256m, or with --ipc=host"
    )
