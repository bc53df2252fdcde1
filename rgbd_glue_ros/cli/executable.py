"""A command as a program of its own, such as ``mapping``."""

from __future__ import annotations

import sys

from rgbd_glue_ros.live.end_signals import end_at_once


def run_executable(command: str) -> int:
    """Runs a node, which a signal ends with exit code 0, also while it is still being loaded.

    Args:
        command: its name on the command line of ``rgbd-glue``.

    Returns:
        The exit code.
    """
    # before the slow import
    end_at_once()
    from rgbd_glue_ros.cli.main import main

    return main([command, *sys.argv[1:]], end_at_once)
