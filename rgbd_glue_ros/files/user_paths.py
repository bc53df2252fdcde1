"""Paths as a user writes them: ``~`` stands for a home folder, and any text is possible."""

from __future__ import annotations

from pathlib import Path

from rgbd_glue_ros.errors import InputError


def expanded(text: str, where: str) -> Path:
    """The path that a text denotes.

    Args:
        text: for example ``~/.ros/map.rgbdmap``.
        where: the parameter or option that it was given to.

    Raises:
        InputError: it begins with the home folder of an unknown user.
    """
    try:
        return Path(text).expanduser()
    except RuntimeError as error:
        home = text.partition("/")[0]
        raise InputError(where, f"{home} has no home folder", "give the whole path") from error


def file_to_write(text: str, where: str) -> Path:
    """The file that a text denotes; its folders are created.

    Raises:
        InputError: it names no file, or the folders cannot be created.
    """
    path = expanded(text, where)
    if not path.name or "\0" in text:
        raise InputError(where, f"{text!r} names no file", "give the path of a file")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        cause = f"the folder of {path} cannot be created ({error.strerror})"
        raise InputError(where, cause, "give another path") from error
    return path
