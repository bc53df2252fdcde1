"""Places that a run writes to beside its results: known to be free and of use before it begins."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from pathlib import Path
from types import MappingProxyType

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.writing import check_writable


def check_places(
    folder: Path,
    results: Collection[str],
    at_end: Mapping[str, Path | None],
    from_start: Mapping[str, Path | None] = MappingProxyType({}),
) -> None:
    """Refuses places where one result would replace another, or that cannot be written.

    Folders of what is written at the end are made; what is there stays as it is.

    Args:
        folder: where the results go.
        results: names of the files in it that the run writes.
        at_end: files that it writes when all else is done, by the option or argument that names
            them; None where it is not given.
        from_start: files and folders that say by themselves whether they can be written.

    Raises:
        InputError: a place is that of a result or of another of these, or no file can be there.
    """
    home = _real(folder)
    own = {home / name for name in results}
    taken: dict[Path, str] = {}
    for option, given in {**at_end, **from_start}.items():
        if given is None:
            continue
        place = _real(given)
        if own & {place, *place.parents}:
            raise InputError(option, f"{given} is a result of this run itself", "give another path")
        if place in (home, *home.parents):
            raise InputError(
                option, f"{given} is a folder of the results", "give a path of its own"
            )
        if place in taken:
            raise InputError(option, f"{given} is that of {taken[place]}, too", "give another path")
        taken[place] = option
    for given in at_end.values():
        if given is not None:
            check_writable(given)


def _real(path: Path) -> Path:
    """Where a path leads; of links that go round in a circle, as far as they lead."""
    return Path(os.path.realpath(path))
