"""A journal loses no result that it took, whatever ends the run, and mixes no two runs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.experiments.batch.journal import Journal

ABOUT = {"parameters": {"glue.k": 3.0}, "methods": ("a", "b")}


def broken_off(path: Path) -> Path:
    """What a run leaves that took two results and did not finish."""
    with Journal(path, ABOUT) as journal:
        journal.add("one", {"x": 0.1})
        journal.add("two", [1, None])
    return path


def test_a_run_that_broke_off_is_gone_on_with(tmp_path: Path) -> None:
    path = broken_off(tmp_path / "journal")
    with Journal(path, ABOUT) as journal:
        assert journal.done == {"one": {"x": 0.1}, "two": [1, None]}
        journal.add("three", 3)
    with Journal(path, ABOUT) as journal:
        assert list(journal.done) == ["one", "two", "three"]
    assert len([json.loads(line) for line in path.read_text().splitlines()]) == 4


def test_a_finished_run_is_replaced_by_the_next_first_result(tmp_path: Path) -> None:
    path = broken_off(tmp_path / "journal")
    with Journal(path, ABOUT) as journal:
        journal.finish()
    content = path.read_text()
    with Journal(path, {"other": 1}) as journal:
        assert journal.done == {}
        assert path.read_text() == content
        journal.add("new", 1)
    with Journal(path, {"other": 1}) as journal:
        assert journal.done == {"new": 1}


def test_without_a_result_there_is_no_file(tmp_path: Path) -> None:
    with Journal(tmp_path / "journal", ABOUT) as journal:
        journal.finish()
    assert list(tmp_path.iterdir()) == []


@given(cut=st.integers(1, 60))
def test_a_line_without_an_end_is_dropped_and_the_file_stays_whole(
    tmp_path_factory: pytest.TempPathFactory, cut: int
) -> None:
    path = broken_off(tmp_path_factory.mktemp("journal") / "journal")
    content = path.read_bytes()
    lines = content.splitlines(keepends=True)
    kept = content[: -min(cut, len(lines[-1]) + len(lines[-2]) - 1)]
    path.write_bytes(kept)
    whole = kept.count(b"\n") - 1
    with Journal(path, ABOUT) as journal:
        assert len(journal.done) == whole
        journal.add("three", 3)
    with Journal(path, ABOUT) as journal:
        assert len(journal.done) == whole + 1


def test_a_run_about_something_else_and_a_file_that_is_no_journal_are_refused(
    tmp_path: Path,
) -> None:
    path = broken_off(tmp_path / "journal")
    with pytest.raises(InputError, match="with other parameters"):
        Journal(path, {"parameters": {"glue.k": 5.0}})
    for content in ("text\n", "{}\n[]\n", '{"a": 1}\n{"b": 2}\n', "", "{"):
        path.write_text(content)
        with pytest.raises(InputError, match="is not a journal"):
            Journal(path, ABOUT)


def test_two_runs_do_not_write_to_one_journal(tmp_path: Path) -> None:
    path = broken_off(tmp_path / "journal")
    with Journal(path, ABOUT) as one, Journal(path, ABOUT) as other:
        one.add("three", 3)
        with pytest.raises(InputError, match="another run is writing"):
            other.add("four", 4)
