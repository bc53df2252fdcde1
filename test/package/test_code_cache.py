"""Compiled code on disk is whole or not taken, and found where an installation has it."""

from __future__ import annotations

import importlib.util
import logging
import shutil
import stat
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import numba
import pytest

from rgbd_glue_ros import code_cache
from rgbd_glue_ros.code_cache import digest_of_sources

SOURCE = """
from rgbd_glue_ros.compiled import compiled

@compiled
def doubled(x):
    return 2 * x

@compiled
def more(x):
    return doubled(x) + 1
"""

DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda _: b"",
    "cut in half": lambda data: data[: len(data) // 2],
    "without its last byte": lambda data: data[:-1],
    "of zeros": lambda data: bytes(len(data)),
    "with zeros at its end": lambda data: data[: len(data) // 2] + bytes(len(data) // 2),
    "with a turned bit": lambda data: _turned(data, 2 * len(data) // 3),
    "with a turned bit at its start": lambda data: _turned(data, 5),
    "of text": lambda _: b"not what was here",
}


def _turned(data: bytes, at: int) -> bytes:
    return data[:at] + bytes([data[at] ^ 4]) + data[at + 1 :]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Where compiled code is kept, for one test alone."""
    numba.config.reload_config()  # else the first compilation would, if the environment has changed
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    code_cache._say_once.cache_clear()
    yield tmp_path / "cache"
    code_cache._say_once.cache_clear()


@pytest.fixture
def source(tmp_path: Path) -> Path:
    path = tmp_path / "package" / "kernels.py"
    path.parent.mkdir()
    path.write_text(SOURCE)
    return path


def loaded(source: Path) -> ModuleType:
    """The module as a process that starts has it."""
    spec = importlib.util.spec_from_file_location("kernels", source)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def results(module: ModuleType) -> tuple[int, int]:
    return module.doubled(3), module.more(3)


def compilations(module: ModuleType) -> int:
    return sum(sum(f.stats.cache_misses.values()) for f in (module.more, module.doubled))


def files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*.nb?") if path.is_file())


def test_code_that_was_kept_is_not_compiled_again(source: Path, folder: Path) -> None:
    assert loaded(source).more(3) == 7
    assert {path.suffix for path in files(folder)} == {".nbi", ".nbc"}
    module = loaded(source)
    assert module.more(3) == 7
    assert compilations(module) == 0


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_file_of_compiled_code_is_compiled_anew_said_and_mended(
    source: Path, folder: Path, damage: str, caplog: pytest.LogCaptureFixture
) -> None:
    results(loaded(source))
    for path in files(folder):
        path.write_bytes(DAMAGES[damage](path.read_bytes()))
        assert results(loaded(source)) == (6, 7)
        mended = loaded(source)
        assert results(mended) == (6, 7)
        assert compilations(mended) == 0
    assert "is damaged" in caplog.text


def test_a_folder_in_place_of_compiled_code_costs_the_time_to_compile(
    source: Path, folder: Path
) -> None:
    results(loaded(source))
    for path in files(folder):
        path.unlink()
        path.mkdir()
    assert results(loaded(source)) == (6, 7)


def test_where_no_folder_can_be_written_to_code_is_compiled_and_that_is_said(
    source: Path, folder: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    folder.write_text("a file in place of the folder")
    monkeypatch.setenv("HOME", str(folder))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    (source.parent / "__pycache__").write_text("here too")
    assert loaded(source).more(3) == 7
    assert "set NUMBA_CACHE_DIR" in caplog.text
    assert [r.levelno for r in caplog.records] == [logging.WARNING]


def test_code_that_an_installation_brings_is_used_from_another_folder(
    source: Path, folder: Path
) -> None:
    loaded(source).more(3)
    installed = source.parent / "__pycache__"
    installed.mkdir(exist_ok=True)
    for path in files(folder):
        shutil.move(path, installed / path.name)
    installed.chmod(stat.S_IRUSR | stat.S_IXUSR)
    module = loaded(source)
    assert module.more(3) == 7
    assert compilations(module) == 0


def test_a_source_that_is_compiled_changes_the_digest_and_others_do_not(tmp_path: Path) -> None:
    def digest() -> str:
        digest_of_sources.cache_clear()
        return digest_of_sources(tmp_path)

    (tmp_path / "inner").mkdir()
    kernels = tmp_path / "inner" / "kernels.py"
    kernels.write_text(SOURCE)
    before = digest()
    (tmp_path / "plain.py").write_text("x = 1\n")
    assert digest() == before
    kernels.write_text(SOURCE.replace("2 * x", "3 * x"))
    assert digest() != before
    digest_of_sources.cache_clear()
