"""What a radar nearer than the far field sees of a reflector, and by how much the closed forms are then wrong.

Nearer than 2 D^2 / lambda the wave that reaches a target is curved: its outer parts answer with another phase than its
middle, and less comes back than the closed forms say. The thesis's targets of 4 ft stood at 3.66 m, where the far
field begins at 23.8 m for their edge.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.calibration.facets import reflector_facets
from processing.calibration.physical_optics import STEP_WAVELENGTHS, Antennas, physical_optics_scattering
from processing.calibration.rcs import far_field_m, to_dbsm
from processing.radar.antenna import boresight
from processing.scene.model import Reflector
from processing.scene.radar_response import reflector_scattering

Floats = NDArray[np.float64]
Matrices = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class NearField:
    """A reflector's apparent scattering as it is and as the far field would have it, both (2, 2) S[rx, tx]."""

    near: Matrices
    """By physical optics at the antennas' true distances, at the image's brightest point, sqrt(m^2)."""
    far: Matrices
    """By the closed form, sqrt(m^2)."""
    far_field_m: float
    """Distance from which the closed form holds: 2 D^2 / lambda with D the largest distance of two corners, m."""
    distance_m: float
    """Of the nearest antenna from the reflector's reference point, m."""
    shift_m: tuple[float, float]
    """From the reference point to the image's brightest point, along the rail and away from it, m."""

    @property
    def correction_db(self) -> Floats:
        """(2, 2) power that comes back over what the closed form says, dB; NaN where the closed form is zero."""
        near, far = np.abs(self.near) ** 2, np.abs(self.far) ** 2
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(to_dbsm(np.where(far > 1e-12 * far.max(), near / far, np.nan)))

    @property
    def is_near(self) -> bool:
        """Whether an antenna is nearer than the far field."""
        return self.distance_m < self.far_field_m


def near_field_scattering(
    reflector: Reflector,
    antenna_m: ArrayLike,
    wavelengths_m: ArrayLike,
    *,
    beamwidth_rad: float | None = None,
    depression_rad: float = 0.0,
    step_wavelengths: float = STEP_WAVELENGTHS,
) -> Matrices:
    """Scattering matrix of a reflector from antenna places at any distance, with the sign of the closed forms.

    The counterpart of :func:`processing.scene.radar_response.reflector_scattering`, which is its limit at long range.

    Args:
        reflector: the reflector.
        antenna_m: (P, 3) places of the antennas, m.
        wavelengths_m: wavelength, or (F,) wavelengths, m.
        beamwidth_rad: half-power beamwidth of one antenna, whose pattern lights the outer parts less; None: isotropic.
        depression_rad: of the antennas' axes below the horizontal, with ``beamwidth_rad``.
        step_wavelengths: edge of the small triangles that are integrated over, wavelengths.

    Returns:
        (P, 2, 2) or (P, F, 2, 2) S[rx, tx], sqrt(m^2).

    Raises:
        DataError: a reflector without flat faces, or an antenna in its reactive field; see
            :func:`processing.calibration.physical_optics.physical_optics_scattering`.
    """
    axes = None if beamwidth_rad is None else boresight(depression_rad)
    antennas = Antennas.at(antenna_m, beamwidth_rad, axes)
    found = physical_optics_scattering(
        reflector_facets(reflector), antennas, wavelengths_m, step_wavelengths=step_wavelengths
    )
    # Closed forms are positive on the axis; a conductor's corner is not.
    return found if reflector.kind == "plate" else -found


def near_field(
    reflector: Reflector,
    antenna_positions: ArrayLike,
    wavelength_m: float,
    weights: ArrayLike | None = None,
    *,
    beamwidth_rad: float | None = None,
    depression_rad: float = 0.0,
) -> NearField:
    """What a focused image shows of a reflector at its brightest point, near field and closed form.

    Focusing makes up for the path to the pixel, so that the pixel of the reference point shows the weighted mean of S
    over the aperture. The near field of a wide target is a blurred spot with its brightest point elsewhere, at most
    half the target's size away; it is looked for among the pixels around, the range cell being taken as much longer.

    Args:
        reflector: the reflector.
        antenna_positions: (P, 3) places of the antennas of the collect, m.
        wavelength_m: wavelength at the centre frequency, m.
        weights: (P,) weights with which the processor sums the positions; equal if left out.
        beamwidth_rad, depression_rad: as in :func:`near_field_scattering`.

    Raises:
        DataError: as in :func:`near_field_scattering`.
    """
    places = np.atleast_2d(np.asarray(antenna_positions, dtype=np.float64))
    share = None if weights is None else np.asarray(weights)
    seen = near_field_scattering(
        reflector, places, wavelength_m, beamwidth_rad=beamwidth_rad, depression_rad=depression_rad
    )
    closed = reflector_scattering(reflector, places, wavelength_m)
    place = np.asarray(reflector.position_m, dtype=np.float64)
    distance = np.linalg.norm(places - place, axis=1)
    largest = reflector_facets(reflector).largest_m
    near, shift = _brightest(seen, places, place, share, wavelength_m, largest / 2)
    return NearField(
        near=near,
        far=np.asarray(np.average(closed, axis=0, weights=share)),
        far_field_m=far_field_m(largest, wavelength_m),
        distance_m=float(distance.min()),
        shift_m=shift,
    )


def _brightest(
    seen: Matrices, places: Floats, place: Floats, weights: Floats | None, wavelength_m: float, radius_m: float
) -> tuple[Matrices, tuple[float, float]]:
    """S (2, 2) of the brightest pixel around a place, and where it is; the pixels' steps lose less than 0.1 dB."""
    share = np.full(len(places), 1 / len(places)) if weights is None else weights / weights.sum()
    distance = np.linalg.norm(places - place, axis=1)
    # The reference point itself is one of the pixels.
    x = np.arange(-np.ceil(8 * radius_m / wavelength_m), 8 * radius_m / wavelength_m + 1) * wavelength_m / 8
    y = np.arange(-np.ceil(2 * radius_m / wavelength_m), 2 * radius_m / wavelength_m + 1) * wavelength_m / 2
    best, found, shift = -1.0, np.zeros((2, 2), dtype=np.complex128), (0.0, 0.0)
    for dy in y:
        pixels = place + np.stack([x, np.full(x.shape, dy), np.zeros(x.shape)], axis=1)
        paths = np.linalg.norm(pixels[:, None] - places[None], axis=2) - distance
        turned = share * np.exp(4j * np.pi / wavelength_m * paths)
        values = np.einsum("xp,pij->xij", turned, seen)
        power = np.max(np.abs(values) ** 2, axis=(1, 2))
        column = int(np.argmax(power))
        if power[column] > best:
            best, found, shift = float(power[column]), values[column], (float(x[column]), float(dy))
    return found, shift
