"""What a radar at one antenna position sees of a scene: point scatterers with scattering matrices.

Linear polarization basis of the line of sight ``k`` (antenna to target): ``h = k x z`` (to the right as seen by a
radar that looks along +y), ``v = h x k`` (up). The same basis serves transmission and reception (backscatter
alignment), so that a reciprocal target has ``S_hv = S_vh``.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.calibration.canonical import sphere_amplitude
from processing.calibration.rcs import (
    dihedral_amplitude,
    plate_amplitude,
    square_trihedral_amplitude,
    triangular_trihedral_amplitude,
)
from processing.errors import DataError
from processing.scene.model import Bush, Reflector, Scene

Floats = NDArray[np.float64]
Matrices = NDArray[np.complex128]

KINDS = ("plate", "dihedral", "trihedral", "trihedral_triangular", "sphere")
"""Kinds of analytic reflectors; "trihedral" has square faces, a sphere's edge is its diameter."""


def scatterers(scene: Scene, antenna_m: ArrayLike, wavelength_m: float) -> tuple[Floats, Matrices]:
    """All scatterers of a scene as seen from one antenna position.

    Args:
        scene: the scene.
        antenna_m: (3,) antenna phase centre in rig coordinates, m.
        wavelength_m: wavelength at the ramp's centre, m.

    Returns:
        Centres (N, 3) in m and scattering matrices (N, 2, 2), S[rx, tx], sqrt(m^2). Their number and order depend on
        the scene alone, and the matrices change smoothly with the antenna's position.

    Raises:
        DataError: an unknown kind of reflector, or an antenna inside a target.
    """
    antenna = np.asarray(antenna_m, dtype=np.float64)
    centres: list[Floats] = []
    matrices: list[Matrices] = []
    for point in scene.points:
        centres.append(np.asarray([point.position_m], dtype=np.float64))
        matrices.append(np.asarray(point.scattering, dtype=np.complex128).reshape(1, 2, 2))
    for reflector in scene.reflectors:
        centres.append(np.asarray([reflector.position_m], dtype=np.float64))
        matrices.append(reflector_scattering(reflector, antenna, wavelength_m)[None])
    for bush in scene.bushes:
        cloud = bush_cloud(bush)
        centres.append(cloud.centres_m)
        matrices.append(dipole_scattering(cloud, antenna))
    if not centres:
        return np.zeros((0, 3)), np.zeros((0, 2, 2), dtype=np.complex128)
    return np.concatenate(centres), np.concatenate(matrices)


def reflector_scattering(reflector: Reflector, antenna_m: ArrayLike, wavelength_m: float) -> Matrices:
    """Scattering matrix of a reflector from one or more antenna positions.

    Args:
        reflector: the reflector; its stored angles are those to the rig's origin (the aperture's centre).
        antenna_m: (..., 3) antenna phase centres, m.
        wavelength_m: wavelength, m.

    Returns:
        (..., 2, 2) S[rx, tx], sqrt(m^2): the identity for odd bounces, ``[[cos 2f, sin 2f], [sin 2f, -cos 2f]]`` for
        the dihedral with its fold at ``f``, times the amplitude at the local angles.
    """
    azimuth, elevation = local_angles(reflector, antenna_m)
    edge = reflector.edge_m
    matrix = np.eye(2)
    if reflector.kind == "plate":
        amplitude = plate_amplitude(edge, edge, azimuth, elevation, wavelength_m)
    elif reflector.kind == "dihedral":
        amplitude = dihedral_amplitude(edge, edge, azimuth, elevation, wavelength_m, reflector.fold_rad)
        c, s = np.cos(2 * reflector.fold_rad), np.sin(2 * reflector.fold_rad)
        matrix = np.array([[c, s], [s, -c]])
    elif reflector.kind == "trihedral":
        amplitude = square_trihedral_amplitude(edge, azimuth, elevation, wavelength_m)
    elif reflector.kind == "trihedral_triangular":
        amplitude = triangular_trihedral_amplitude(edge, azimuth, elevation, wavelength_m)
    elif reflector.kind == "sphere":
        return np.asarray(np.broadcast_to(sphere_amplitude(edge / 2, wavelength_m) * matrix, (*azimuth.shape, 2, 2)))
    else:
        raise DataError(
            f"reflector {reflector.name!r} is of the unknown kind {reflector.kind!r}", f"use one of {', '.join(KINDS)}"
        )
    return np.asarray(amplitude[..., None, None] * matrix, dtype=np.complex128)


def apparent_scattering(
    reflector: Reflector, antenna_positions: ArrayLike, wavelength_m: float, weights: ArrayLike | None = None
) -> Matrices:
    """Scattering matrix that a focused image shows of a reflector: the mean over the aperture.

    Args:
        reflector: the reflector.
        antenna_positions: (P, 3) antenna phase centres of the collect, m.
        wavelength_m: wavelength, m.
        weights: (P,) weights with which the processor sums the positions; equal if left out.

    Returns:
        (2, 2) S[rx, tx], sqrt(m^2).
    """
    positions = np.atleast_2d(np.asarray(antenna_positions, dtype=np.float64))
    seen = reflector_scattering(reflector, positions, wavelength_m)
    return np.asarray(np.average(seen, axis=0, weights=None if weights is None else np.asarray(weights)))


def local_angles(reflector: Reflector, antenna_m: ArrayLike) -> tuple[Floats, Floats]:
    """Azimuth and elevation of antenna positions (..., 3) in the reflector's own frame, rad, each (...).

    The stored angles hold for the rig's origin; elsewhere both change by the change of the geometric direction.
    """
    antenna = np.asarray(antenna_m, dtype=np.float64)
    azimuth, elevation = _direction(antenna - np.asarray(reflector.position_m))
    azimuth0, elevation0 = _direction(-np.asarray(reflector.position_m, dtype=np.float64))
    turned = np.mod(azimuth - azimuth0 + np.pi, 2 * np.pi) - np.pi
    return reflector.azimuth_rad + turned, reflector.elevation_rad + elevation - elevation0


class DipoleCloud(NamedTuple):
    """The thin dipoles of a bush."""

    centres_m: Floats
    """(N, 3) places, m."""
    directions: Floats
    """(N, 3) unit vectors along the dipoles."""
    amplitude: float
    """Scattering amplitude of one dipole seen and polarized along its best direction, sqrt(m^2)."""


@lru_cache(maxsize=64)
def bush_cloud(bush: Bush) -> DipoleCloud:
    """The dipoles of a bush: places uniform in a ball, directions uniform on the sphere, both from the bush's seed.

    The amplitude makes the mean incoherent sum of |S_hh|^2 (and |S_vv|^2) equal to ``rcs_m2``: the mean of the fourth
    power of a direction cosine is 1/5, so each of N dipoles has the peak RCS ``5 rcs / N``. Mean |S_hv|^2 is then a
    third of that (mean of the product of two squared cosines: 1/15).
    """
    if bush.scatterers < 1:
        raise DataError(f"bush {bush.name!r} has {bush.scatterers} scatterers", "give it at least one")
    random = np.random.default_rng(bush.seed)
    directions = random.normal(size=(bush.scatterers, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    offsets = random.normal(size=(bush.scatterers, 3))
    offsets /= np.linalg.norm(offsets, axis=1, keepdims=True)
    offsets *= bush.radius_m * np.cbrt(random.random((bush.scatterers, 1)))
    centres = np.asarray(bush.position_m) + offsets
    centres.setflags(write=False)
    directions.setflags(write=False)
    return DipoleCloud(centres, directions, float(np.sqrt(5 * bush.rcs_m2 / bush.scatterers)))


def dipole_scattering(cloud: DipoleCloud, antenna_m: Floats) -> Matrices:
    """Scattering matrices (N, 2, 2) of a cloud's dipoles as an antenna (3,) sees them, S[rx, tx], sqrt(m^2).

    Raises:
        DataError: the antenna stands vertically above a dipole, where h has no direction.
    """
    sight = cloud.centres_m - antenna_m
    across = np.hypot(sight[:, 0], sight[:, 1])
    distance = np.hypot(across, sight[:, 2])
    if not np.all(across > 0):
        raise DataError("the antenna stands vertically above a scatterer", "move the target away from the rail")
    x, y, z = sight[:, 0], sight[:, 1], sight[:, 2]
    dx, dy, dz = cloud.directions.T
    on_h = (y * dx - x * dy) / across
    on_v = (across * dz - z * (x * dx + y * dy) / across) / distance
    seen = np.stack([on_h, on_v], axis=-1)
    return np.asarray(cloud.amplitude * seen[:, :, None] * seen[:, None, :], dtype=np.complex128)


def _direction(towards: Floats) -> tuple[Floats, Floats]:
    across = np.hypot(towards[..., 0], towards[..., 1])
    if np.any((across == 0) & (towards[..., 2] == 0)):
        raise DataError("an antenna position lies on a reflector", "move the reflector away from the rail")
    return np.arctan2(towards[..., 0], -towards[..., 1]), np.arctan2(towards[..., 2], across)
