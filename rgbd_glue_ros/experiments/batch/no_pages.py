"""Loaded by the processes of a Dask cluster of our own: none of them answers a browser."""

from __future__ import annotations

from typing import Any


def dask_setup(server: Any) -> None:
    """Ends the HTTP server that a scheduler or a worker has just begun.

    Dask has no setting for that, and its pages ask nobody who they are
    (https://docs.dask.org/en/stable/how-to/customize-initialization.html).

    Args:
        server: the ``distributed.Scheduler`` or ``distributed.Worker``.
    """
    server.http_server.stop()
