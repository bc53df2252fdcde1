"""Tasks give the same results wherever they are done, and one that breaks down stops no other."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import make_bag
import pytest
from rigs.bag_frames import write_small_bag
from rigs.data_sets import write_data_set
from rigs.tasks import digits, threads

from rgbd_glue_ros.cli import main as cli
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.experiments.batch.opening import Opening
from rgbd_glue_ros.experiments.batch.workers import DaskPool, Failure, Pool, Serial, pool
from rgbd_glue_ros.experiments.pairs.experiment import Experiment, run_pairs
from rgbd_glue_ros.experiments.pairs.jobs import Results, from_json
from rgbd_glue_ros.experiments.pairs.report import JOURNAL
from rgbd_glue_ros.experiments.pairs.results import GLUE
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.recordings import read_calibration

GAP, EVERY = 4, 6
STRANGE = "0.0.1"


def test_in_this_process_items_come_one_by_one_and_a_failure_stops_no_other_task() -> None:
    found = list(Serial().run(digits, [12, -3, 4]))
    assert found == [(12, "1"), (12, "2"), (-3, Failure("ValueError: -")), (4, "4")]
    assert Serial().batch_size(1000) == 1000
    assert Serial().batch_size(0) == 1


@pytest.mark.slow
def test_workers_are_processes_that_share_the_cores_and_a_failure_stops_no_other_task() -> None:
    pytest.importorskip("distributed")
    environment = dict(os.environ)
    with pool(workers=2) as workers:
        found = sorted(workers.run(digits, [12, -3, 4]), key=str)
        assert found == [(-3, Failure("ValueError: -")), (12, "1"), (12, "2"), (4, "4")]
        share = max(1, (os.cpu_count() or 1) // 2)
        ((_, limits),) = workers.run(threads, [0])
        assert limits == (str(share), share)
        assert [workers.batch_size(count) for count in (1, 80, 10_000)] == [1, 10, 20]
    assert dict(os.environ) == environment


def test_without_workers_dask_is_not_even_looked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pool() as serial:
        assert isinstance(serial, Serial)
    assert cli.main(["pairs", str(make_bag.FOLDER), "-o", str(tmp_path), "--workers", "2"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "Dask is not installed" in line
    assert "working in parallel needs it; run: pip install" in line
    assert "distributed" in line


def test_far_more_workers_than_cores_are_refused_before_one_is_started() -> None:
    pytest.importorskip("distributed")
    with pytest.raises(InputError, match=r"--workers: 100000 processes on .* cores"), pool(100_000):
        pass


def test_a_scheduler_that_is_not_there_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("rgbd_glue_ros.experiments.batch.workers._CONNECT_S", 1)
    refused = pytest.raises(InputError, match="no Dask scheduler answers")
    with refused, pool(scheduler="tcp://127.0.0.1:9"):
        pass


def test_workers_that_do_not_have_this_package_are_refused_by_their_address(
    tmp_path: Path,
) -> None:
    pytest.importorskip("distributed")
    from distributed import LocalCluster

    # a package's version is looked up where its metadata is, and these workers find another's
    metadata = tmp_path / f"rgbd_glue_ros-{STRANGE}.dist-info" / "METADATA"
    metadata.parent.mkdir()
    metadata.write_text(f"Metadata-Version: 2.1\nName: rgbd_glue_ros\nVersion: {STRANGE}\n")
    elsewhere = {**os.environ, "PYTHONPATH": f"{tmp_path}"}
    with LocalCluster(n_workers=0, dashboard_address=None, silence_logs=50) as cluster:
        command = [sys.executable, "-m", "dask", "worker", cluster.scheduler_address, "--no-nanny"]
        worker = subprocess.Popen(
            command,
            env=elsewhere,
            cwd=tmp_path,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.STDOUT,
        )
        try:
            cluster.get_client().wait_for_workers(1, timeout=60)
            refused = pytest.raises(InputError, match=rf"tcp://.+ has rgbd_glue_ros {STRANGE}, not")
            with refused, pool(scheduler=cluster.scheduler_address):
                pass
        finally:
            worker.kill()
            worker.wait()


def test_nobody_without_the_certificates_of_the_run_can_send_work_to_its_workers() -> None:
    distributed = pytest.importorskip("distributed")
    with pool(workers=1) as workers:
        assert isinstance(workers, DaskPool)
        address = workers.address
        assert address.startswith("tls://127.0.0.1:")
        strange = distributed.Security.temporary()
        for other, security in (
            (address, strange),
            (address.replace("tls", "tcp"), distributed.Security()),
        ):
            with pytest.raises(OSError, match=r"."):
                distributed.Client(other, security=security, timeout=2)
        assert list(workers.run(digits, [4])) == [(4, "4")]


def listening_ports() -> set[int]:
    """Of this process and those that it has started."""
    psutil = pytest.importorskip("psutil")
    this = psutil.Process()
    return {
        connection.laddr.port
        for process in [this, *this.children(recursive=True)]
        for connection in process.net_connections()
        if connection.status == psutil.CONN_LISTEN
    }


def test_the_processes_of_a_run_listen_for_certificates_alone_and_answer_no_browser() -> None:
    pytest.importorskip("distributed")
    before = listening_ports()
    with pool(workers=2) as workers:
        assert isinstance(workers, DaskPool)
        started = workers._client.scheduler_info()["workers"]
        addresses = [workers.address, *started, *(w["nanny"] for w in started.values())]
        assert all(address.startswith("tls://127.0.0.1:") for address in addresses)
        ports = {int(address.rpartition(":")[2]) for address in addresses}
        assert listening_ports() - before == ports


def test_certificates_for_a_scheduler_are_those_of_dasks_configuration(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    import dask

    security = distributed.Security.temporary()
    with distributed.LocalCluster(
        n_workers=1, processes=False, security=security, dashboard_address=None, silence_logs=50
    ) as cluster:
        names = ("ca_file", "client_key", "client_cert")
        ca, key, cert = (getattr(security, f"tls_{name}") for name in names)
        settings = {
            "distributed.comm.tls.ca-file": ca,
            "distributed.comm.tls.client.key": key,
            "distributed.comm.tls.client.cert": cert,
        }
        with dask.config.set(settings), pool(None, cluster.scheduler_address) as workers:
            assert list(workers.run(digits, [4])) == [(4, "4")]
        with pytest.raises(InputError, match=r"comm\.tls"), pool(None, cluster.scheduler_address):
            pass


# pairs


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bundled recording in a quarter of its pixels, which show the same."""
    return write_small_bag(tmp_path_factory.mktemp("small") / "bag", make_bag.FRAME_COUNT)


def pairs_on(where: Pool, bag: Path, folder: Path, on_pair: object = None) -> dict[str, Any]:
    experiment = Experiment(Config(), [GAP], EVERY)
    taken = on_pair if callable(on_pair) else lambda _: None
    return run_pairs([bag], Opening(), experiment, folder, pool=where, on_pair=taken)


def without_times(folder: Path) -> list[str]:
    """Every digit of the results that a run left; as text, since NaN is unlike itself."""
    _, *lines = map(json.loads, (folder / JOURNAL).read_text().splitlines())
    results = [from_json(line["result"])[GLUE] for line in lines if "result" in line]
    results.sort(key=lambda result: (result.source, result.target))
    return [repr(replace(result, seconds=0.0, stages_ms={})) for result in results]


@pytest.fixture(scope="module")
def serial_results(bag: Path, tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Those of a run in this process, one pair after the other."""
    folder = tmp_path_factory.mktemp("serial")
    pairs_on(Serial(), bag, folder)
    return without_times(folder)


@pytest.mark.slow
def test_a_killed_worker_changes_no_bit_of_the_results(
    tmp_path: Path, bag: Path, serial_results: list[str]
) -> None:
    pytest.importorskip("distributed")
    from distributed import Client, LocalCluster

    killed: list[int] = []
    with (
        LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
        ) as cluster,
        Client(cluster) as client,
        pool(scheduler=cluster.scheduler_address) as workers,
    ):

        def kill_one(_: Results) -> None:
            if not killed:
                killed.append(next(iter(client.run(os.getpid).values())))
                os.kill(killed[0], signal.SIGKILL)

        parallel = pairs_on(workers, bag, tmp_path / "parallel", kill_one)
        assert killed
        assert killed[0] not in client.run(os.getpid).values()
    assert len(serial_results) > 15
    assert without_times(tmp_path / "parallel") == serial_results
    assert parallel["problems"] == []


@pytest.mark.slow
def test_a_recording_that_is_damaged_is_reported_on_workers_as_in_this_process(
    tmp_path: Path,
) -> None:
    pytest.importorskip("distributed")
    calibration = read_calibration(write_data_set(tmp_path / "poster", 12))
    (tmp_path / "poster/rgb/006.png").write_bytes(b"damaged")
    opener = Opening(calibration=replace(calibration, depth_scale=None))
    sources, experiment = [tmp_path / "poster"], Experiment(Config(), [2])
    serial, parallel = tmp_path / "serial", tmp_path / "parallel"
    here = run_pairs(sources, opener, experiment, serial)
    with pool(workers=1) as workers:
        there = run_pairs(sources, opener, experiment, parallel, pool=workers)
    (problem,) = here["problems"]
    assert "006.png" in problem
    assert there["problems"] == here["problems"]
    # 0-2, 2-4 and, behind the damaged one, 8-10
    assert len(without_times(serial)) == 3
    assert without_times(parallel) == without_times(serial)


@pytest.mark.slow
def test_a_run_that_broke_off_goes_on_to_the_same_results(
    tmp_path: Path, bag: Path, serial_results: list[str]
) -> None:
    done: list[Results] = []

    def interrupt(results: Results) -> None:
        done.append(results)
        if len(done) == 5:
            raise KeyboardInterrupt

    folder = tmp_path / "broken"
    with pytest.raises(KeyboardInterrupt):
        pairs_on(Serial(), bag, folder, interrupt)
    journal = folder / JOURNAL
    # killed while it wrote
    journal.write_bytes(journal.read_bytes()[:-9])
    more: list[Results] = []
    pairs_on(Serial(), bag, folder, more.append)
    assert len(more) == len(serial_results) - 4
    assert without_times(folder) == serial_results


@pytest.mark.slow
def test_the_command_goes_on_with_a_run_that_another_way_of_working_left(
    tmp_path: Path,
    bag: Path,
    caplog: pytest.LogCaptureFixture,
    capsys: pytest.CaptureFixture[str],
) -> None:
    pytest.importorskip("distributed")
    config = ["--preset", "live", "--set", "features.geometric=none"]
    arguments = ["pairs", str(bag), "--gap", "20", *config, "-o", str(tmp_path)]
    assert cli.main(arguments) == 0
    first = capsys.readouterr().out
    journal = tmp_path / JOURNAL
    lines = journal.read_text().splitlines(keepends=True)
    journal.write_text("".join(lines[:3]))
    assert cli.main([*arguments, "--workers", "1"]) == 0
    assert "continuing after 2 pairs" in caplog.text
    assert capsys.readouterr().out.split(";")[:2] == first.split(";")[:2]
