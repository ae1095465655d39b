"""Scattering of flat-faced targets by physical optics, at any distance.

On every lit polygon (:mod:`processing.calibration.bounce_paths`) the surface carries the current of an endless
conducting plane, ``J = 2 n x H``, of the spherical wave that arrives there after its mirrors; its radiation to the
receiver is integrated with both distances as they are. What comes out is told as the far field tells it: the S that a
point at the target's reference point would need to give the same voltage, so that at long range it becomes the closed
form. Edges do not diffract (no PTD), faces end sharply, and nothing bounces more than three times.
Source: Knott, Shaeffer and Tuley, Radar Cross Section, chapter 5; near field: the same integral without its far-field
phase (thesis 5.4 to 5.10 hold from 2 D^2 / lambda only).

Signs: a plate's S at its normal is positive. As the boundary condition of a conductor demands, a corner's is then the
negative of its closed form: ``-[[cos 2f, sin 2f], [sin 2f, -cos 2f]]`` for two bounces, minus the identity for three.

Mirrors on all faces but the last favour one of the two ways round; the mean of both ways is taken, so that the result
is reciprocal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.calibration.bounce_paths import footprints
from processing.calibration.facets import FacetTarget
from processing.calibration.quadrature import polygon_quadrature
from processing.errors import DataError
from processing.radar.antenna import pattern_exponent

Floats = NDArray[np.float64]
Matrices = NDArray[np.complex128]

STEP_WAVELENGTHS = 0.5
"""Edge of the small triangles that are integrated over, wavelengths; see the table in docs/calibration-targets.md."""
CLOSEST_WAVELENGTHS = 1.0
"""An antenna nearer to a face than this is in its reactive field, where there is no wave to reflect."""


@dataclass(frozen=True, eq=False)
class Antennas:
    """Where the waves come from and go to: the same number of places for both, in rig coordinates."""

    transmit_m: Floats
    """(P, 3) m."""
    receive_m: Floats
    """(P, 3) m."""
    beamwidth_rad: float | None = None
    """Half-power beamwidth of one antenna; None: isotropic."""
    boresight: Floats | None = None
    """(3,) unit vector of the antennas' axes; None: towards the target's reference point."""

    def __post_init__(self) -> None:
        for places in (self.transmit_m, self.receive_m):
            if places.ndim != 2 or places.shape[1] != 3 or not np.isfinite(places).all():
                raise DataError(f"antenna places have shape {places.shape}", "give finite places (P, 3) in metres")
        if len(self.transmit_m) != len(self.receive_m):
            raise DataError("there are more transmitting than receiving places, or fewer", "give one for each")

    @classmethod
    def at(
        cls, positions_m: ArrayLike, beamwidth_rad: float | None = None, boresight: Floats | None = None
    ) -> Antennas:
        """One place each, (P, 3) m, for transmission and reception. Raises :class:`DataError` for another shape."""
        places = np.atleast_2d(np.asarray(positions_m, dtype=np.float64))
        return cls(places, places, beamwidth_rad, boresight)


def physical_optics_scattering(
    target: FacetTarget,
    antennas: Antennas,
    wavelengths_m: ArrayLike,
    *,
    bounces: Iterable[int] = (1, 2, 3),
    step_wavelengths: float = STEP_WAVELENGTHS,
    reference: bool = False,
) -> Matrices:
    """S[rx, tx] of a target, sqrt(m^2), as an antenna at each place sees it.

    Args:
        target: the faces.
        antennas: places of the antennas.
        wavelengths_m: wavelength, or (F,) wavelengths, m.
        bounces: which numbers of bounces to sum.
        step_wavelengths: edge of the small triangles, shortest wavelengths.
        reference: with the plain NumPy integral instead of the kernel.

    Returns:
        (P, 2, 2), or (P, F, 2, 2) for an array of wavelengths; polarizations h and v in the backscatter alignment
        about the line of sight to the reference point. The voltage that it explains is ``g S exp(-2 j k R) / R^2``
        with R and the pattern g at the reference point.

    Raises:
        DataError: a wavelength or step that is not positive, an antenna within a wavelength of a face, or a reference
            point behind the antennas.
    """
    waves = np.asarray(wavelengths_m, dtype=np.float64)
    lengths = np.atleast_1d(waves)
    if lengths.ndim != 1 or not (np.isfinite(lengths).all() and (lengths > 0).all() and lengths.size):
        raise DataError(
            f"the wavelengths are {lengths.tolist()}", "give one or more positive, finite wavelengths in metres"
        )
    if not (np.isfinite(step_wavelengths) and step_wavelengths > 0):
        raise DataError(f"the step of integration is {step_wavelengths} wavelengths", "give a positive step")
    step_m, wanted = step_wavelengths * float(lengths.min()), tuple(bounces)
    integrate = radiation_reference if reference else radiation
    found = np.zeros((len(antennas.transmit_m), lengths.size, 2, 2), dtype=np.complex128)
    for index, (transmitter, receiver) in enumerate(zip(antennas.transmit_m, antennas.receive_m, strict=True)):
        ends = [_end(target, place, antennas) for place in (transmitter, receiver)]
        there = _one_way(target, ends[0], ends[1], lengths, step_m, wanted, integrate)
        again = np.array_equal(transmitter, receiver)
        back = there if again else _one_way(target, ends[1], ends[0], lengths, step_m, wanted, integrate)
        found[index] = (there + back.transpose(0, 2, 1)) / 2
    return found if waves.ndim else found[:, 0]


def _one_way(
    target: FacetTarget,
    out: Floats,
    back: Floats,
    lengths: Floats,
    step_m: float,
    bounces: tuple[int, ...],
    integrate: Callable[..., float],
) -> Matrices:
    """(F, 2, 2) of one transmitting and one receiving end."""
    total = np.zeros((lengths.size, 2, 2), dtype=np.complex128)
    wavenumbers = 2 * np.pi / lengths
    spacing = float(wavenumbers[-1] - wavenumbers[0]) / max(lengths.size - 1, 1)
    even = np.allclose(np.diff(wavenumbers), spacing, rtol=0, atol=1e-9 * float(wavenumbers.max()))
    closest = np.inf
    for part in footprints(target, out[0], back[0], bounces=bounces):
        points, weights = polygon_quadrature(part.corners_m, step_m)
        unfold = np.column_stack([part.unfold, part.shift_m])
        ends = points, weights, part.normal, unfold, out, back
        if even:
            closest = min(closest, integrate(*ends, float(wavenumbers[0]), spacing, total))
            continue
        for number, wavenumber in enumerate(wavenumbers):
            closest = min(closest, integrate(*ends, float(wavenumber), 0.0, total[number : number + 1]))
    if closest < CLOSEST_WAVELENGTHS * lengths.max():
        raise DataError(
            f"an antenna is {closest:.3g} m from the target, within its reactive field",
            f"keep at least {CLOSEST_WAVELENGTHS * lengths.max():.3g} m (a wavelength) between them",
        )
    return total


def radiation_reference(
    points: Floats, weights: Floats, normal: Floats, unfold: Floats, out: Floats, back: Floats, wavenumber: float,
    spacing: float, total: Matrices,
) -> float:  # fmt: skip
    """Add the radiation of one footprint's currents to ``total``: the definition, in plain NumPy.

    Args:
        points: (N, 3) quadrature points, m.
        weights: (N,) m^2.
        normal: (3,) of the face.
        unfold: (3, 4) matrix and shift that take a point to where it would be without the mirrors.
        out: (6, 3) the transmitting end as rows: place, reference point, h, v, boresight, (distance of the reference
            point, cosine exponent of the amplitude pattern, its value at the reference point).
        back: (6, 3) the receiving end likewise.
        wavenumber: 2 pi / wavelength of the first entry of ``total``, 1/m.
        spacing: how much the wavenumber grows from one entry to the next, 1/m.
        total: (F, 2, 2) S[rx, tx], sqrt(m^2), changed in place.

    Returns:
        The shortest distance of an antenna from a point, m.
    """
    matrix = unfold[:, :3]
    way_out, length_out, field_out, gain_out = _rays(points @ matrix.T + unfold[:, 3], out)
    _, length_back, field_back, gain_back = _rays(points, back)
    # Fields are turned as directions are, and change their sign with every mirror of a conductor.
    sign = np.linalg.det(matrix)
    arriving = way_out @ matrix
    scale = weights * gain_out * gain_back * (out[5, 0] * back[5, 0]) / (length_out * length_back)
    amplitude = np.empty((len(points), 2, 2))
    for tx in range(2):
        current = np.cross(normal, np.cross(arriving, sign * field_out[tx] @ matrix))
        for rx in range(2):
            amplitude[:, rx, tx] = scale * np.sum(current * field_back[rx], axis=1)
    path = (length_out - out[5, 0]) + (length_back - back[5, 0])
    for index in range(len(total)):
        k = wavenumber + index * spacing
        total[index] += k / np.sqrt(np.pi) * np.einsum("n,nij->ij", np.exp(-1j * k * path), amplitude)
    return float(min(length_out.min(), length_back.min()))


def _rays(points: Floats, end: Floats) -> tuple[Floats, Floats, tuple[Floats, Floats], Floats]:
    """Directions (N, 3) and lengths from an antenna, its two unit fields there, and its relative amplitude."""
    sight = points - end[0]
    length = np.linalg.norm(sight, axis=1)
    way = sight / length[:, None]
    fields = []
    for polarization in end[2:4]:
        across = polarization - (way @ polarization)[:, None] * way
        fields.append(across / np.maximum(np.linalg.norm(across, axis=1), 1e-12)[:, None])
    gain = np.ones(len(points))
    if end[5, 1] > 0:
        gain = np.maximum(way @ end[4], 0.0) ** end[5, 1] / end[5, 2]
    return way, length, (fields[0], fields[1]), gain


@numba.njit(cache=True, inline="never")
def _ray(x: float, y: float, z: float, end: Floats, fields: Floats) -> tuple[float, float, float, float, float]:
    """Direction, length and relative amplitude from an antenna to a point; its two unit fields there."""
    sx, sy, sz = x - end[0, 0], y - end[0, 1], z - end[0, 2]
    length = np.sqrt(sx * sx + sy * sy + sz * sz)
    sx, sy, sz = sx / length, sy / length, sz / length
    for number in range(2):
        px, py, pz = end[2 + number, 0], end[2 + number, 1], end[2 + number, 2]
        along = px * sx + py * sy + pz * sz
        px, py, pz = px - along * sx, py - along * sy, pz - along * sz
        size = max(np.sqrt(px * px + py * py + pz * pz), 1e-12)
        fields[number, 0], fields[number, 1], fields[number, 2] = px / size, py / size, pz / size
    gain = 1.0
    if end[5, 1] > 0:
        gain = max(sx * end[4, 0] + sy * end[4, 1] + sz * end[4, 2], 0.0) ** end[5, 1] / end[5, 2]
    return sx, sy, sz, length, gain


@numba.njit(cache=True)
def radiation(
    points: Floats, weights: Floats, normal: Floats, unfold: Floats, out: Floats, back: Floats, wavenumber: float,
    spacing: float, total: Matrices,
) -> float:  # fmt: skip
    """As :func:`radiation_reference`, compiled, without arrays in between."""
    m = unfold
    sign = (
        m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1])
        - m[0, 1] * (m[1, 0] * m[2, 2] - m[1, 2] * m[2, 0])
        + m[0, 2] * (m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0])
    )
    nx, ny, nz = normal[0], normal[1], normal[2]
    sent, seen = np.empty((2, 3)), np.empty((2, 3))
    amplitude = np.empty((2, 2))
    closest = np.inf
    for n in range(points.shape[0]):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        kx, ky, kz, length_out, gain_out = _ray(
            m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3],
            m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3],
            m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3],
            out,
            sent,
        )
        _, _, _, length_back, gain_back = _ray(x, y, z, back, seen)
        closest = min(closest, length_out, length_back)
        scale = weights[n] * gain_out * gain_back * (out[5, 0] * back[5, 0]) / (length_out * length_back)
        ax = m[0, 0] * kx + m[1, 0] * ky + m[2, 0] * kz
        ay = m[0, 1] * kx + m[1, 1] * ky + m[2, 1] * kz
        az = m[0, 2] * kx + m[1, 2] * ky + m[2, 2] * kz
        cosine = nx * ax + ny * ay + nz * az
        for tx in range(2):
            ex = sign * (m[0, 0] * sent[tx, 0] + m[1, 0] * sent[tx, 1] + m[2, 0] * sent[tx, 2])
            ey = sign * (m[0, 1] * sent[tx, 0] + m[1, 1] * sent[tx, 1] + m[2, 1] * sent[tx, 2])
            ez = sign * (m[0, 2] * sent[tx, 0] + m[1, 2] * sent[tx, 1] + m[2, 2] * sent[tx, 2])
            # n x (k x e) = k (n . e) - e (n . k)
            share = nx * ex + ny * ey + nz * ez
            jx, jy, jz = ax * share - ex * cosine, ay * share - ey * cosine, az * share - ez * cosine
            for rx in range(2):
                amplitude[rx, tx] = scale * (jx * seen[rx, 0] + jy * seen[rx, 1] + jz * seen[rx, 2])
        path = (length_out - out[5, 0]) + (length_back - back[5, 0])
        # From one wavenumber to the next by a turn: a sine and a cosine for all of them.
        phasor = complex(np.cos(wavenumber * path), -np.sin(wavenumber * path)) / np.sqrt(np.pi)
        turn = complex(np.cos(spacing * path), -np.sin(spacing * path))
        for f in range(total.shape[0]):
            factor = (wavenumber + f * spacing) * phasor
            for rx in range(2):
                for tx in range(2):
                    total[f, rx, tx] += factor * amplitude[rx, tx]
            phasor *= turn
    return float(closest)


def _end(target: FacetTarget, place_m: Floats, antennas: Antennas) -> Floats:
    """One end of the way as the kernels take it, see :func:`radiation_reference`."""
    sight = target.reference_m - place_m
    distance = float(np.linalg.norm(sight))
    if not distance > 0:
        raise DataError("an antenna stands at the target's reference point", "move the target away from it")
    k = sight / distance
    # Straight up or down, h is what it is for a radar that looks along +y.
    h = np.array([k[1], -k[0], 0.0]) if np.hypot(k[0], k[1]) > 1e-12 else np.array([1.0, 0.0, 0.0])
    h /= np.linalg.norm(h)
    axis = k if antennas.boresight is None else np.asarray(antennas.boresight, dtype=np.float64)
    exponent, level = 0.0, 1.0
    if antennas.beamwidth_rad is not None:
        # Of one antenna's amplitude: half the exponent of its power.
        exponent = pattern_exponent(antennas.beamwidth_rad) / 2
        level = max(float(k @ axis), 0.0) ** exponent
        if level == 0:
            raise DataError("the target stands behind the antennas", "turn them towards it")
    return np.stack([place_m, target.reference_m, h, np.cross(h, k), axis, np.array([distance, exponent, level])])
