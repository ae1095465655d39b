"""Errors of the numerics, and what is none."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import numpy as np

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


class DataError(ValueError):
    """The data do not allow what was asked: what is wrong with them, and what to do.

    ``str(error)`` is one sentence for the user.
    """

    def __init__(self, what: str, advice: str) -> None:
        super().__init__(f"{what}; {advice}")
        self.what = what
        self.advice = advice


def undefined_is_nan(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """For functions in which undefined values come in and go out as NaN: NumPy does not warn of them on the way."""

    @functools.wraps(function)
    def quiet(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return function(*args, **kwargs)

    return quiet
