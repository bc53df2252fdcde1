"""The errors this package raises on purpose; each says what is wrong, where, and what to do."""

from __future__ import annotations


class InputError(ValueError):
    """Input that cannot be used.

    Attributes:
        where: the file, topic, message field or parameter at fault.
        cause: what is wrong with it.
        remedy: what the user can do about it.
    """

    def __init__(self, where: object, cause: str, remedy: str) -> None:
        super().__init__(f"{where}: {cause}; {remedy}")
        self.where = str(where)
        self.cause = cause
        self.remedy = remedy


class MissingExtraError(ImportError):
    """An optional library is not installed; names the extra that brings it."""

    def __init__(self, library: str, extra: str, purpose: str) -> None:
        super().__init__(
            f"{library} is not installed, but {purpose} needs it; "
            f"run: pip install 'rgbd_glue_ros[{extra}]'"
        )
        self.library = library
        self.extra = extra
