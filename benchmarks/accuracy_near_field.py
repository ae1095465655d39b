"""RCS of calibration targets by physical optics: against closed forms and moments, and at the thesis's distance."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.special import fresnel

from benchmarks.dihedral_moments import dihedral_by_moments
from benchmarks.rows import Row
from processing.calibration.facets import FacetTarget, dihedral_facets, plate_facets, trihedral_facets
from processing.calibration.near_field import NearField, near_field
from processing.calibration.physical_optics import Antennas, physical_optics_scattering
from processing.calibration.rcs import (
    dihedral_amplitude,
    plate_amplitude,
    square_trihedral_amplitude,
    triangular_trihedral_amplitude,
)
from processing.scene.model import Reflector

Amplitude = Callable[[float, float], Any]

FOOT_M = 0.3048
EDGE_M, RANGE_M, WAVELENGTH_M = 4 * FOOT_M, 12 * FOOT_M, 0.125
"""The thesis's targets (5.5)."""
THESIS_DB = 31.05 - 30.78
"""What the thesis measured: dihedral over trihedral, HH."""
BEAMWIDTH_RAD = math.radians(70)
ANGLE_ERROR_DEG = 5.0
"""How well the thesis knew its angles (5.16)."""


def run(quick: bool) -> list[Row]:
    """All comparisons."""
    return [*_closed_forms(quick), *_moments(quick), *_thesis(quick)]


def _closed_forms(quick: bool) -> list[Row]:
    """Largest deviation at long range within 20 dB of each target's maximum (triple or double bounce alone)."""
    grid = np.radians(np.linspace(5, 85, 5 if quick else 9))
    tilts = np.radians(np.linspace(-40, 40, 5 if quick else 9))
    square, triangle = trihedral_facets(EDGE_M), trihedral_facets(EDGE_M, triangular=True)
    dihedral, plate = dihedral_facets(EDGE_M, EDGE_M, np.pi / 2), plate_facets(EDGE_M, EDGE_M)
    both = list(itertools.product(grid.tolist(), grid.tolist()))
    across = [(tilt, 0.0) for tilt in tilts.tolist()]
    around = [(tilt / 6, tilt / 9) for tilt in tilts.tolist()]
    cases: dict[str, tuple[FacetTarget, int, list[tuple[float, float]], Amplitude]] = {
        "square trihedral": (square, 3, both, lambda a, e: square_trihedral_amplitude(EDGE_M, a, e, WAVELENGTH_M)),
        "triangular trihedral": (
            triangle, 3, both, lambda a, e: triangular_trihedral_amplitude(EDGE_M, a, e, WAVELENGTH_M),
        ),
        "dihedral": (
            dihedral, 2, across, lambda a, e: dihedral_amplitude(EDGE_M, EDGE_M, a, e, WAVELENGTH_M, np.pi / 2),
        ),
        "plate": (plate, 1, around, lambda a, e: plate_amplitude(EDGE_M, EDGE_M, a, e, WAVELENGTH_M)),
    }  # fmt: skip
    rows = []
    for name, (target, bounces, angles, amplitude) in cases.items():
        expected = np.array([abs(float(amplitude(*pair))) for pair in angles])
        azimuth, elevation = np.array(angles).T
        places = 1e5 * np.stack(
            [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1
        )
        found = np.abs(
            physical_optics_scattering(target, Antennas.at(places), WAVELENGTH_M, bounces=(bounces,))[:, 0, 0]
        )
        strong = expected > 0.1 * expected.max()
        worst = float(np.max(np.abs(20 * np.log10(found[strong] / expected[strong]))))
        rows.append(
            Row(f"{name} at long range", "closed form", None, worst <= 0.3, "within 0.3 dB", error=f"{worst:.4f} dB")
        )
    return rows


def _moments(quick: bool) -> list[Row]:
    """A dihedral with all bounces, E along its fold, against the method of moments (and Fresnel along the fold)."""
    rows = []
    target = dihedral_facets(EDGE_M, EDGE_M, np.pi / 2)
    for tilt in (0, 20) if quick else (0, 5, 10, 15, 20, 30):
        exact = dihedral_by_moments(EDGE_M / WAVELENGTH_M, 1e6, math.radians(tilt))
        sigma = 2 * EDGE_M**2 / WAVELENGTH_M * 4 / (2 * np.pi / WAVELENGTH_M) * abs(exact) ** 2
        error = _level(target, tilt, 1e5) - 10 * math.log10(sigma)
        rows.append(
            Row(
                f"dihedral {tilt} degrees off its boresight, all bounces", "method of moments", None, abs(error) < 0.5,
                "within 0.5 dB", error=f"{error:+.2f} dB",
            )
        )  # fmt: skip
    for range_m in (RANGE_M, 12.0):
        near, far = (dihedral_by_moments(EDGE_M / WAVELENGTH_M, r, 0.0) for r in (range_m / WAVELENGTH_M, 1e6))
        reach = EDGE_M / 2 * math.sqrt(4 / (WAVELENGTH_M * range_m))
        sine, cosine = fresnel(reach)
        less = 20 * math.log10(abs(near / far) * abs(cosine + 1j * sine) / reach)
        sigma = 2 * EDGE_M**2 / WAVELENGTH_M * 4 / (2 * np.pi / WAVELENGTH_M) * abs(far) ** 2
        error = _level(target, 0, range_m) - less - 10 * math.log10(sigma)
        rows.append(
            Row(
                f"dihedral at {range_m:.2f} m ({less:+.1f} dB of long range)", "moments and Fresnel", None,
                abs(error) < 1.0, "within 1 dB", error=f"{error:+.2f} dB",
            )
        )  # fmt: skip
    return rows


def _level(target: FacetTarget, tilt_deg: float, range_m: float) -> float:
    tilt = math.radians(tilt_deg)
    place = range_m * np.array([[math.cos(tilt), math.sin(tilt), 0.0]])
    s = physical_optics_scattering(target, Antennas.at(place), WAVELENGTH_M)
    return float(20 * np.log10(abs(s[0, 1, 1])))


def _thesis(quick: bool) -> list[Row]:
    """How much of the thesis's 4.45 dB the near field explains: dihedral over trihedral in focused images."""
    errors = (0.0,) if quick else (-ANGLE_ERROR_DEG, 0.0, ANGLE_ERROR_DEG)
    corners = {(da, de): thesis_target("trihedral", 40 + da, 17 + de) for da in errors for de in errors}
    folds = {(da, de): thesis_target("dihedral", da, de) for da in errors for de in errors}
    between = [_db(fold.near) - _db(corner.near) for fold in folds.values() for corner in corners.values()]
    nominal = _db(folds[0.0, 0.0].near) - _db(corners[0.0, 0.0].near)
    on_axis = 10 * math.log10(8 * np.pi * EDGE_M**4 / WAVELENGTH_M**2) - 30.784
    corner = corners[0.0, 0.0]
    ratio, balance = f"measured {THESIS_DB:+.2f} dB; reported, no target", "measured -2.40 dB; reported, no target"
    rows = [
        ("thesis: dihedral over trihedral, closed forms", on_axis, ratio),
        ("thesis: the same, near field at the stated angles", nominal, ratio),
        ("thesis: the same, lowest within 5 degrees", min(between), ratio),
        ("thesis: the same, highest within 5 degrees", max(between), ratio),
        ("thesis: trihedral, VV over HH, near field", _db(corner.near, 1) - _db(corner.near), balance),
    ]
    return [Row(name, "physical optics", None, True, told, error=f"{value:+.2f} dB") for name, value, told in rows]


def thesis_target(kind: str, azimuth_deg: float, elevation_deg: float, positions: int = 21) -> NearField:
    """A target of the thesis (the dihedral with its fold upright) as its image on the rail of 10 ft shows it.

    The trihedral stands so that the antennas look down on it by 17 degrees; the dihedral at their height.
    """
    z_m = -RANGE_M * math.tan(math.radians(17)) if kind == "trihedral" else 0.0
    reflector = Reflector(
        kind, kind, (0.0, RANGE_M, z_m), EDGE_M, math.radians(azimuth_deg), math.radians(elevation_deg), np.pi / 2
    )
    x = np.linspace(-5 * FOOT_M, 5 * FOOT_M, positions)
    places = np.stack([x, np.zeros(positions), np.zeros(positions)], axis=1)
    depression = math.atan2(-z_m, RANGE_M)
    return near_field(reflector, places, WAVELENGTH_M, beamwidth_rad=BEAMWIDTH_RAD, depression_rad=depression)


def _db(matrix: np.ndarray, channel: int = 0) -> float:
    return float(20 * np.log10(abs(matrix[channel, channel])))
