"""Shooting and bouncing rays against closed forms, Mie's series and moments, at the thesis's wavelength and sizes."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from benchmarks.dihedral_moments import dihedral_by_moments
from benchmarks.rows import Row
from processing.calibration.canonical import sphere_amplitude
from processing.calibration.rcs import dihedral_amplitude, plate_amplitude, square_trihedral_amplitude
from processing.raytrace import shapes
from processing.raytrace.triangles import Triangles, joined
from processing.scattering.shooting import Density, settle, shoot
from processing.scattering.surfaces import CONDUCTOR, RadarSurface, reflection
from processing.scattering.target import radar_target

EDGE_M, WAVELENGTH_M = 4 * 0.3048, 0.125
"""The thesis's targets (5.5)."""
FAR_M = 1e5
ORIGIN = np.zeros(3)

Error = tuple[float, float]
"""Level in dB and phase in degrees."""


def run(quick: bool) -> list[Row]:
    """All comparisons."""
    tilts = (0.0, 3.0) if quick else (0.0, 1.0, 2.0, 3.0, 4.0)
    folds = (0.0, 30.0) if quick else tuple(range(-40, 41, 5))
    angles = (25, 45, 65) if quick else range(5, 86, 5)
    walls = (30.0,) if quick else (15.0, 30.0, 45.0, 60.0, 75.0)
    media = {"conductor": None, "asphalt": 5 - 0.2j, "moist ground": 11.4 - 3.5j}
    rows = [
        _row("plate off its normal", "closed form", [flat_error(a, b) for a in tilts for b in tilts]),
        _row("two bounces of a dihedral, all elements", "closed form", [e for t in folds for e in fold_error(t)]),
        _row(
            "three bounces of a square trihedral, azimuth by elevation", "thesis 5.5",
            [corner_error(a, e) for a in angles for e in angles],
        ),
        _row("sphere of 0.5 to 1 m", "Mie", [sphere_error(r) for r in ((0.5,) if quick else (0.5, 0.75, 1.0))]),
    ]  # fmt: skip
    for name, medium in media.items():
        errors = [error for wall in walls for error in wall_error(medium, wall)]
        rows.append(_row(f"wall on {name}, HH and VV", "images and Fresnel", errors))
    moments = [moments_error(t) for t in ((0.0, 20.0) if quick else (0.0, 5.0, 10.0, 15.0, 20.0, 30.0))]
    worst = max(map(abs, moments))
    rows.append(
        Row(
            "dihedral with all bounces, E along the fold", "method of moments", None, worst < 0.5, "within 0.5 dB",
            error=f"{worst:.2f} dB",
        )
    )  # fmt: skip
    return rows


def flat_error(azimuth_deg: float, elevation_deg: float) -> Error:
    """A plate of the thesis's size tilted, of all bounces there are."""
    a, e = math.radians(azimuth_deg), math.radians(elevation_deg)
    way = np.array([math.cos(e) * math.sin(a), -math.cos(e) * math.cos(a), math.sin(e)])
    target = radar_target(
        shapes.plate(EDGE_M).turned(shapes.turn_about((1, 0, 0), math.pi / 2)), [CONDUCTOR], WAVELENGTH_M
    )
    found = settle(target, FAR_M * way, ORIGIN, WAVELENGTH_M, tolerance_db=0.05).scattering[0]
    return _error(found[0, 0], complex(plate_amplitude(EDGE_M, EDGE_M, a, e, WAVELENGTH_M)))


def fold_error(tilt_deg: float) -> tuple[Error, Error]:
    """HH and VV of two bounces off a dihedral with a level fold, tilted across it."""
    tilt = math.radians(45 + tilt_deg)
    way = np.array([0.0, math.cos(tilt), math.sin(tilt)])
    found = _bounce(shapes.dihedral(EDGE_M), way, 2)
    expected = complex(dihedral_amplitude(EDGE_M, EDGE_M, 0.0, math.radians(tilt_deg), WAVELENGTH_M))
    # A conductor's sign: see processing.calibration.physical_optics.
    return _error(found[0, 0], -expected), _error(found[1, 1], expected)


def corner_error(azimuth_deg: float, elevation_deg: float) -> Error:
    """HH of three bounces off a square trihedral."""
    a, e = math.radians(azimuth_deg), math.radians(elevation_deg)
    way = np.array([math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)])
    found = _bounce(shapes.trihedral(EDGE_M), way, 3)
    return _error(found[0, 0], -complex(square_trihedral_amplitude(EDGE_M, a, e, WAVELENGTH_M)))


def sphere_error(radius_m: float) -> Error:
    """A conducting sphere; its facets are smaller than a quarter of a wavelength."""
    target = radar_target(shapes.sphere(radius_m, divisions=5), [CONDUCTOR], WAVELENGTH_M)
    place = FAR_M * np.array([0.1, -0.9, 0.3])
    shot = shoot(target, place, ORIGIN, Density(WAVELENGTH_M / 8, 1, 1))
    found = shot.contributions.scattering(place, WAVELENGTH_M, ORIGIN)[0, 0, 0, 0]
    # The series is told with the sign of a plate at the front: from there, not by the curved face's -j.
    return _error(1j * found, sphere_amplitude(radius_m, WAVELENGTH_M))


def wall_error(permittivity: complex | None, depression_deg: float) -> tuple[Error, Error]:
    """HH and VV of two bounces between the ground and a conducting wall upon it.

    By images both ways round fill the wall's height: ``sqrt(4 pi) 2 w h cos(d) / lambda`` times what Fresnel's
    equations say of the ground at the depression d.
    """
    height, width, d = 8 * WAVELENGTH_M, 10 * WAVELENGTH_M, math.radians(depression_deg)
    reach = 1.3 * height / math.tan(d)
    ground = shapes.patch((-width / 2, 0, 0), (width, 0, 0), (0, reach, 0))
    wall = shapes.patch((-width / 2, 0, 0), (width, 0, 0), (0, 0, height), material=1)
    medium = RadarSurface(permittivity)
    target = radar_target(joined([ground, wall]), [medium, CONDUCTOR], WAVELENGTH_M)
    place = FAR_M * np.array([0.0, math.cos(d), math.sin(d)])
    shot = shoot(target, place, ORIGIN, Density(min(width, height) / 32, 5, 2)).contributions
    found = shot.chosen(shot.bounces == 2).scattering(place, WAVELENGTH_M, ORIGIN)[0, 0]
    size = math.sqrt(4 * math.pi) * 2 * width * height * math.cos(d) / WAVELENGTH_M
    s, p = (complex(value) for value in reflection(medium, math.sin(d), WAVELENGTH_M))
    # Off the wall s turns its sign and p does not; a plate's S is counted positive.
    return _error(found[0, 0], size * s), _error(found[1, 1], size * p)


def moments_error(tilt_deg: float) -> float:
    """Level of a dihedral seen with E along its upright fold, all bounces, over that of moments, dB."""
    tilt = math.radians(tilt_deg)
    fold = shapes.dihedral(EDGE_M).turned(shapes.turn_about((1, 0, 0), -math.pi / 4))
    target = radar_target(fold, [CONDUCTOR], WAVELENGTH_M)
    place = FAR_M * np.array([0.0, math.cos(tilt), math.sin(tilt)])
    found = settle(target, place, ORIGIN, WAVELENGTH_M, tolerance_db=0.05).scattering[0, 0, 0]
    exact = dihedral_by_moments(EDGE_M / WAVELENGTH_M, 1e6, tilt)
    # Width of a strip to RCS of a length: 2 L^2 / lambda.
    sigma = 2 * EDGE_M**2 / WAVELENGTH_M * 4 / (2 * np.pi / WAVELENGTH_M) * abs(exact) ** 2
    return 20 * math.log10(abs(found)) - 10 * math.log10(sigma)


def _bounce(mesh: Triangles, way: np.ndarray, bounces: int) -> np.ndarray:
    """S (2, 2) of one number of bounces at long range."""
    target = radar_target(mesh, [CONDUCTOR], WAVELENGTH_M)
    found = shoot(target, FAR_M * way, ORIGIN, Density(EDGE_M / 32, 5, bounces)).contributions
    return np.asarray(found.chosen(found.bounces == bounces).scattering(FAR_M * way, WAVELENGTH_M, ORIGIN)[0, 0])


def _error(found: complex, expected: complex) -> Error:
    ratio = complex(found) / expected
    return 20 * math.log10(abs(ratio)), math.degrees(math.atan2(ratio.imag, ratio.real))


def _row(name: str, peer: str, errors: Iterable[Error]) -> Row:
    level, phase = np.abs(np.array(list(errors))).max(axis=0)
    return Row(
        name, peer, None, bool(level <= 0.3 and phase <= 5), "within 0.3 dB and 5 degrees",
        error=f"{level:.3f} dB, {phase:.2f} degrees",
    )  # fmt: skip
