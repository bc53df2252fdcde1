"""The footer of a page: software, date, machine and command."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import Any

from rgbd_glue_ros.experiments.report.escaping import escape
from rgbd_glue_ros.experiments.report.machine import machine


@dataclass(frozen=True)
class Colophon:
    """The origin of a result.

    Attributes:
        version: of this package.
        date: of the page, with its zone.
        machine: processor, memory and system.
        command: the command line; "" if it was started by a program.
        source: what it is about.
    """

    version: str
    date: str
    machine: str
    command: str
    source: str

    @staticmethod
    def now(command: str, source: str) -> Colophon:
        """The colophon for a result made now, on this machine."""
        about = machine()
        return Colophon(
            about["versions"].get("rgbd_glue_ros", "(not installed)"),
            f"{datetime.now(timezone.utc):%Y-%m-%d %H:%M} UTC",
            machine_text(about),
            command,
            source,
        )

    def __str__(self) -> str:
        made = f"rgbd_glue_ros {self.version}, {self.date}, on {self.machine}."
        command = f"<br><code>{escape(self.command)}</code>" if self.command else ""
        return f"<footer>{escape(self.source)}: {escape(made)}{command}</footer>"


def machine_text(about: Mapping[str, Any]) -> str:
    """A machine in one line, from the result of ``machine``."""
    return (
        f"{about['cores']} cores of {about['processor']}, {about['memory_gb']} GB, "
        f"{about['system']}, Python {about['python']}"
    )
