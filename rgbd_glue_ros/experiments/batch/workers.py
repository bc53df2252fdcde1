"""Runs many tasks in sequence, on several processes, or on a cluster, with Dask."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any, Protocol, TypeVar

import cv2

from rgbd_glue_ros.errors import InputError, MissingExtraError

logger = logging.getLogger(__name__)

Task = TypeVar("Task")
Item = TypeVar("Item")

_PACKAGE = "rgbd_glue_ros"
_CONNECT_S = 20
_NO_PAGES = f"{_PACKAGE}.experiments.batch.no_pages"
_LARGEST_BATCH = 20
# Processes per core: more take memory, and time to start, without getting a core
_MOST_PER_CORE = 16
_BATCHES_PER_WORKER = 4
# read by BLAS, OpenMP and numba when a worker starts, and by ``_within_threads``
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True)
class Failure:
    """The error of a failed task, in place of its result."""

    error: str


class Pool(Protocol):
    """Executes tasks."""

    def batch_size(self, count: int) -> int:
        """The best number of items per task, at least 1."""

    def run(
        self, function: Callable[[Task], Iterable[Item]], tasks: Sequence[Task]
    ) -> Iterator[tuple[Task, Item | Failure]]:
        """The results of ``function`` for each task, item by item, in any order.

        A task that raises ends in a ``Failure``, after earlier items if these are returned one by
        one; the others continue.
        """


class Serial:
    """Runs in this process, in sequence, returning every item as soon as it is available."""

    def batch_size(self, count: int) -> int:
        """All in one task: common work is then done once."""
        return max(1, count)

    def run(
        self, function: Callable[[Task], Iterable[Item]], tasks: Sequence[Task]
    ) -> Iterator[tuple[Task, Item | Failure]]:
        """The items of each task in order."""
        for task in tasks:
            yield from _items(function, task)


class DaskPool:
    """Runs on a Dask cluster; a worker that dies is replaced, and its task repeated."""

    def __init__(self, client: Any) -> None:
        self._client = client

    @property
    def address(self) -> str:
        """Address of the scheduler."""
        return str(self._client.scheduler.address)

    def batch_size(self, count: int) -> int:
        """Enough to hide the cost of a task, few enough that all workers are busy to the end."""
        workers: int = max(1, sum(self._client.nthreads().values()))
        return max(1, min(_LARGEST_BATCH, count // (_BATCHES_PER_WORKER * workers)))

    def run(
        self, function: Callable[[Task], Iterable[Item]], tasks: Sequence[Task]
    ) -> Iterator[tuple[Task, Item | Failure]]:
        """The items of each task when it is done, in any order of tasks."""
        from distributed import as_completed  # noqa: PLC0415

        futures = {
            self._client.submit(_within_threads, function, task, pure=False): task for task in tasks
        }
        try:
            for future in as_completed(futures):
                task = futures[future]
                error = future.exception()
                if error is None:
                    for item in future.result():
                        yield task, item
                else:
                    yield task, _failure(error)
                # otherwise the scheduler would keep all results until the end
                future.release()
        finally:
            self._client.cancel(list(futures))


@contextmanager
def pool(workers: int | None = None, scheduler: str | None = None) -> Iterator[Pool]:
    """Workers for as long as the context lasts.

    Args:
        workers: processes to start on this machine; the cores are divided among them.
        scheduler: address of a Dask scheduler instead of these. With neither, tasks run in this
            process, without Dask.

    Raises:
        InputError: there is no scheduler at the address, or it has no workers; or there are far
            more workers than cores.
        MissingExtraError: Dask is not installed.
    """
    if scheduler is not None:
        _check_dask()
        with _pool_of_scheduler(scheduler) as there:
            yield there
    elif workers is not None:
        _check_dask()
        with _local_pool(workers) as here:
            yield here
    else:
        yield Serial()


def _check_dask() -> None:
    try:
        import cryptography  # noqa: F401, PLC0415 - for the certificates of local workers
        import distributed  # noqa: F401, PLC0415
    except ImportError as error:
        raise MissingExtraError("Dask", "scale", "working in parallel") from error
    # Dask manages starting, stopping and restarting of workers
    logging.getLogger("distributed").setLevel(logging.CRITICAL)


@contextmanager
def _pool_of_scheduler(address: str) -> Iterator[DaskPool]:
    """The workers of a scheduler that is there.

    Raises:
        InputError: there is no scheduler at the address, or it has no workers of this version.
    """
    from distributed import Client  # noqa: PLC0415

    try:
        client = Client(address, timeout=_CONNECT_S)
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        # Dask's own settings define the certificates (distributed.comm.tls)
        raise InputError(
            address,
            f"no Dask scheduler answers ({error})",
            "start one (dask scheduler), or set distributed.comm.tls for tls://",
        ) from error
    with client:
        if not client.nthreads():
            raise InputError(address, "has no workers", f"start some: dask worker {address}")
        _check_versions(client)
        yield DaskPool(client)


@contextmanager
def _local_pool(workers: int) -> Iterator[DaskPool]:
    """Processes on this machine, among which the cores are divided.

    Raises:
        InputError: there are far more workers than cores.
    """
    import dask  # noqa: PLC0415
    from distributed import Client, LocalCluster  # noqa: PLC0415

    cores = os.cpu_count() or 1
    if workers > _MOST_PER_CORE * cores:
        cause = f"{workers} processes on {cores} cores would only compete for memory"
        raise InputError("--workers", cause, f"give {cores}")
    threads = str(max(1, cores // workers))
    environment = dict.fromkeys(_THREADS, threads)
    # only on this machine, only with the certificates of this run, and without pages
    settings = {
        "distributed.nanny.pre-spawn-environ": environment,
        **{f"distributed.{part}.preload": [_NO_PAGES] for part in ("scheduler", "worker")},
        **{f"distributed.{part}.http.routes": [] for part in ("scheduler", "worker")},
    }
    with (
        _environment_as_before(),
        dask.config.set(settings),
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            host="127.0.0.1",
            security=True,
            dashboard_address="127.0.0.1:0",
            scheduler_kwargs={"dashboard": False},
            silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster) as client,
    ):
        yield DaskPool(client)


@contextmanager
def _environment_as_before() -> Iterator[None]:
    """Undoes Dask's changes to this process's environment when it starts others."""
    before = dict(os.environ)
    try:
        yield
    finally:
        for name in set(os.environ) - set(before):
            del os.environ[name]
        os.environ.update(before)


def _check_versions(client: Any) -> None:
    """Checks that every worker can run this version's tasks; otherwise these would never end.

    Raises:
        InputError: a worker has another version of this package, or none.
    """
    own = version(_PACKAGE)
    # the function is from the standard library, which every worker has
    for address, installed in client.run(version, _PACKAGE, on_error="return").items():
        if isinstance(installed, Exception):
            raise InputError(address, f"has no {_PACKAGE}", f"install version {own} there")
        if installed != own:
            raise InputError(
                address, f"has {_PACKAGE} {installed}, not {own}", "install the same version there"
            )


def _within_threads(function: Callable[[Task], Iterable[Item]], task: Task) -> list[Item]:
    """A task's items, computed with the number of threads that the worker was started for."""
    cv2.setNumThreads(int(os.environ.get(_THREADS[0], "1")))
    return list(function(task))


def _items(
    function: Callable[[Task], Iterable[Item]], task: Task
) -> Iterator[tuple[Task, Item | Failure]]:
    try:
        for item in function(task):
            yield task, item
    except Exception as error:  # noqa: BLE001 - one of thousands must not end the run
        yield task, _failure(error)


def _failure(error: BaseException) -> Failure:
    logger.debug("a task failed", exc_info=error)
    return Failure(f"{type(error).__name__}: {error}")
