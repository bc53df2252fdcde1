"""A cache of machine code on disk that tolerates damaged files and read-only folders.

numba's own cache misreads a file that a power cut left empty, refuses to compile if it finds no
writable folder, and does not notice changes in a function that is inlined into another one.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import pickle
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    _CacheLocator,
)
from numba.core.runtime import rtsys

from rgbd_glue_ros.closing import check_signals

logger = logging.getLogger(__name__)


class CodeCache(FunctionCache):  # type: ignore[misc]
    """Machine code of a function on disk; what cannot be read or written is recompiled.

    Code is searched for where numba keeps it (``NUMBA_CACHE_DIR``, beside the source, in the user's
    cache), and always beside the source: a read-only installation may include it.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._impl_class = _ResultsAnywhere
        super().__init__(function)
        self._cache_file = self._files_in(Path(self._cache_path))
        self._installed = self._files_in(_beside(function))

    def _files_in(self, folder: Path) -> _SealedFiles:
        stamp = digest_of_sources(Path(__file__).parent)
        return _SealedFiles(str(folder), self._impl.filename_base, stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The machine code for a signature; None if there is none that is intact."""
        check_signals()  # compiling everything takes a minute
        # what compiled code calls; refresh() would also import all that numba can compile, which
        # takes a quarter of a second, and which the compiler does itself
        rtsys.initialize(target_context)
        code = self._code_in(self._cache_file, sig, target_context)
        return code or self._code_in(self._installed, sig, target_context)

    def _code_in(self, files: _SealedFiles, sig: Any, target_context: Any) -> Any:
        try:
            data = files.load(self._index_key(sig, target_context.codegen()))
            return None if data is None else self._impl.rebuild(target_context, data)
        except OSError:
            return None  # there is nothing to read
        except Exception as error:  # noqa: BLE001 - what a damaged file makes of reading it
            _say_once(f"Compiled code in {files.folder} is damaged ({error!r}): recompiling")
            files.discard()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Saves machine code, if the disk allows it."""
        try:
            self._save_overload(sig, data)
        except OSError as error:
            _say_once(
                f"Compiled code cannot be cached ({error.strerror}), so each start takes a minute: "
                "set NUMBA_CACHE_DIR to a writable folder"
            )


class _ReadOnly(_CacheLocator):  # type: ignore[misc]
    """The folder beside the source, for reading only: writable folders were tried before."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    @classmethod
    def from_function(cls, function: Callable[..., Any], _source: str) -> _ReadOnly:
        """The locator of a function."""
        return cls(function)

    def get_cache_path(self) -> str:
        """The folder."""
        return str(_beside(self._function))

    def get_source_stamp(self) -> str:
        """A stamp that changes with the source."""
        return digest_of_sources(Path(__file__).parent)

    def get_disambiguator(self) -> str:
        """Distinguishes functions of the same name: by line, as in numba's other locators."""
        return str(self._function.__code__.co_firstlineno)


class _ResultsAnywhere(CompileResultCacheImpl):  # type: ignore[misc]
    """How a compiled function is saved, even if no folder is writable."""

    _locator_classes: ClassVar[list[Any]] = [
        *CompileResultCacheImpl._locator_classes,  # noqa: SLF001 - numba has no other way to them
        _ReadOnly,
    ]


class _SealedFiles(IndexDataCacheFile):  # type: ignore[misc]
    """The files of one function, whose contents show whether they are intact."""

    @property
    def folder(self) -> str:
        """The folder of the files."""
        return str(self._cache_path)

    def _dump(self, obj: object) -> bytes:
        return pickle.dumps(_Sealed(super()._dump(obj)))

    def discard(self) -> None:
        """Discards what was saved, so that it can be replaced."""
        with contextlib.suppress(OSError):  # what remains is found damaged again the next time
            Path(self._index_path).unlink(missing_ok=True)


class _Sealed:
    """Pickled bytes with a digest, which are unpickled only if they are unchanged."""

    def __init__(self, content: bytes) -> None:
        self._content = content

    def __reduce__(self) -> tuple[Callable[[bytes, bytes], object], tuple[bytes, bytes]]:
        return _unsealed, (self._content, hashlib.sha256(self._content).digest())


def _unsealed(content: bytes, digest: bytes) -> object:
    if hashlib.sha256(content).digest() != digest:
        raise ValueError("the contents have changed")
    return pickle.loads(content)  # noqa: S301 - code that runs anyway, from a folder of the user's


@cache
def digest_of_sources(package: Path) -> str:
    """Digest of all compiled sources, since they are inlined into one another."""
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        source = path.read_bytes()
        if b"compiled import" in source:
            digest.update(source)
    return digest.hexdigest()


@cache
def _say_once(text: str) -> None:
    logger.warning(text)


def _beside(function: Callable[..., Any]) -> Path:
    """The folder in which an installation keeps the machine code of a function."""
    return Path(function.__code__.co_filename).parent / "__pycache__"
