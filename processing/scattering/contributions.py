"""What lights up: footprints of ray tubes and points, and the echoes that they make at any antenna place nearby."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.radar.antenna import pattern_exponent

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Beam:
    """The antennas' pattern: ``cos^n`` in power, the same for transmission and reception."""

    axis: Floats
    """(3,) unit vector."""
    beamwidth_rad: float
    """Half-power beamwidth of one antenna."""

    def row(self) -> Floats:
        """As the kernels read it: axis and the exponent of one antenna's amplitude."""
        return np.array([*self.axis, pattern_exponent(self.beamwidth_rad) / 2])


ISOTROPIC = np.zeros(4)
"""A beam without a pattern, as the kernels read it."""


@dataclass(frozen=True, eq=False)
class Contributions:
    """Footprints that scatter evenly, and points; of one polarization basis, h = way x z and v = h x way.

    The echo of each at wavenumber k is ``S exp(-j k (d1 + d2)) / (d1 d2)`` times the pattern, with d1 the straight way
    to its image and d2 the way back from where it is.
    """

    places_m: Floats
    """(N, 6, 3): middle, both edges, and the same of the image; points have edges of zero and are their own image."""
    amplitudes: Complexes
    """(N, 2, 2): S[rx, tx], sqrt(m^2), of points; of footprints S over wavenumber where all of it is in phase, m^2."""
    bounces: NDArray[np.int64]
    """(N,) number of bounces; 0 for points of volumes and of rough ground."""
    footprints: NDArray[np.bool_]
    """(N,) whether it is a footprint, which grows with wavenumber."""
    motions_m_s: Floats | None = None
    """(N, 2, 3) velocities of each and of its image; None where nothing moves."""

    def __len__(self) -> int:
        return len(self.amplitudes)

    def chosen(self, which: NDArray[np.bool_] | slice) -> Contributions:
        """Some of them."""
        motions = None if self.motions_m_s is None else self.motions_m_s[which]
        return Contributions(
            self.places_m[which], self.amplitudes[which], self.bounces[which], self.footprints[which], motions
        )

    def motions(self) -> Floats:
        """As the kernels read them: (N, 2, 3), or (0, 2, 3) where nothing moves."""
        return np.zeros((0, 2, 3)) if self.motions_m_s is None else np.ascontiguousarray(self.motions_m_s)

    def scattering(
        self, antennas_m: ArrayLike, wavelengths_m: ArrayLike, reference_m: ArrayLike, *, beam: Beam | None = None
    ) -> Complexes:
        """S[rx, tx] that a point at the reference would need to give the same echo.

        Args:
            antennas_m: (P, 3) places of the antennas near the one that the rays came from, m.
            wavelengths_m: (F,) m.
            reference_m: (3,) point that range and phase are told from.
            beam: the antennas' pattern, told relative to its value at the reference point; isotropic if left out.

        Returns:
            (P, F, 2, 2), sqrt(m^2).

        Raises:
            DataError: wavelengths that are not positive.
        """
        places = np.atleast_2d(np.asarray(antennas_m, dtype=np.float64))
        lengths = np.atleast_1d(np.asarray(wavelengths_m, dtype=np.float64))
        if not (lengths.size and np.isfinite(lengths).all() and (lengths > 0).all()):
            raise DataError(f"wavelengths are {lengths}", "give positive ones in metres")
        reference = np.asarray(reference_m, dtype=np.float64)
        found = np.zeros((len(places), lengths.size, 2, 2), dtype=np.complex128)
        row = ISOTROPIC if beam is None else beam.row()
        for index, antenna in enumerate(places):
            away = reference - antenna
            distance = float(np.linalg.norm(away))
            level = 1.0 if beam is None else max(float(away @ beam.axis) / distance, 0.0) ** (2 * row[3])
            sums = np.empty((len(lengths), 2, 2), dtype=np.complex128)
            echoes(
                self.places_m, self.amplitudes, self.footprints, antenna, 2 * np.pi / lengths, 2 * distance, row, sums
            )
            found[index] = sums * distance**2 / level
        return found


def of_points(centres_m: Floats, matrices: Complexes, velocity_m_s: Floats | None = None) -> Contributions:
    """Point scatterers (N, 3) with S[rx, tx] (N, 2, 2), sqrt(m^2), and velocities (N, 3), as contributions."""
    places = np.zeros((len(centres_m), 6, 3))
    places[:, 0] = places[:, 3] = centres_m
    return Contributions(
        places,
        np.asarray(matrices, dtype=np.complex128),
        np.zeros(len(places), dtype=np.int64),
        np.zeros(len(places), dtype=bool),
        None if velocity_m_s is None else np.repeat(np.asarray(velocity_m_s, dtype=np.float64)[:, None], 2, axis=1),
    )


def together(parts: list[Contributions]) -> Contributions:
    """Several as one. Raises :class:`DataError` without any."""
    if not parts:
        raise DataError("nothing scatters", "put a body into the scene")
    return Contributions(
        np.concatenate([part.places_m for part in parts]),
        np.concatenate([part.amplitudes for part in parts]),
        np.concatenate([part.bounces for part in parts]),
        np.concatenate([part.footprints for part in parts]),
        np.concatenate(
            [np.zeros((len(part), 2, 3)) if part.motions_m_s is None else part.motions_m_s for part in parts]
        )
        if any(part.motions_m_s is not None for part in parts)
        else None,
    )


def echoes_reference(
    places: Floats, amplitudes: Complexes, footprints: NDArray[np.bool_], antenna: Floats, wavenumbers: Floats,
    reference: float, beam: Floats, sums: Complexes,
) -> None:  # fmt: skip
    """Sum of all echoes at one antenna place: the definition, in plain NumPy. Nothing moves.

    The integral of ``exp(-j k path)`` over a footprint is its area times two sincs: its path is taken as linear.

    Args:
        places, amplitudes, footprints: of :class:`Contributions`.
        antenna: (3,) m.
        wavenumbers: (F,) 1/m.
        reference: length of path that phases are counted from, m.
        beam: of :meth:`Beam.row`; an exponent of zero is isotropic.
        sums: (F, 2, 2) filled, sqrt(m^2) / m^2.
    """
    out, back = places[:, 3] - antenna, places[:, 0] - antenna
    d_out, d_back = np.linalg.norm(out, axis=1), np.linalg.norm(back, axis=1)
    out, back = out / d_out[:, None], back / d_back[:, None]
    across = np.sum(out * places[:, 4] + back * places[:, 1], axis=1)
    up = np.sum(out * places[:, 5] + back * places[:, 2], axis=1)
    gain = np.ones(len(places))
    if beam[3] > 0:
        gain = (np.maximum(out @ beam[:3], 0) * np.maximum(back @ beam[:3], 0)) ** beam[3]
    for index, k in enumerate(wavenumbers):
        even = np.where(footprints, k, 1.0) * np.sinc(k * across / (2 * np.pi)) * np.sinc(k * up / (2 * np.pi))
        phase = np.exp(-1j * k * (d_out + d_back - reference))
        sums[index] = np.einsum("n,nij->ij", even * gain * phase / (d_out * d_back), amplitudes)


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def sine_over(x: float) -> float:
    """Sine of x over x."""
    return math.sin(x) / x if abs(x) > 1e-6 else 1.0


@numba.njit(cache=True, nogil=True, error_model="numpy")
def leg(place: Floats, first: int, antenna: Floats, beam: Floats) -> tuple[float, float, float, float]:
    """One way between an antenna and a contribution's row ``first`` (0: itself, 3: its image): length, growth along
    both edges of a footprint, and the antenna's amplitude over the length."""
    x, y, z = place[first, 0] - antenna[0], place[first, 1] - antenna[1], place[first, 2] - antenna[2]
    length = math.sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    across = x * place[first + 1, 0] + y * place[first + 1, 1] + z * place[first + 1, 2]
    up = x * place[first + 2, 0] + y * place[first + 2, 1] + z * place[first + 2, 2]
    gain = 1.0
    if beam[3] > 0.0:
        gain = max(x * beam[0] + y * beam[1] + z * beam[2], 0.0) ** beam[3]
    return length, across, up, gain / length


@numba.njit(cache=True, nogil=True, error_model="numpy")
def path(place: Floats, antenna: Floats, beam: Floats) -> tuple[float, float, float, float]:
    """Path there and back, its growth along both edges of a footprint, and gain over the product of the distances."""
    out, out_across, out_up, out_gain = leg(place, 3, antenna, beam)
    back, back_across, back_up, back_gain = leg(place, 0, antenna, beam)
    return out + back, out_across + back_across, out_up + back_up, out_gain * back_gain


@numba.njit(cache=True, nogil=True, error_model="numpy")
def echoes(
    places: Floats, amplitudes: Complexes, footprints: NDArray[np.bool_], antenna: Floats, wavenumbers: Floats,
    reference: float, beam: Floats, sums: Complexes,
) -> None:  # fmt: skip
    """As :func:`echoes_reference`, compiled."""
    sums[:] = 0.0
    for n in range(len(places)):
        length, across, up, gain = path(places[n], antenna, beam)
        for f in range(len(wavenumbers)):
            k = wavenumbers[f]
            even = gain * sine_over(0.5 * k * across) * sine_over(0.5 * k * up)
            if footprints[n]:
                even *= k
            angle = k * (length - reference)
            factor = complex(even * math.cos(angle), -even * math.sin(angle))
            for rx in range(2):
                for tx in range(2):
                    sums[f, rx, tx] += factor * amplitudes[n, rx, tx]
