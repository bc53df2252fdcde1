"""Tasks give the same results wherever they are done, and one that breaks down stops no other."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import make_bag
import pytest
from rigs.data_sets import write_data_set

from rgbd_glue_ros.cli import main as cli
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.experiments.batch.workers import Failure, Pool, Serial, pool
from rgbd_glue_ros.experiments.pairs.evaluation import PairResult
from rgbd_glue_ros.experiments.pairs.experiment import GLUE, JOURNAL, Experiment, run_pairs
from rgbd_glue_ros.experiments.pairs.jobs import Results
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.recordings import load_calibration, open_recording

GAP, EVERY = 4, 6


def digits(number: int) -> Iterator[str]:
    """The digits of a number; a minus breaks it down."""
    for character in str(number):
        if character == "-":
            raise ValueError(character)
        yield character


def threads(_: int) -> Iterator[tuple[str | None, int]]:
    import cv2

    yield os.environ.get("OPENBLAS_NUM_THREADS"), cv2.getNumThreads()


def test_in_this_process_items_come_one_by_one_and_a_failure_stops_no_other_task() -> None:
    found = list(Serial().run(digits, [12, -3, 4]))
    assert found == [(12, "1"), (12, "2"), (-3, Failure("ValueError: -")), (4, "4")]
    assert Serial().batch_size(1000) == 1000
    assert Serial().batch_size(0) == 1


def test_workers_are_processes_that_share_the_cores_and_a_failure_stops_no_other_task() -> None:
    pytest.importorskip("distributed")
    with pool(workers=2) as workers:
        found = sorted(workers.run(digits, [12, -3, 4]), key=str)
        assert found == [(-3, Failure("ValueError: -")), (12, "1"), (12, "2"), (4, "4")]
        share = max(1, (os.cpu_count() or 1) // 2)
        ((_, limits),) = workers.run(threads, [0])
        assert limits == (str(share), share)
        assert [workers.batch_size(count) for count in (1, 80, 10_000)] == [1, 10, 20]


def test_without_workers_dask_is_not_even_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pool() as serial:
        assert isinstance(serial, Serial)
    assert cli.main(["pairs", "absent", "-o", "out", "--workers", "2"]) == 2


def test_a_scheduler_that_is_not_there_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("rgbd_glue_ros.experiments.batch.workers._CONNECT_S", 1)
    refused = pytest.raises(InputError, match="no Dask scheduler answers")
    with refused, pool(scheduler="tcp://127.0.0.1:9"):
        pass


# pairs


def pairs_on(where: Pool, folder: Path, on_pair: object = None) -> Experiment:
    experiment = Experiment(Config(), [GAP], EVERY)
    taken = on_pair if callable(on_pair) else lambda _: None
    run_pairs([make_bag.FOLDER], open_recording, experiment, folder, pool=where, on_pair=taken)
    return experiment


def without_times(experiment: Experiment, gap: int = GAP) -> list[str]:
    """Every digit of the results; as text, since NaN is unlike itself."""
    results: list[PairResult] = experiment.results[GLUE][gap]
    return [repr(replace(result, seconds=0.0, stages_ms={})) for result in results]


@pytest.mark.slow
def test_a_killed_worker_changes_no_bit_of_the_results(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    from distributed import Client, LocalCluster

    serial = pairs_on(Serial(), tmp_path / "serial")
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

        parallel = pairs_on(workers, tmp_path / "parallel", kill_one)
        assert killed
        assert killed[0] not in client.run(os.getpid).values()
    assert len(without_times(serial)) > 15
    assert without_times(parallel) == without_times(serial)
    assert parallel.problems == []


def test_a_recording_that_is_damaged_is_reported_on_workers_as_in_this_process(
    tmp_path: Path,
) -> None:
    pytest.importorskip("distributed")
    camera = load_calibration(write_data_set(tmp_path / "poster", 12))
    (tmp_path / "poster/rgb/006.png").write_bytes(b"damaged")
    opener = partial(open_recording, calibration=camera)
    experiments = []
    with pool(workers=1) as workers:
        for where in (Serial(), workers):
            experiment = Experiment(Config(), [2])
            folder = tmp_path / type(where).__name__
            run_pairs([tmp_path / "poster"], opener, experiment, folder, pool=where)
            experiments.append(experiment)
    serial, parallel = experiments
    (problem,) = serial.problems
    assert "006.png" in problem
    assert parallel.problems == serial.problems
    # 0-2, 2-4 and, behind the damaged one, 8-10
    assert len(without_times(serial, 2)) == 3
    assert without_times(parallel, 2) == without_times(serial, 2)


@pytest.mark.slow
def test_a_run_that_broke_off_goes_on_to_the_same_results(tmp_path: Path) -> None:
    whole = pairs_on(Serial(), tmp_path / "whole")
    done: list[Results] = []

    def interrupt(results: Results) -> None:
        done.append(results)
        if len(done) == 5:
            raise KeyboardInterrupt

    folder = tmp_path / "broken"
    with pytest.raises(KeyboardInterrupt):
        pairs_on(Serial(), folder, interrupt)
    journal = folder / JOURNAL
    # killed while it wrote
    journal.write_bytes(journal.read_bytes()[:-9])
    more: list[Results] = []
    resumed = pairs_on(Serial(), folder, more.append)
    assert len(more) == len(without_times(whole)) - 4
    assert without_times(resumed) == without_times(whole)


@pytest.mark.slow
def test_the_command_goes_on_with_a_run_that_another_way_of_working_left(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("distributed")
    config = ["--preset", "live", "--set", "features.geometric=none"]
    arguments = ["pairs", str(make_bag.FOLDER), "--gap", "20", *config, "-o", str(tmp_path)]
    assert cli.main(arguments) == 0
    first = capsys.readouterr().out
    journal = tmp_path / JOURNAL
    lines = journal.read_text().splitlines(keepends=True)
    journal.write_text("".join(lines[:3]))
    assert cli.main([*arguments, "--workers", "1"]) == 0
    assert "going on after 2 pairs" in caplog.text
    assert capsys.readouterr().out.split(";")[:2] == first.split(";")[:2]
