"""Fetching: what a server or an archive does wrong is survived or refused, and never unpacked."""

from __future__ import annotations

import hashlib
import io
import json
import stat
import tarfile
import threading
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from rigs.disks import full_after

from rgbd_glue_ros.cli import main as cli
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.recordings.fetch import CATALOGUE, Source, fetch, find
from rgbd_glue_ros.recordings.fetch.archive import unpack
from rgbd_glue_ros.recordings.fetch.download import download
from rgbd_glue_ros.recordings.fetch.fetch import RECORD

# not compressible, so that its archive is large enough to break off in
CONTENT = b"".join(hashlib.sha256(bytes([i])).digest() for i in range(250)) * 4


# a server that behaves as it is told


@dataclass
class Server:
    """Serves one file; every request takes the next behaviour, the last one for ever.

    Attributes:
        content: of the file.
        behaviours: what to do with each request.
        etag: of the file, None for none.
        requests: the Range header of every request.
    """

    content: bytes = CONTENT
    behaviours: list[Callable[[Server, BaseHTTPRequestHandler], None]] = field(default_factory=list)
    etag: str | None = '"1"'
    requests: list[str | None] = field(default_factory=list)
    url: str = ""

    def answer(self, request: BaseHTTPRequestHandler) -> None:
        self.requests.append(request.headers["Range"])
        behaviour = self.behaviours.pop(0) if self.behaviours else well
        behaviour(self, request)


def start_of(server: Server, request: BaseHTTPRequestHandler) -> int:
    """Where the answer begins; a changed file is sent from the beginning."""
    wanted = request.headers["Range"]
    if wanted is None or request.headers["If-Range"] != server.etag:
        return 0
    return int(wanted.removeprefix("bytes=").rstrip("-"))


def head(server: Server, request: BaseHTTPRequestHandler, start: int, length: int | None) -> None:
    request.send_response(206 if start else 200)
    if start:
        last = len(server.content) - 1
        request.send_header("Content-Range", f"bytes {start}-{last}/{len(server.content)}")
    if length is not None:
        request.send_header("Content-Length", str(length))
    if server.etag is not None:
        request.send_header("ETag", server.etag)
    request.end_headers()


def well(server: Server, request: BaseHTTPRequestHandler) -> None:
    start = start_of(server, request)
    head(server, request, start, len(server.content) - start)
    request.wfile.write(server.content[start:])


def breaks_off_after(count: int) -> Callable[[Server, BaseHTTPRequestHandler], None]:
    def behave(server: Server, request: BaseHTTPRequestHandler) -> None:
        start = start_of(server, request)
        head(server, request, start, len(server.content) - start)
        request.wfile.write(server.content[start : start + count])

    return behave


def claims(length: int | None) -> Callable[[Server, BaseHTTPRequestHandler], None]:
    def behave(server: Server, request: BaseHTTPRequestHandler) -> None:
        head(server, request, 0, length)
        request.wfile.write(server.content)

    return behave


def fails(code: int) -> Callable[[Server, BaseHTTPRequestHandler], None]:
    def behave(_: Server, request: BaseHTTPRequestHandler) -> None:
        request.send_error(code)

    return behave


def answers_another_part(server: Server, request: BaseHTTPRequestHandler) -> None:
    request.send_response(206)
    request.send_header("Content-Range", f"bytes 0-9/{len(server.content)}")
    request.send_header("Content-Length", "10")
    request.end_headers()
    request.wfile.write(server.content[:10])


@contextmanager
def serving(server: Server) -> Iterator[Server]:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            server.answer(self)

        def log_message(self, format: str, *args: Any) -> None: ...  # noqa: A002

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as http:
        threading.Thread(target=http.serve_forever, args=(0.02,), daemon=True).start()
        server.url = f"http://127.0.0.1:{http.server_port}/set.tgz"
        try:
            yield server
        finally:
            http.shutdown()


def downloaded(server: Server, folder: Path, **options: Any) -> bytes:
    target = folder / "file"
    download(server.url, target, pause_s=0, **options)
    assert {path.name for path in folder.iterdir()} == {"file"}
    return target.read_bytes()


# downloads


def test_a_download_is_complete_and_tells_of_its_progress(tmp_path: Path) -> None:
    seen: list[tuple[int, int | None]] = []
    with serving(Server()) as server:
        content = downloaded(server, tmp_path, on_progress=lambda n, total: seen.append((n, total)))
    assert content == CONTENT
    assert seen[-1] == (len(CONTENT), len(CONTENT))


def test_a_download_goes_on_where_it_was_broken_off(tmp_path: Path) -> None:
    with serving(Server(behaviours=[breaks_off_after(1000), breaks_off_after(500)])) as server:
        assert downloaded(server, tmp_path) == CONTENT
        assert server.requests == [None, "bytes=1000-", "bytes=1500-"]


def test_a_later_run_goes_on_with_what_an_earlier_one_left(tmp_path: Path) -> None:
    with serving(Server()) as server:
        server.behaviours = [breaks_off_after(1000), *[breaks_off_after(0)] * 4]
        with pytest.raises(InputError, match=r"stopped after 1000 bytes .*run this again"):
            download(server.url, tmp_path / "file", pause_s=0)
        server.requests.clear()
        assert downloaded(server, tmp_path) == CONTENT
        assert server.requests == ["bytes=1000-"]


def test_a_file_that_changed_meanwhile_is_downloaded_from_the_beginning(tmp_path: Path) -> None:
    def changes(server: Server, request: BaseHTTPRequestHandler) -> None:
        breaks_off_after(1000)(server, request)
        server.content, server.etag = CONTENT[::-1], '"2"'

    with serving(Server(behaviours=[changes])) as server:
        assert downloaded(server, tmp_path) == CONTENT[::-1]


@pytest.mark.parametrize("etag", [None, 'W/"1"'])
def test_without_a_word_that_it_is_the_same_nothing_is_gone_on_with(
    tmp_path: Path, etag: str | None
) -> None:
    with serving(Server(behaviours=[breaks_off_after(1000)], etag=etag)) as server:
        assert downloaded(server, tmp_path) == CONTENT
        assert server.requests == [None, None]


def test_an_answer_with_another_part_is_not_put_in_its_place(tmp_path: Path) -> None:
    behaviours = [breaks_off_after(1000), answers_another_part]
    with serving(Server(behaviours=behaviours)) as server:
        assert downloaded(server, tmp_path) == CONTENT
        assert server.requests == [None, "bytes=1000-", None]


def test_a_server_that_is_busy_is_asked_again_and_one_that_refuses_is_not(tmp_path: Path) -> None:
    with serving(Server(behaviours=[fails(503), fails(429)])) as server:
        assert downloaded(server, tmp_path) == CONTENT
    with serving(Server(behaviours=[fails(404)])) as server:
        with pytest.raises(InputError, match="404"):
            download(server.url, tmp_path / "other", pause_s=0)
        assert len(server.requests) == 1


def test_a_server_that_claims_more_than_it_sends_is_given_up(tmp_path: Path) -> None:
    refused = pytest.raises(InputError, match=f"stopped after {len(CONTENT)} bytes")
    with serving(Server(behaviours=[claims(len(CONTENT) + 5)] * 9)) as server, refused:
        download(server.url, tmp_path / "file", pause_s=0)
    assert not (tmp_path / "file").exists()


def test_a_file_larger_than_the_limit_is_refused_whatever_is_claimed(tmp_path: Path) -> None:
    for length in (len(CONTENT), None):
        refused = pytest.raises(InputError, match="more than 5000")
        with serving(Server(behaviours=[claims(length)])) as server, refused:
            download(server.url, tmp_path / "file", limit=5000, pause_s=0)
        assert (tmp_path / "file.part").stat().st_size == 0


def test_a_file_that_does_not_fit_on_the_disk_is_refused_before_it_is_sent(tmp_path: Path) -> None:
    refused = pytest.raises(InputError, match="bytes free")
    with serving(Server(behaviours=[claims(2**60)])) as server, refused:
        download(server.url, tmp_path / "file", limit=2**61, pause_s=0)


def test_a_server_that_is_not_there_is_named(tmp_path: Path) -> None:
    with serving(Server()) as server:
        url = server.url
    with pytest.raises(InputError, match=url):
        download(url, tmp_path / "file", pause_s=0)


# archives


def tar_of(*members: tuple[tarfile.TarInfo, bytes]) -> bytes:
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w:gz") as tar:
        for member, content in members:
            member.size = len(content)
            tar.addfile(member, io.BytesIO(content))
    return buffer.getvalue()


def plain(name: str) -> tarfile.TarInfo:
    return tarfile.TarInfo(name)


def special(kind: bytes, target: str = "") -> tarfile.TarInfo:
    member = tarfile.TarInfo("special")
    member.type, member.linkname = kind, target
    return member


def long_name(length: int) -> tarfile.TarInfo:
    return tarfile.TarInfo("/".join(["a" * 99] * (length // 100)))


def zip_of(members: dict[str, bytes], mode: int = 0) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as zipped:
        for name, content in members.items():
            info = zipfile.ZipInfo(name)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = mode << 16
            zipped.writestr(info, content)
    return buffer.getvalue()


def written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def test_files_and_folders_are_unpacked_and_archives_of_sequences_too(tmp_path: Path) -> None:
    sequence = zip_of({"seq-01/frame.txt": b"frame"})
    scene = zip_of({"heads/seq-01.zip": sequence, "heads/readme.txt": b"text", "heads/empty/": b""})
    unpack(written(tmp_path / "heads.zip", scene), tmp_path / "out")
    files = {str(p.relative_to(tmp_path / "out")): p for p in (tmp_path / "out").rglob("*")}
    assert set(files) == {
        *("heads", "heads/empty", "heads/readme.txt"),
        *("heads/seq-01", "heads/seq-01/frame.txt"),
    }
    assert files["heads/seq-01/frame.txt"].read_bytes() == b"frame"


# made by the test that wants one, as all tests are collected by each process
HOSTILE: dict[str, Callable[[], bytes]] = {
    "above.tgz": lambda: tar_of((plain("../above.txt"), b"x")),
    "absolute.tgz": lambda: tar_of((plain("/tmp/absolute.txt"), b"x")),  # noqa: S108
    "hidden.tgz": lambda: tar_of((plain("a/../../above.txt"), b"x")),
    "symlink.tgz": lambda: tar_of(
        (special(tarfile.SYMTYPE, "/etc"), b""), (plain("special/x"), b"x")
    ),
    "hardlink.tgz": lambda: tar_of((special(tarfile.LNKTYPE, "/etc/passwd"), b"")),
    "device.tgz": lambda: tar_of((special(tarfile.CHRTYPE), b"")),
    "pipe.tgz": lambda: tar_of((special(tarfile.FIFOTYPE), b"")),
    "twice.tgz": lambda: tar_of((plain("a"), b"x"), (plain("a"), b"y")),
    "file_as_folder.tgz": lambda: tar_of((plain("a"), b"x"), (plain("a/b"), b"y")),
    "bomb.tgz": lambda: tar_of((plain("bomb"), bytes(2**25))),
    "above.zip": lambda: zip_of({"../above.txt": b"x"}),
    "absolute.zip": lambda: zip_of({"/above.txt": b"x"}),
    "backslash.zip": lambda: zip_of({"..\\above.txt": b"x"}),
    "symlink.zip": lambda: zip_of({"link": b"/etc/passwd"}, stat.S_IFLNK | 0o777),
    "bomb.zip": lambda: zip_of({"bomb": bytes(2**25)}),
    "inner_bomb.zip": lambda: zip_of({"inner.zip": zip_of({"bomb": bytes(2**25)})}),
    "inner_above.zip": lambda: zip_of({"a/inner.zip": zip_of({"../../above.txt": b"x"})}),
    "many_inner_bombs.zip": lambda: zip_of(
        {f"{i}.zip": zip_of({f"bomb{i}": bytes(2**22)}) for i in range(8)}
    ),
    "many_folders.zip": lambda: zip_of({f"{i}/" + "a/" * 30_000: b"" for i in range(34)}),
    "long_name.tgz": lambda: tar_of((long_name(2**21), b"x")),
    "name_too_long.zip": lambda: zip_of({"a" * 300: b"x"}),
    "zero.zip": lambda: zip_of({"a": b"x"}).replace(b"a", b"\0"),
    "no_zip.zip": lambda: b"nonsense",
    "no_tar.tgz": lambda: b"nonsense",
    "page.tgz": lambda: b"<html>please log in</html>",
    "cut_off.tgz": lambda: tar_of((plain("a"), CONTENT))[:-9000],
    "cut_off.zip": lambda: zip_of({"a": CONTENT})[:-9000],
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_or_damaged_archive_is_refused_and_nothing_is_outside(
    tmp_path: Path, name: str
) -> None:
    archive = written(tmp_path / name, HOSTILE[name]())
    (tmp_path / "in").mkdir()
    with pytest.raises(InputError, match="do not trust it") as error:
        unpack(archive, tmp_path / "in" / "out")
    assert len(str(error.value).splitlines()) == 1
    assert {p.name for p in tmp_path.iterdir()} == {name, "in"}
    assert {p.name for p in (tmp_path / "in").iterdir()} == {"out"}
    assert not any(p.is_symlink() for p in tmp_path.rglob("*"))


@pytest.mark.parametrize("suffix", [".tgz", ".zip"])
def test_a_byte_that_is_wrong_is_found_by_the_archives_own_checksum(
    tmp_path: Path, suffix: str
) -> None:
    content = tar_of((plain("a"), CONTENT)) if suffix == ".tgz" else zip_of({"a": CONTENT})
    damaged = bytearray(content)
    damaged[len(damaged) // 2] ^= 0x10
    with pytest.raises(InputError, match="damaged"):
        unpack(written(tmp_path / f"a{suffix}", bytes(damaged)), tmp_path / "out")


# both


def source(server: Server, sha256: str | None = None) -> Source:
    return Source("set", server.url, "desk", "free", sha256)


SET = tar_of((plain("rgbd/rgb.txt"), b"list"), (plain("rgbd/rgb/0.png"), CONTENT))


def test_a_fetched_set_is_one_folder_with_a_record_of_where_it_is_from(tmp_path: Path) -> None:
    with serving(Server(SET)) as server:
        result = fetch(source(server), tmp_path / "data", pause_s=0)
    folder = tmp_path / "data" / "desk"
    assert result.folder == folder
    assert (folder / "rgb/0.png").read_bytes() == CONTENT
    assert [path.name for path in (tmp_path / "data").iterdir()] == ["desk"]
    record = json.loads((folder / RECORD).read_text())
    assert record == {
        "url": server.url,
        "licence": "free",
        "bytes": len(SET),
        "sha256": hashlib.sha256(SET).hexdigest(),
    }
    with pytest.raises(InputError, match="already exists"):
        fetch(source(server), tmp_path / "data")


def test_a_download_with_another_checksum_is_refused_and_removed(tmp_path: Path) -> None:
    right = hashlib.sha256(SET).hexdigest().upper()
    with serving(Server(SET)) as server:
        with pytest.raises(InputError, match=f"has the SHA-256 {right.lower()}, not 00"):
            fetch(source(server, "00"), tmp_path, pause_s=0)
        assert list(tmp_path.iterdir()) == []
        assert fetch(source(server, right), tmp_path, pause_s=0).folder.is_dir()


def test_nothing_of_a_bad_archive_is_left_and_the_next_run_starts_over(tmp_path: Path) -> None:
    with serving(Server(HOSTILE["above.tgz"]())) as server:
        with pytest.raises(InputError, match="outside its folder"):
            fetch(source(server), tmp_path, pause_s=0)
        assert list(tmp_path.iterdir()) == []
        server.content = SET
        assert fetch(source(server), tmp_path, pause_s=0).folder.is_dir()


def test_a_disk_that_is_full_at_the_record_keeps_the_archive(tmp_path: Path) -> None:
    """It is intact, and need not be downloaded again."""
    small = written(tmp_path / "set.tgz", tar_of((plain("rgbd/rgb.txt"), b"list")))
    with serving(Server()) as server:
        with full_after(50), pytest.raises(InputError, match="free some space"):
            fetch(source(server), tmp_path, pause_s=0)
        assert list(tmp_path.iterdir()) == [small]
        fetch(source(server), tmp_path, pause_s=0)
        assert server.requests == []
    assert [path.name for path in tmp_path.iterdir()] == ["desk"]


def test_an_interrupted_unpacking_keeps_the_archive_and_shows_no_half_folder(
    tmp_path: Path,
) -> None:
    def interrupt(_: int) -> None:
        raise KeyboardInterrupt

    with serving(Server(SET)) as server:
        with pytest.raises(KeyboardInterrupt):
            fetch(source(server), tmp_path, on_unpack=interrupt, pause_s=0)
        assert [path.name for path in tmp_path.iterdir()] == ["set.tgz"]
        fetch(source(server), tmp_path, pause_s=0)
        assert len(server.requests) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["desk"]


def test_names_lead_to_encrypted_addresses_and_wrong_ones_to_similar_names() -> None:
    assert all(entry.url.startswith("https://") for entry in CATALOGUE.values())
    assert len({entry.folder for entry in CATALOGUE.values()}) == len(CATALOGUE)
    assert find("tum/fr1_desk").folder == "rgbd_dataset_freiburg1_desk"
    with pytest.raises(InputError, match="tum/fr1_desk"):
        find("fr1_desk")


def test_the_command_lists_what_there_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["fetch"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(CATALOGUE)
    assert lines[0].split()[0] in CATALOGUE


def test_the_command_fetches_and_says_what(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with serving(Server(SET)) as server:
        monkeypatch.setattr(
            "rgbd_glue_ros.recordings.fetch.catalogue.CATALOGUE", {"set": source(server)}
        )
        assert cli.main(["fetch", "set", "-o", str(tmp_path / "data")]) == 0
    assert hashlib.sha256(SET).hexdigest() in capsys.readouterr().out
    assert cli.main(["fetch", "tum/fr1_desk", "tum/fr1_xyz", "--sha256", "00"]) == 2
