"""Permittivities of building materials and ground: Recommendation ITU-R P.2040-1 (2015), section 3, table 3.

``e' = a f^b`` and the conductivity ``c f^d`` S/m, f in GHz; the relative permittivity is ``e' - j 17.98 s / f``. Fitted
to measurements from 1 to 100 GHz (glass and wood from 0.1 GHz, ground from 1 to 10 GHz; above it is stretched here).
"""

from __future__ import annotations

from processing.errors import DataError

FITS: dict[str, tuple[float, float, float, float]] = {
    "concrete": (5.31, 0.0, 0.0326, 0.8095),
    "brick": (3.75, 0.0, 0.038, 0.0),
    "plasterboard": (2.94, 0.0, 0.0116, 0.7076),
    "wood": (1.99, 0.0, 0.0047, 1.0718),
    "glass": (6.27, 0.0, 0.0043, 1.1925),
    "very dry ground": (3.0, 0.0, 0.00015, 2.52),
    "medium dry ground": (15.0, -0.1, 0.035, 1.63),
    "wet ground": (30.0, -0.4, 0.15, 1.30),
}
"""a, b, c and d of each material."""


def permittivity(material: str, frequency_hz: float) -> complex:
    """Relative permittivity ``e' - j e''`` of a material of :data:`FITS`.

    Raises:
        DataError: an unknown material or a frequency outside 0.1 to 100 GHz.
    """
    if material not in FITS:
        raise DataError(f"there is no fit for '{material}'", f"use one of {', '.join(FITS)}")
    f = frequency_hz / 1e9
    if not 0.1 <= f <= 100:
        raise DataError(f"permittivities are asked for at {f:g} GHz", "stay between 0.1 and 100 GHz")
    a, b, c, d = FITS[material]
    return complex(a * f**b, -17.98 * c * f**d / f)
