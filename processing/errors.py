"""Errors of the numerics."""

from __future__ import annotations


class DataError(ValueError):
    """The data do not allow what was asked: what is wrong with them, and what to do.

    ``str(error)`` is one sentence for the user.
    """

    def __init__(self, what: str, advice: str) -> None:
        super().__init__(f"{what}; {advice}")
        self.what = what
        self.advice = advice
