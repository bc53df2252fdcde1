"""The node as a separate process, in a ROS domain that nothing else on the machine uses."""

from __future__ import annotations

import ctypes
import fcntl
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.errors import BAD_INPUT, InputError
from rgbd_glue_ros.parameters import PROFILES_VARIABLE, profiles_file

# Higher ones are not usable on every platform, 0 is the default.
DOMAINS = range(1, 102)
# All users can write to the folder of the locks: anything there that is not a file is left alone.
_LOCK_FLAGS = os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
_WARNING = re.compile(r"\[(?:WARN|ERROR)\].*?\]: (?P<text>.*)")
# What the node logs if its input is unusable.
_REFUSAL = re.compile(r"\[FATAL\].*?\]: (?P<cause>.+?); (?P<remedy>.+)")
# Maximum time for the node to end: it finishes the current frame.
STOP_S = 10.0


@contextmanager
def private_domain() -> Iterator[int]:
    """A ROS domain that no other caller uses at the same time.

    Raises:
        InputError: all domains are in use.
    """
    start = os.getpid() % len(DOMAINS)
    for domain in (*DOMAINS[start:], *DOMAINS[:start]):
        path = Path(tempfile.gettempdir()) / f"rgbd_glue_ros_domain_{domain}.lock"
        try:
            lock = os.fdopen(os.open(path, _LOCK_FLAGS, 0o600), "a")
        except OSError:  # another user's lock, or something else in its place
            continue
        with lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield domain
            return
    raise InputError("ROS domains", "all are in use", "end some of the processes that use them")


def ros_environment(domain: int) -> dict[str, str]:
    """Environment variables for ROS processes that communicate only on this machine.

    They have to be set before rclpy is initialised.
    """
    return {
        **shared_environment(),
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        PROFILES_VARIABLE: str(profiles_file()),
    }


def shared_environment() -> dict[str, str]:
    """Environment variables for a ROS process that communicates with others; set ones stay.

    They have to be set before rclpy is loaded.
    """
    return {
        PROFILES_VARIABLE: os.environ.get(PROFILES_VARIABLE, str(profiles_file())),
        # ROS from PyPI does not set it, and without it rclpy finds no resources
        "AMENT_PREFIX_PATH": os.environ.get("AMENT_PREFIX_PATH", sys.prefix),
    }


_libc = ctypes.CDLL(None)
_PR_SET_PDEATHSIG = 1  # <sys/prctl.h>


def _end_with_parent() -> None:
    """Makes a new process receive a signal when its parent dies, however that happens."""
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


class NodeProcess(Closing):
    """A running node; a context manager that ends it.

    Attributes:
        lines: its log so far.
    """

    def __init__(
        self,
        parameters: Mapping[str, object],
        environment: Mapping[str, str] | None = None,
        arguments: Sequence[str] = (),
        module: str = "rgbd_glue_ros.node",
    ) -> None:
        """Starts the node.

        Args:
            parameters: its ROS parameters, by name, as YAML.
            environment: variables besides those of this process.
            arguments: further ROS arguments, as ``-r rgb/image:=/camera/image``.
            module: the module that runs the node.
        """
        settings = [
            word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")
        ]
        self._process = subprocess.Popen(  # noqa: S603 - our own module
            [sys.executable, "-m", module, "--ros-args", *settings, *arguments],
            env={**os.environ, **(environment or {})},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            # otherwise Ctrl-C in a terminal would also reach the node, before its results are
            # collected
            start_new_session=True,
            preexec_fn=_end_with_parent,  # noqa: PLW1509 - it calls the kernel and nothing else
        )
        self.lines: list[str] = []
        self._news = threading.Condition()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def close(self) -> None:
        """Stops the node."""
        self.stop()

    def _read(self) -> None:
        for line in self._process.stdout or ():
            with self._news:
                self.lines.append(line.rstrip("\n"))
                self._news.notify_all()
        with self._news:
            self._news.notify_all()

    @property
    def pid(self) -> int:
        """The process id."""
        return self._process.pid

    @property
    def is_running(self) -> bool:
        """Whether it is still running."""
        return self._process.poll() is None

    @property
    def peak_rss_mb(self) -> float:
        """Its peak memory, in MB; NaN after it has ended."""
        try:
            status = Path(f"/proc/{self.pid}/status").read_text(encoding="ascii")
        except OSError:
            return float("nan")
        peak = re.search(r"VmHWM:\s*(\d+) kB", status)
        return int(peak[1]) / 1024 if peak else float("nan")

    @property
    def last_words(self) -> str:
        """Its exit code, if it has ended, and the last line that it logged."""
        code = self._process.poll()
        ended = "" if code is None else f"exit code {code}, "
        return f"{ended}last line: {self.lines[-1] if self.lines else 'none'}"

    @property
    def last_warning(self) -> str:
        """Its latest warning; "" without one."""
        warnings = self.warnings
        return warnings[-1] if warnings else ""

    @property
    def warnings(self) -> list[str]:
        """All its warnings so far, each text once."""
        found = (_WARNING.search(line) for line in [*self.lines])
        return list(dict.fromkeys(match["text"] for match in found if match))

    def check_refusal(self) -> None:
        """Raises the reason why the node ended, if that was its input.

        Raises:
            InputError: a parameter has a value that it cannot have, or needs what is not installed.
        """
        refusals = [found for line in self.lines if (found := _REFUSAL.search(line))]
        if self._process.poll() == BAD_INPUT and refusals:
            raise InputError("the node", refusals[-1]["cause"], refusals[-1]["remedy"])

    def wait_for_line(self, text: str, timeout_s: float) -> str:
        """The first line that contains ``text``, waiting for it if necessary.

        Raises:
            TimeoutError: it did not appear, or the node ended without it; the message contains the
                log.
        """

        def find() -> str | None:
            return next((line for line in self.lines if text in line), None)

        with self._news:
            self._news.wait_for(lambda: find() or not self._reader.is_alive(), timeout_s)
            line = find()
            if line is None:
                log = "\n".join(self.lines)
                raise TimeoutError(f"the node did not log {text!r} in {timeout_s} s:\n{log}")
            return line

    def wait_for_end(self, timeout_s: float) -> int:
        """The exit code of a node that ends by itself; raises if it does not in time."""
        return self._process.wait(timeout_s)

    def stop(self, how: signal.Signals = signal.SIGINT) -> int:
        """Tells the node to end, and waits for it.

        Returns:
            Its exit code; negative the number of the signal that killed it.
        """
        if self.is_running:
            self._process.send_signal(how)
        try:
            code = self._process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            code = self._process.wait()
        self._reader.join()
        return code
