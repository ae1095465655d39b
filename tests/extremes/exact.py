"""Functions in sixty digits, as references where float64 might lose its own: Python's decimals and their series."""

from __future__ import annotations

import decimal
from decimal import Decimal

decimal.getcontext().prec = 60
decimal.getcontext().Emin = -999_999
decimal.getcontext().Emax = 999_999

PI = Decimal("3.14159265358979323846264338327950288419716939937510582097494459")


def exact(value: float) -> Decimal:
    """The very number that a float is."""
    return Decimal(float(value))


def cos(angle: Decimal) -> Decimal:
    """Cosine by its series, after whole turns were dropped."""
    x = angle % (2 * PI)
    total = term = Decimal(1)
    for n in range(1, 60):
        term *= -x * x / ((2 * n - 1) * (2 * n))
        total += term
    return total


def sin(angle: Decimal) -> Decimal:
    """Sine, likewise."""
    return cos(angle - PI / 2)


def relative(found: float, true: Decimal) -> float:
    """Error over the true value."""
    return float(abs((exact(found) - true) / true)) if true else abs(found)
