"""Options of drivers: frozen dataclasses whose fields carry their limits (``Annotated[float, Gt(0)]``).

The rig file's reader checks the limits line by line; :func:`checked` checks the same limits when a driver is made
directly from Python, so that a wrong value is refused on either road.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from annotated_types import Ge, Gt, Le, Lt

Options = TypeVar("Options")

_LIMITS: tuple[tuple[type, str, Callable[[Any, Any], bool], str], ...] = (
    (Gt, "gt", operator.gt, "greater than"),
    (Ge, "ge", operator.ge, "at least"),
    (Lt, "lt", operator.lt, "less than"),
    (Le, "le", operator.le, "at most"),
)


def checked(options: Options) -> Options:
    """Return ``options`` after checking every field against its limits.

    Args:
        options: instance of a dataclass; limits are ``Gt``, ``Ge``, ``Lt`` and ``Le`` of ``annotated_types``, choices
            are ``Literal``.

    Raises:
        ValueError: a number is not finite or outside its limits, or a choice is none of those allowed; the message
            names the field, what was found and what is allowed.
    """
    for name, hint in get_type_hints(type(options), include_extras=True).items():
        value = getattr(options, name, None)
        if isinstance(value, float) and not math.isfinite(value):
            raise ValueError(f"{name}: found {value}, allowed: a finite number")
        if get_origin(hint) is Literal and value not in get_args(hint):
            raise ValueError(f"{name}: found {value!r}, allowed: {', '.join(map(repr, get_args(hint)))}")
        for limit in getattr(hint, "__metadata__", ()):
            for kind, attribute, holds, words in _LIMITS:
                if isinstance(limit, kind) and not holds(value, getattr(limit, attribute)):
                    raise ValueError(f"{name}: found {value}, allowed: {words} {getattr(limit, attribute)}")
    return options
