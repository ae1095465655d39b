"""The application's own error: one sentence that says what, where and what to do."""

from __future__ import annotations


def first_line(error: BaseException) -> str:
    """What an exception says, without the lines below that are for programmers; its kind where it says nothing."""
    return (str(error).splitlines() or [""])[0] or type(error).__name__


class PolfuseError(Exception):
    """Work that could not be done, in words for the user.

    Args:
        what: what went wrong.
        where: the file, device or command that it went wrong in.
        advice: what the user can do about it.
    """

    def __init__(self, what: str, *, where: str, advice: str) -> None:
        super().__init__(f"{where}: {what}; {advice}")
        self.what = what
        self.where = where
        self.advice = advice
