"""What is printed and written may name anything, and does nothing to who looks at it."""

from __future__ import annotations

import html.parser
import logging
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from rigs.paths import ROOT

from rgbd_glue_ros.cli.main import main
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.experiments.bench.picture import picture
from rgbd_glue_ros.experiments.replay.batch import to_markdown
from rgbd_glue_ros.experiments.report.page import page
from rgbd_glue_ros.printable import printable

HOSTILE = {
    "title and screen": "\x1b]0;gone\x07\x1b[2J",
    "carriage return": "done\r",
    "lines": "a\nrgbd-glue: all is well",
    "direction": "gpj.\u202eexe",
    "no text": os.fsdecode(b"\xff\xfe"),
    "C1": "\x9b31m",
    "bell": "\a",
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_names_that_steer_a_terminal_are_written_out(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = tmp_path / HOSTILE[kind]
    assert main(["evaluate", str(name), str(name)]) == 2
    with pytest.raises(SystemExit):
        main(["evaluate", "a", "b", str(name)])
    for line in capsys.readouterr().err.splitlines():
        assert line.isprintable()
        assert line.startswith("rgbd-glue: ")
    assert str(InputError(name, f"is {name}", "remove it")).isprintable()


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_log_line_is_one_line_whatever_it_names(kind: str, tmp_path: Path) -> None:
    program = (
        "import logging, sys\n"
        "from rgbd_glue_ros.cli import main\n"
        "main.main(['params', 'glue.k'])\n"
        f"logging.getLogger('x').warning('%s is odd', {HOSTILE[kind]!r})\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)
    (line,) = done.stderr.decode().splitlines()
    assert line.isprintable()
    assert line.endswith("is odd")


class _Tags(html.parser.HTMLParser):
    def __init__(self, markup: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.feed(markup)

    def handle_starttag(self, tag: str, _: Any) -> None:
        self.tags.append(tag)


NAME = "a|b\\|<script>alert(1)</script>[x](javascript:y)\x1b[2J\n|c"


def test_names_are_text_in_tables_and_pages() -> None:
    content = {
        "frames": 1,
        "tracked": 1,
        "fps": 1.0,
        "latency_ms": {"p50": 1.0},
    }
    text = to_markdown({"recordings": {NAME: content}, "problems": [NAME]})
    table, problems = text.split("\n\n")
    assert len(table.splitlines()) == 3
    cells = [len(re.findall(r"(?<!\\)(?:\\\\)*\|", line)) for line in table.splitlines()]
    assert len({*cells}) == 1
    assert len(problems.splitlines()) == 1
    assert "<script" not in text
    assert not re.search(r"(?<!\\)(\\\\)*\]\(", text)
    result = {"wall_ms": {"p50": 1.0}, "rpe": {"trans_rmse_m": 0.01}}

    def drawn(name: str) -> str:
        return picture({name: {"contest": {name: result}}}, "ours") or ""

    for made in (drawn, lambda name: page(name, [])):
        assert _Tags(made(NAME)).tags == _Tags(made("desk")).tags
        assert printable(made(NAME), kept="\n") == made(NAME)


def test_what_cannot_be_printed_is_one_line_and_code_2() -> None:
    command = [sys.executable, "-m", "rgbd_glue_ros", "params"]
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert done.stderr.startswith("rgbd-glue: standard output: cannot be written (No space left")


def test_of_a_damaged_image_nothing_is_said_but_our_line(tmp_path: Path) -> None:
    for part in ("rgb", "depth"):
        (tmp_path / part).mkdir()
        path = tmp_path / part / "0.tiff"
        noise = np.random.default_rng(0).integers(0, 9000, (48, 64), np.uint16)
        assert cv2.imwrite(str(path), noise)
        whole = path.read_bytes()
        path.write_bytes(whole[:20] + b"\xff" * 200 + whole[220:])
    (tmp_path / "K.txt").write_text("60 0 31.5\n0 61 23.5\n0 0 1\n")
    command = [sys.executable, "-m", "rgbd_glue_ros", "convert", f"{tmp_path}", f"{tmp_path}/bag"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("rgbd-glue: ")


def test_a_terminal_of_few_characters_gets_escapes() -> None:
    command = [sys.executable, "-m", "rgbd_glue_ros", "params", "glue.k"]
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run(command, capture_output=True, env=environment, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.isascii()


def test_nothing_is_changed_where_all_is_printable() -> None:
    text = "0.3 m ± σ, /camera/color, 日本"
    assert printable(text) is text
    logging.getLogger(__name__).debug(text)


def test_there_is_one_place_that_escapes_html() -> None:
    users = {
        path.name
        for path in (ROOT / "rgbd_glue_ros").rglob("*.py")
        if re.search(r"html\.escape|from html import", path.read_text())
    }
    assert users == {"escaping.py"}
