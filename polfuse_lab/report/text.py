"""Numbers as people read them: as many digits as the uncertainty allows, units apart, true minus signs."""

from __future__ import annotations

import math
from dataclasses import dataclass

MOST_DECIMALS = 9
"""Numbers that would need more are written with powers of ten."""


@dataclass(frozen=True)
class Number:
    """One line of the report's table of numbers."""

    name: str
    value: float
    unit: str = ""
    sd: float | None = None
    """Standard uncertainty (1 sigma), in the same unit; None where none is known."""
    note: str = ""
    """What it is, or what it comes from."""


def value_text(value: float, sd: float | None = None) -> str:
    """A number with its uncertainty to two significant digits, ``"30.78 ± 0.12"``; without one, four digits.

    Whole numbers are written in full. Undefined numbers are an em dash.
    """
    if not math.isfinite(value):
        return "—"
    if sd is None or not math.isfinite(sd) or sd <= 0:
        if value == round(value) and abs(value) < 1e9:
            # Whole numbers in full, in groups of three from five digits on.
            grouped = f"{value:,.0f}".replace(",", "\u202f") if abs(value) >= 1e4 else f"{value:.0f}"
            return _minus(grouped)
        return _minus(f"{value:.4g}")
    digits = max(1 - math.floor(math.log10(sd)), 0)
    if digits > MOST_DECIMALS:
        return f"{_minus(f'{value:.6g}')} ± {_minus(f'{sd:.2g}')}"
    return _minus(f"{value:.{digits}f} ± {sd:.{digits}f}")


def check_texts(value: float, expected: float, tolerance: float) -> tuple[str, str, str]:
    """Value, expected value and tolerance of a check with as many decimals as the tolerance asks for."""
    if not math.isfinite(tolerance) or tolerance <= 0:
        return value_text(value), value_text(expected), value_text(tolerance)
    decimals = max(1 - math.floor(math.log10(tolerance)), 0)
    if decimals > MOST_DECIMALS:
        return value_text(value), value_text(expected), value_text(tolerance)
    return _fixed(value, decimals), _fixed(expected, decimals), _fixed(tolerance, decimals)


def _fixed(number: float, decimals: int) -> str:
    if not math.isfinite(number):
        return "—"
    # Adding 0.0 makes a rounded −0 a plain 0.
    return _minus(f"{round(number, decimals) + 0.0:.{decimals}f}")


def _minus(text: str) -> str:
    if "e" not in text:
        return text.replace("-", "−")
    mantissa, exponent = text.split("e")
    superscript = str(int(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{mantissa} × 10{superscript}".replace("-", "−")


def size_text(count: int) -> str:
    """A number of bytes in kB or MB (powers of ten)."""
    return f"{count / 1e6:.1f} MB" if count >= 1e6 else f"{count / 1e3:.1f} kB"
