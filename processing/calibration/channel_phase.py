"""Phases between channels that were recorded one after the other, from targets in the scene itself.

Between two channels the switches change over, the oscillator drifts, and where each channel has a pass of its own the
trolley comes back to a place that differs by millimetres. So the channels of a collect stand in other phases to each
other than those of the calibration series: ``M'_ch = exp(j (p_ch + (4 pi / lambda) sin(a) d_ch)) (R S T)_ch`` with a
phase p and a shift d along the rail for each channel, a being the angle of the target from broadside. HH is what the
others are compared with. A target whose S is known tells them for each channel that it shows; reciprocal scatterers
tell HV against VH; what nothing tells keeps a standard deviation that says so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.calibration.distortion import CHANNELS, Complexes, Distortion, channel_values
from processing.errors import DataError

Floats = NDArray[np.float64]

UNKNOWN_SD_RAD = float(np.pi / np.sqrt(3))
"""Standard deviation of a phase of which nothing is known."""
LEAST_SNR = 4.0
"""Of a channel's amplitude over the standard deviation of its quadrature, for its phase to be used."""


@dataclass(frozen=True)
class ChannelPhases:
    """Phases and shifts of the channels over HH, in the order HH, HV, VH, VV."""

    phase_rad: Floats
    """(4,) at broadside."""
    shift_m: Floats
    """(4,) along the rail."""
    covariance: Floats
    """(4, 2, 2) of phase and shift."""
    wavelength_m: float

    def known(self) -> tuple[str, ...]:
        """Channels whose phase over HH was measured."""
        sd = np.sqrt(self.covariance[:, 0, 0])
        return tuple(name for name, value in zip(CHANNELS, sd, strict=True) if value < UNKNOWN_SD_RAD / 2)

    def phases(self, sine: ArrayLike) -> Floats:
        """(4, ...) phases at places whose angle from broadside has the sine given."""
        s = np.asarray(sine, dtype=np.float64)
        turn = 4 * np.pi / self.wavelength_m
        shape = (4, *[1] * s.ndim)
        return np.asarray(self.phase_rad.reshape(shape) + turn * self.shift_m.reshape(shape) * s)

    def phase_sd_rad(self, sine: float = 0.0) -> Floats:
        """(4,) standard deviations of :meth:`phases` at one place."""
        vector = np.array([1.0, 4 * np.pi / self.wavelength_m * sine])
        return np.asarray(np.sqrt(np.einsum("i,cij,j->c", vector, self.covariance, vector)))

    def remove(self, image: ArrayLike, sine: ArrayLike) -> Complexes:
        """Image (4, ...) with the phases taken off."""
        return np.asarray(np.asarray(image, dtype=np.complex128) * np.exp(-1j * self.phases(sine)))

    def with_reciprocity(self, measured: complex, distortion: Distortion, sd_rad: float) -> ChannelPhases:
        """Tie HV and VH by reciprocal scatterers of the scene: what is known better gives the other.

        Args:
            measured: HV over VH of the scene, crosstalk aside.
            distortion: of the series, which says what it should be.
            sd_rad: standard deviation of its phase.

        Raises:
            DataError: a ratio that is zero or not finite.
        """
        if not np.isfinite(measured) or measured == 0:
            raise DataError(f"HV over VH is {measured}", "choose reciprocal scatterers that both channels see")
        difference = float(np.angle(measured / (distortion.receive_gain / distortion.transmit_gain)))
        variance = self.covariance[:, 0, 0]
        better, other = (1, 2) if variance[1] <= variance[2] else (2, 1)
        if variance[other] <= sd_rad**2:
            return self
        phase, shift, covariance = self.phase_rad.copy(), self.shift_m.copy(), self.covariance.copy()
        phase[other] = np.angle(np.exp(1j * (phase[better] + (difference if other == 1 else -difference))))
        shift[other] = shift[better]
        covariance[other] = covariance[better]
        covariance[other, 0, 0] += sd_rad**2
        return replace(self, phase_rad=phase, shift_m=shift, covariance=covariance)


def channel_phases(
    values: ArrayLike,
    noise: ArrayLike,
    expected: ArrayLike,
    distortion: Distortion,
    *,
    sine: ArrayLike,
    wavelength_m: float,
    shift_sd_m: float = 0.0,
    crosstalk_sd: float = 0.0,
) -> ChannelPhases:
    """Phases of the channels over HH from targets of known S in the scene.

    Args:
        values: (n, 4) complex channel values of the targets.
        noise: (n, 4) noise power.
        expected: (n, 2, 2) their S.
        distortion: R and T from the calibration series.
        sine: (n,) of each target's angle from broadside.
        wavelength_m: m.
        shift_sd_m: standard deviation with which the trolley comes back to a place, m; 0 fixes the shifts.
        crosstalk_sd: standard deviation of the series' crosstalk, over the co-polarized gain.

    Raises:
        DataError: shapes that do not fit, or a target without HH.
    """
    m, power = np.asarray(values, dtype=np.complex128), np.asarray(noise, dtype=np.float64)
    s, angles = np.asarray(expected, dtype=np.complex128), np.asarray(sine, dtype=np.float64)
    count = len(m)
    if m.shape != (count, 4) or power.shape != m.shape or s.shape != (count, 2, 2) or angles.shape != (count,):
        raise DataError(
            f"targets have shapes {m.shape}, {power.shape}, {s.shape} and {angles.shape}",
            "give (n, 4) values and noise, (n, 2, 2) matrices and (n,) sines",
        )
    model = channel_values(distortion.apply(s))
    if not np.isfinite(m).all() or not (np.abs(m[:, 0]) > 0).all() or not (np.abs(model[:, 0]) > 0).all():
        raise DataError("a target in the scene shows nothing in HH", "use a trihedral, a plate or an upright dihedral")
    turn = 4 * np.pi / wavelength_m
    phase, shift = np.zeros(4), np.zeros(4)
    covariance = np.zeros((4, 2, 2))
    covariance[1:, 0, 0] = UNKNOWN_SD_RAD**2
    covariance[1:, 1, 1] = shift_sd_m**2
    size = np.abs(m[:, 0] / model[:, 0])
    uncertain = power / 2 + (crosstalk_sd * size * np.linalg.norm(model, axis=1))[:, None] ** 2 / 2
    for channel in (1, 2, 3):
        reached = size * np.abs(model[:, channel])
        use = reached > LEAST_SNR * np.sqrt(uncertain[:, channel])
        if not use.any():
            continue
        phasor = (m[use, channel] / model[use, channel]) / (m[use, 0] / model[use, 0])
        variance = uncertain[use, channel] / reached[use] ** 2 + power[use, 0] / 2 / np.abs(m[use, 0]) ** 2
        middle = float(np.angle(np.sum(phasor / np.abs(phasor) / variance)))
        seen = np.angle(phasor * np.exp(-1j * middle))
        design = np.stack([np.ones(int(use.sum())), turn * angles[use]], axis=1)
        normal = (design / variance[:, None]).T @ design
        if shift_sd_m > 0:
            normal[1, 1] += 1 / shift_sd_m**2
            covariance[channel] = np.linalg.inv(normal)
            solved = covariance[channel] @ ((design / variance[:, None]).T @ seen)
        else:
            covariance[channel] = np.diag([1 / normal[0, 0], 0.0])
            solved = np.array([float(np.sum(seen / variance)) / normal[0, 0], 0.0])
        phase[channel], shift[channel] = float(np.angle(np.exp(1j * (middle + solved[0])))), float(solved[1])
    return ChannelPhases(phase, shift, covariance, wavelength_m)
