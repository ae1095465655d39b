"""Tolerances by name: how exact a result must be for a look in the field, for work, and for print.

A number of dB is an error below the result, root mean square (amplitudes: 20 log10). The names stand for different
numbers where results cannot be equally exact: focusing adds nothing but its own arithmetic to the data, so that it can
stay below any noise; what is estimated from noisy or missing samples cannot.
"""

from __future__ import annotations

import math

from polfuse_lab.errors import PolfuseError

NAMES = ("preview", "field", "paper")

TOLERANCES_DB = {
    "focus": {"preview": -30.0, "field": -50.0, "paper": -80.0},
    "ranging": {"preview": -20.0, "field": -40.0, "paper": -60.0},
    "arithmetic": {"preview": -60.0, "field": -100.0, "paper": -120.0},
    "picture": {"preview": -20.0, "field": -30.0, "paper": -40.0},
    "estimate": {"preview": -6.0, "field": -12.0, "paper": -16.0},
}
"""What the names mean, by kind of work: deterministic images and profiles, plain arithmetic, pictures that are
interpolated or drawn by chance, and estimates from speckle."""


def tolerance_db(name: str, kind: str = "focus") -> float:
    """The number of dB that a name stands for.

    Raises:
        PolfuseError: an unknown name.
    """
    if name not in NAMES:
        allowed = ", ".join(NAMES)
        raise PolfuseError(f"there is no tolerance {name!r}", where="tolerance", advice=f"choose from {allowed}")
    return TOLERANCES_DB[kind][name]


def as_db(text: str, kind: str = "focus") -> float:
    """A tolerance as users write it: a name, or a negative number of dB.

    Raises:
        PolfuseError: neither.
    """
    try:
        number = float(text)
    except ValueError:
        return tolerance_db(text, kind)
    if not (number < 0 and math.isfinite(number)):
        allowed = ", ".join(NAMES)
        raise PolfuseError(
            f"{text} dB is no error below the result", where="tolerance", advice=f"give a negative number, or {allowed}"
        )
    return number
