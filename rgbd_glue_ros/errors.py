"""The errors this package raises on purpose; each says what is wrong, where, and what to do."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import metadata

from rgbd_glue_ros.printable import printable

BAD_INPUT = 2
"""The exit code of a command, or of the node, for unusable input."""

# A damaged or hostile message may contain texts of megabytes, which are quoted in errors.
_LONGEST = 1000


def _readable(text: str) -> str:
    """The text in one printable line, without its middle if it is long."""
    line = printable(" ".join(text.splitlines()))
    half = _LONGEST // 2
    return line if len(line) <= _LONGEST else f"{line[:half]} ... {line[-half:]}"


class InputError(ValueError):
    """Input that cannot be used.

    Attributes:
        where: the file, topic, message field or parameter at fault.
        cause: what is wrong with it.
        remedy: what the user can do about it.
    """

    def __init__(self, where: object, cause: str, remedy: str) -> None:
        self.where = _readable(str(where))
        self.cause = _readable(cause)
        self.remedy = remedy
        super().__init__(f"{self.where}: {self.cause}; {self.remedy}")

    def __reduce__(self) -> tuple[type[InputError], tuple[str, str, str]]:
        # otherwise another process would unpickle it from its message alone, and fail
        return type(self), (self.where, self.cause, self.remedy)


@contextmanager
def located_in(place: object) -> Iterator[None]:
    """Names the file, or another place, whose content is at fault in errors raised meanwhile."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{place}: {error.where}", error.cause, error.remedy) from error


class IncompleteError(InputError):
    """Input of which a part could not be used; there are results of the rest.

    Attributes:
        output: what there is to print about these.
    """

    output = ""


def without_numbers(text: str) -> str:
    """The text with # for each number: faults that differ only in numbers are of one kind."""
    return re.sub(r"\d[\d.]*(e[+-]\d+)?", "#", text)


def install_command(extra: str) -> str:
    """The command that installs an extra, whether the package came from a checkout, wheel or index.

    It names the extra's libraries, since ``package[extra]`` would be searched for in an index.
    """
    clause = f'extra == "{extra}"'
    required = [
        line.replace(f" and {clause}", "").removesuffix(f"; {clause}")
        for line in _requirements()
        if clause in line.replace("'", '"')
    ]
    words = required or [f"{__package__}[{extra}]"]
    return f"pip install {' '.join(map(shlex.quote, words))}"


def _requirements() -> list[str]:
    """What the installed package requires, with its extras; none if it is not installed."""
    try:
        return metadata.requires(__package__ or "") or []
    except metadata.PackageNotFoundError:
        return []


_HINTS = {
    "learned": "; several GB with CUDA, under 1 GB without: "
    "--extra-index-url https://download.pytorch.org/whl/cpu"
}
"""What else to know before an extra is installed."""


class MissingExtraError(ImportError):
    """An optional library is not installed; names the extra that installs it."""

    def __init__(self, library: str, extra: str, purpose: str) -> None:
        super().__init__(
            f"{library} is not installed, but {purpose} needs it; run: {install_command(extra)} "
            f"(the extra {extra}: in a clone pip install -e '.[{extra}]'){_HINTS.get(extra, '')}"
        )
        self.library = library
        self.extra = extra
        self.purpose = purpose

    def __reduce__(self) -> tuple[type[MissingExtraError], tuple[str, str, str]]:
        return type(self), (self.library, self.extra, self.purpose)
