"""``rgbd-glue``: the command line; the only place that prints and that exits the process."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from io import TextIOWrapper
from pathlib import Path

from rgbd_glue_ros.cli.parser import PROGRAM, complete, parse
from rgbd_glue_ros.errors import BAD_INPUT, IncompleteError, InputError, MissingExtraError
from rgbd_glue_ros.files.writing import not_written
from rgbd_glue_ros.live.end_signals import InterruptOnce
from rgbd_glue_ros.printable import PrintableFormatter, printable

logger = logging.getLogger(__name__)

_PACKAGE = __name__.partition(".")[0]

OK, FAILED = 0, 1
# exit codes of a program ended by SIGINT or SIGPIPE
INTERRUPTED, BROKEN_PIPE = 128 + 2, 128 + 13
# About a damaged image or video the libraries print much more than our one line. OpenCV reads these
# variables when it is loaded.
_QUIET = {"OPENCV_LOG_LEVEL": "SILENT", "OPENCV_FFMPEG_LOGLEVEL": "-8"}


def main(
    arguments: Sequence[str] | None = None, catch_signals: Callable[[], object] = InterruptOnce
) -> int:
    """Runs the program.

    Args:
        arguments: of the command line; None takes the process's.
        catch_signals: installs what handles signals until the command does; without one a kill is
            handled as cleanly as Ctrl-C (results written, the demonstration's node ended).

    Returns:
        The exit code: 2 for bad input, 1 for a failure inside.
    """
    complete()
    _open_closed_streams()
    for variable, value in _QUIET.items():
        os.environ.setdefault(variable, value)
    args = parse(sys.argv[1:] if arguments is None else arguments)
    # characters that the terminal lacks are escaped
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    logging.basicConfig(handlers=[_log()])
    catch_signals()
    try:
        with _informative():
            _print(args.command.module.run(args))
    except (InputError, MissingExtraError) as error:
        if isinstance(error, IncompleteError):
            _print(error.output)
        return _fail(error, str(error), BAD_INPUT, debug=args.debug)
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        _drop_output()
        return BROKEN_PIPE
    except OSError as error:
        # a full disk, a folder without access: not a fault of this program
        text = f"{error.filename or 'a file'}: {error.strerror or error}; give another path"
        return _fail(error, text, BAD_INPUT, debug=args.debug)
    except Exception as error:  # noqa: BLE001 - the user gets one line, not a traceback
        return _failed(error, debug=args.debug)
    return OK


@contextmanager
def _informative() -> Iterator[None]:
    """Logs what this package takes for granted, and not only warnings; libraries stay quiet."""
    package = logging.getLogger(_PACKAGE)
    before = package.level
    package.setLevel(logging.INFO)
    try:
        yield
    finally:
        package.setLevel(before)


def _open_closed_streams() -> None:
    """Substitutes the null device for streams that the process was started without."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_WRONLY), "w"))


def _print(text: str) -> None:
    try:
        sys.stdout.write(printable(text, kept="\n"))
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        _drop_output()
        raise not_written(Path("standard output"), error) from error


def _log() -> logging.Handler:
    handler = logging.StreamHandler()
    handler.setFormatter(PrintableFormatter(f"{PROGRAM}: %(levelname)s: %(message)s"))
    return handler


def _drop_output() -> None:
    """Prevents Python from flushing at exit to a closed output, as in ``| head``."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _failed(error: Exception, *, debug: bool) -> int:
    if isinstance(error.__cause__, KeyboardInterrupt):
        return INTERRUPTED  # inside a library's own code it became a SystemError
    text = f"failure inside: {type(error).__name__}: {error}; --debug shows where"
    return _fail(error, text, FAILED, debug=debug)


def _fail(error: Exception, text: str, code: int, *, debug: bool) -> int:
    if debug:
        logger.error("traceback:", exc_info=error)
    sys.stderr.write(f"{PROGRAM}: {printable(' '.join(text.split()))}\n")
    return code
