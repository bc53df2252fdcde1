"""``rgbd-glue fetch``: public data sets."""

from __future__ import annotations

import argparse
import logging
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rgbd_glue_ros.cli.arguments import path
from rgbd_glue_ros.errors import InputError

if TYPE_CHECKING:
    from rgbd_glue_ros.recordings.fetch import Source

logger = logging.getLogger(__name__)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Names, and where the data sets go."""
    parser.add_argument(
        "names",
        metavar="NAME",
        nargs="*",
        help="data set, such as tum/fr1_desk; without one, all available are listed",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=path,
        default=Path("data"),
        help="parent of its folder (default: %(default)s)",
    )
    parser.add_argument(
        "--sha256",
        metavar="HEX",
        help="required checksum of the archive; for one NAME",
    )


def run(args: argparse.Namespace) -> str:
    """Downloads and returns where the data sets are, or lists those available."""
    from rgbd_glue_ros.recordings.fetch import CATALOGUE, find

    if not args.names:
        width = max(map(len, CATALOGUE))
        lines = [f"{s.name:<{width}}  {s.licence:<25}  {s.url}\n" for s in CATALOGUE.values()]
        return "".join(lines)
    sources = [find(name) for name in args.names]
    if args.sha256:
        if len(sources) > 1:
            raise InputError("--sha256", "is of one archive", "give one NAME")
        sources = [replace(sources[0], sha256=args.sha256)]
    try:
        return "".join(_fetched(source, args.output) for source in sources)
    except KeyboardInterrupt:
        logger.warning("interrupted; run this again to resume")
        raise


def _fetched(source: Source, folder: Path) -> str:
    from rgbd_glue_ros.cli.progress import bar
    from rgbd_glue_ros.recordings.fetch import fetch

    binary = {"unit_scale": True, "unit_divisor": 1024}
    with (
        bar("B", desc=source.name, **binary) as down,
        bar("B", desc="unpacked", position=1, **binary) as out,
    ):

        def downloaded(there: int, total: int | None) -> None:
            down.total = total
            down.update(there - down.n)

        def unpacked(more: int) -> None:
            out.update(more)

        result = fetch(source, folder, on_download=downloaded, on_unpack=unpacked)
    return (
        f"{result.folder}  from {result.url}\n"
        f"  {result.licence}; {result.bytes} bytes, SHA-256 {result.sha256}\n"
    )
