"""From the rig's coordinates to the earth's: WGS 84, in closed form, without any library.

x, y, z of the rig are turned by the heading to east, north, up at the rig's origin, and from there to earth-centred
coordinates (ECEF). Points on the rig's flat ground are not at one height above the curved ellipsoid:
:func:`sagitta_m` tells by how much.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polfuse_lab.rig import Site

Floats = NDArray[np.float64]

SEMI_MAJOR_M = 6_378_137.0
FLATTENING = 1 / 298.257223563
_E2 = FLATTENING * (2 - FLATTENING)


def ecef_of_geodetic(latitude_deg: ArrayLike, longitude_deg: ArrayLike, height_m: ArrayLike) -> Floats:
    """(..., 3) ECEF, m, of geodetic coordinates (...)."""
    lat, lon = np.radians(latitude_deg), np.radians(longitude_deg)
    h = np.asarray(height_m, dtype=np.float64)
    normal = SEMI_MAJOR_M / np.sqrt(1 - _E2 * np.sin(lat) ** 2)
    ring = (normal + h) * np.cos(lat)
    return np.stack(
        np.broadcast_arrays(ring * np.cos(lon), ring * np.sin(lon), (normal * (1 - _E2) + h) * np.sin(lat)), axis=-1
    )


def geodetic_of_ecef(ecef_m: ArrayLike) -> Floats:
    """(..., 3) latitude (degrees), longitude (degrees), height (m) of ECEF points (..., 3) not near the earth's centre.

    Bowring's formula, iterated: heights within 100 km of the ellipsoid are exact to a nanometre.
    """
    x, y, z = np.moveaxis(np.asarray(ecef_m, dtype=np.float64), -1, 0)
    ring = np.hypot(x, y)
    # Of the reduced latitude, from which Bowring's iteration starts and which it improves.
    reduced = np.arctan2(z, ring * (1 - FLATTENING))
    lat = reduced
    for _ in range(3):
        lat = np.arctan2(
            z + _E2 / (1 - _E2) * SEMI_MAJOR_M * (1 - FLATTENING) * np.sin(reduced) ** 3,
            ring - _E2 * SEMI_MAJOR_M * np.cos(reduced) ** 3,
        )
        reduced = np.arctan2((1 - FLATTENING) * np.sin(lat), np.cos(lat))
    sine, cosine = np.sin(lat), np.cos(lat)
    # A projection on the normal, which is as good at the poles as at the equator.
    height = ring * cosine + z * sine - SEMI_MAJOR_M * np.sqrt(1 - _E2 * sine**2)
    return np.stack([np.degrees(lat), np.degrees(np.arctan2(y, x)), height], axis=-1)


@dataclass(frozen=True)
class Placement:
    """A rig on the earth."""

    site: Site

    @property
    def origin_m(self) -> Floats:
        """(3,) ECEF of the rig's origin."""
        return ecef_of_geodetic(self.site.latitude_deg, self.site.longitude_deg, self.site.height_m)

    @property
    def axes(self) -> Floats:
        """(3, 3) unit vectors of the rig's x, y and z in ECEF, as rows."""
        lat, lon = np.radians([self.site.latitude_deg, self.site.longitude_deg])
        east = np.array([-np.sin(lon), np.cos(lon), 0.0])
        up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
        north = np.cross(up, east)
        heading = np.radians(self.site.heading_deg)
        away = np.sin(heading) * east + np.cos(heading) * north
        return np.stack([np.cross(away, up), away, up])

    def ecef(self, points_m: ArrayLike) -> Floats:
        """(..., 3) ECEF of points (..., 3) in the rig's coordinates."""
        return np.asarray(self.origin_m + np.asarray(points_m, dtype=np.float64) @ self.axes)

    def geodetic(self, points_m: ArrayLike) -> Floats:
        """(..., 3) latitude, longitude (degrees) and height (m) of points (..., 3) in the rig's coordinates."""
        return geodetic_of_ecef(self.ecef(points_m))

    def local(self, geodetic: ArrayLike) -> Floats:
        """(..., 3) the rig's coordinates of latitude, longitude (degrees) and height (m) (..., 3)."""
        lat, lon, height = np.moveaxis(np.asarray(geodetic, dtype=np.float64), -1, 0)
        return self.local_of_ecef(ecef_of_geodetic(lat, lon, height))

    def local_of_ecef(self, ecef_m: ArrayLike) -> Floats:
        """(..., 3) the rig's coordinates of ECEF points (..., 3)."""
        return np.asarray((np.asarray(ecef_m, dtype=np.float64) - self.origin_m) @ self.axes.T)


def sagitta_m(distance_m: float) -> float:
    """By how much flat ground departs from the ellipsoid at that distance, m: ``d^2 / 2R``."""
    return distance_m**2 / (2 * SEMI_MAJOR_M)
