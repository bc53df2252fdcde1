"""Loaded by the processes of our own Dask cluster: none of them serves web pages."""

from __future__ import annotations

from typing import Any


def dask_setup(server: Any) -> None:
    """Stops the HTTP server that a scheduler or a worker has just started.

    Dask has no setting for that, and its pages need no authentication
    (https://docs.dask.org/en/stable/how-to/customize-initialization.html).

    Args:
        server: the ``distributed.Scheduler`` or ``distributed.Worker``.
    """
    server.http_server.stop()
