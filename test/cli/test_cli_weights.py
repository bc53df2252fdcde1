"""``rgbd-glue weights``: real files where they are at hand, and made-up ones."""

from __future__ import annotations

import hashlib
import http.server
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from rigs.disks import full_after

from rgbd_glue_ros.cli.main import OK, main
from rgbd_glue_ros.errors import BAD_INPUT
from rgbd_glue_ros.features import weights
from rgbd_glue_ros.features.weights import FILES

CONTENT = b"what a network learned" * 1000


@pytest.fixture
def published(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder of a server that publishes what the catalogue says is ALIKE."""
    folder = tmp_path / "published"
    folder.mkdir()
    (folder / "alike-t.pth").write_bytes(CONTENT)
    handler = partial(http.server.SimpleHTTPRequestHandler, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        entry = replace(
            FILES["alike_t.pth"],
            url=f"http://127.0.0.1:{server.server_port}/alike-t.pth",
            bytes=len(CONTENT),
            sha256=hashlib.sha256(CONTENT).hexdigest(),
        )
        monkeypatch.setattr(weights, "FILES", {entry.file: entry})
        yield folder
        server.shutdown()


def weights_command(folder: Path, *words: str) -> int:
    return main(["weights", *words, "--folder", str(folder)])


def test_all_files_are_listed_with_licence_and_whether_they_are_here(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "xfeat.pt").touch()
    assert weights_command(tmp_path, "list") == OK
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines()}
    assert lines.keys() == FILES.keys()
    assert "Apache-2.0  here" in lines["xfeat.pt"]
    assert "BSD-3-Clause  not here" in lines["alike_t.pth"]


def test_what_the_authors_publish_is_brought_and_checked(published: Path, tmp_path: Path) -> None:
    folder = tmp_path / "weights"
    assert weights_command(folder, "bring", "alike") == OK
    assert (folder / "alike_t.pth").read_bytes() == CONTENT
    assert [path.name for path in folder.iterdir()] == ["alike_t.pth"]
    assert weights_command(folder, "check") == OK


def test_what_is_not_as_published_is_not_taken(
    published: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (published / "alike-t.pth").write_bytes(CONTENT[:-1] + b"!")
    folder = tmp_path / "weights"
    assert weights_command(folder, "bring", "alike") == BAD_INPUT
    assert "not the published file" in capsys.readouterr().err
    assert not (folder / "alike_t.pth").exists()


@pytest.mark.parametrize(
    ("damaged", "says"),
    [(CONTENT[:-1], "has 21999 of 22000 bytes"), (CONTENT[::-1], "is not the published file")],
)
def test_a_damaged_file_is_told_in_one_line(
    damaged: bytes,
    says: str,
    published: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "alike_t.pth").write_bytes(damaged)
    assert weights_command(tmp_path, "check") == BAD_INPUT
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1


def test_what_has_no_known_checksum_is_not_said_to_be_as_published(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "superpoint_lightglue.pth").write_bytes(CONTENT)
    assert weights_command(tmp_path, "check", "superpoint_lightglue.pth") == OK
    assert "its checksum is not known" in capsys.readouterr().out


def test_a_feature_without_weights_is_told_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert weights_command(tmp_path, "bring", "orb") == BAD_INPUT
    error = capsys.readouterr().err
    assert "orb: has no learned weights; use one of" in error
    assert " alike, " in error


def test_what_only_its_authors_give_out_is_asked_for_and_taken_from_a_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, given = tmp_path / "weights", tmp_path / "given"
    assert weights_command(folder, "bring", "superpoint_superglue") == BAD_INPUT
    error = capsys.readouterr().err
    assert "non-commercial research only" in error
    assert "get it from github.com/magicleap" in error
    assert error.count("\n") == 1
    entry = replace(
        FILES["superpoint_v1.pth"],
        features=("superpoint_superglue",),
        bytes=len(CONTENT),
        sha256=hashlib.sha256(CONTENT).hexdigest(),
    )
    monkeypatch.setattr(weights, "FILES", {entry.file: entry})
    given.mkdir()
    bring = "bring", "superpoint_superglue", "--from", str(given)
    assert weights_command(folder, *bring) == BAD_INPUT
    assert "holds no superpoint_v1.pth" in capsys.readouterr().err
    (given / entry.file).write_bytes(CONTENT)
    assert weights_command(folder, *bring) == OK
    assert "non-commercial research only" in capsys.readouterr().out
    assert (folder / entry.file).read_bytes() == CONTENT


def test_all_that_a_folder_holds_is_brought_from_it_where_nothing_is_named(
    published: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    entry = weights.FILES["alike_t.pth"]
    elsewhere = replace(entry, file="another.pth")
    weights.FILES[elsewhere.file] = elsewhere  # type: ignore[index]
    folder, given = tmp_path / "weights", tmp_path / "given"
    given.mkdir()
    bring = "bring", "--from", str(given)
    assert weights_command(folder, *bring) == BAD_INPUT
    assert "holds no weights file with a known name" in capsys.readouterr().err
    (given / entry.file).write_bytes(CONTENT)
    assert weights_command(folder, *bring) == OK
    assert [path.name for path in folder.iterdir()] == [entry.file]


def test_a_full_disk_is_told_of_the_folder_that_is_full(
    published: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, given = tmp_path / "weights", tmp_path / "given"
    given.mkdir()
    (given / "alike_t.pth").write_bytes(CONTENT)
    with full_after(1000):
        assert weights_command(folder, "bring", "alike", "--from", str(given)) == BAD_INPUT
    error = capsys.readouterr().err
    assert f"{folder}: cannot be written" in error
    assert "free some space" in error
    assert [*folder.iterdir()] == []


def test_a_folder_in_the_place_of_weights_is_told_and_left(
    published: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "alike_t.pth").mkdir()
    assert weights_command(tmp_path, "bring", "alike") == BAD_INPUT
    assert f"{tmp_path / 'alike_t.pth'}: is not a file; remove it" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        ("ERROR: No matching distribution found for a==1\n", "No matching distribution"),
        ("ERROR: Exception:\nTraceback:\n  File\nOSError: No space left on device\n", "No space"),
        ("", "no reason given"),
    ],
)
def test_why_pip_failed_is_told(
    said: str,
    reason: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pip = tmp_path / "python"
    (tmp_path / "said").write_text(said)
    pip.write_text(f"#!/bin/sh\ncat '{tmp_path / 'said'}' >&2\nexit 1\n")
    pip.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(pip))
    assert weights_command(tmp_path / "weights", "bring", "xfeat") == BAD_INPUT
    error = capsys.readouterr().err
    assert reason in error
    assert error.count("\n") == 1
