"""What a radar's antennas and channels do to scattering matrices, and how that is taken off.

Model: ``M = R S T`` (S[rx, tx]; R and T 2 x 2, receive and transmit). With the channels in the order HH, HV, VH, VV
(names transmit-then-receive) a matrix read column by column is the vector of its channels, so that
``vec(R S T) = (T^T kron R) vec(S)``. A factor common to all channels is the calibration constant's and not kept here:
``R[0, 0] = T[0, 0] = 1``. Isolated antennas (diagonal R and T) are the special case without crosstalk.
Source: Freeman, SAR calibration: an overview (IEEE TGRS 1992); Whitt and others (IEEE TAP 1991).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError

Complexes = NDArray[np.complex128]

CHANNELS = ("HH", "HV", "VH", "VV")
"""Channels in the order of a scattering matrix read column by column."""

WORST_CONDITION = 100.0
"""Largest condition number of R or T for which crosstalk is taken off: beyond, 40 dB of dynamic range are lost."""

RECIPROCAL = np.array([[1, 0, 0], [0, 1, 0], [0, 1, 0], [0, 0, 1]], dtype=np.float64)
"""(S_hh, S_hv, S_vv) of a reciprocal target to the four channels."""


def matrices(channels: ArrayLike) -> Complexes:
    """Matrices (..., 2, 2) M[rx, tx] of channel values (..., 4) in the order of :data:`CHANNELS`."""
    values = np.asarray(channels, dtype=np.complex128)
    return np.swapaxes(values.reshape(*values.shape[:-1], 2, 2), -1, -2)


def channel_values(matrix: ArrayLike) -> Complexes:
    """Channel values (..., 4) in the order of :data:`CHANNELS` of matrices (..., 2, 2)."""
    values = np.swapaxes(np.asarray(matrix, dtype=np.complex128), -1, -2)
    return values.reshape(*values.shape[:-2], 4)


@dataclass(frozen=True)
class Distortion:
    """Receive and transmit matrices relative to their H channel: ``M = constant * R S T``."""

    receive: Complexes
    """(2, 2) R[channel, polarization of the wave], ``R[0, 0] = 1``."""
    transmit: Complexes
    """(2, 2) T[polarization of the wave, channel], ``T[0, 0] = 1``."""

    def __post_init__(self) -> None:
        for name in ("receive", "transmit"):
            matrix = np.asarray(getattr(self, name), dtype=np.complex128)
            if matrix.shape != (2, 2) or not np.isfinite(matrix).all():
                raise DataError(
                    f"the {name} matrix of the radar is {matrix.tolist()}", "give 2 x 2 finite complex numbers"
                )
            if matrix[0, 0] == 0 or matrix[1, 1] == 0:
                raise DataError(
                    f"the {name} matrix of the radar has no gain in {'H' if matrix[0, 0] == 0 else 'V'}",
                    "check switches and cables: a channel is dead or both polarizations are exchanged",
                )
            object.__setattr__(self, name, matrix / matrix[0, 0])

    @classmethod
    def isolated(cls, receive: complex, transmit: complex) -> Distortion:
        """Antennas without crosstalk: gains of V over H on receive and on transmit.

        Raises:
            DataError: a gain is zero or not finite.
        """
        return cls(np.diag([1, receive]).astype(np.complex128), np.diag([1, transmit]).astype(np.complex128))

    @property
    def receive_gain(self) -> complex:
        """Gain of V over H on receive."""
        return complex(self.receive[1, 1])

    @property
    def transmit_gain(self) -> complex:
        """Gain of V over H on transmit."""
        return complex(self.transmit[1, 1])

    @property
    def co_db(self) -> float:
        """Amplitude imbalance of VV over HH, dB."""
        return float(20 * np.log10(abs(self.receive_gain * self.transmit_gain)))

    @property
    def co_deg(self) -> float:
        """Phase imbalance of VV over HH, degrees, in (-180, 180]."""
        return float(np.degrees(np.angle(self.receive_gain * self.transmit_gain)))

    @property
    def crosstalk(self) -> dict[str, complex]:
        """Crosstalk of each path over its own polarization: what the H (V) receiving channel makes of a V (H) wave
        (``receive_h``, ``receive_v``), and what leaves in V (H) when H (V) is transmitted (``transmit_h``,
        ``transmit_v``)."""
        r, t = self.receive, self.transmit
        return {
            "receive_h": complex(r[0, 1] / r[0, 0]),
            "receive_v": complex(r[1, 0] / r[1, 1]),
            "transmit_h": complex(t[1, 0] / t[0, 0]),
            "transmit_v": complex(t[0, 1] / t[1, 1]),
        }

    @property
    def has_crosstalk(self) -> bool:
        """Whether any path leaks."""
        return any(self.crosstalk.values())

    @property
    def worst_crosstalk_db(self) -> float:
        """Largest crosstalk of the four paths, dB; -inf for isolated antennas."""
        worst = max(abs(value) for value in self.crosstalk.values())
        return float(20 * np.log10(worst)) if worst > 0 else -float("inf")

    def gain(self, channel: str) -> complex:
        """Gain of a channel over HH for its own element of S."""
        rows = {"H": 0, "V": 1}
        receive, transmit = rows[channel[1]], rows[channel[0]]
        return complex(self.receive[receive, receive] * self.transmit[transmit, transmit])

    def matrix(self, channels: Sequence[str] = CHANNELS) -> Complexes:
        """(channels, 4) what each channel makes of (S_hh, S_vh, S_hv, S_vv), the elements in channels' order.

        Raises:
            DataError: an unknown channel.
        """
        if unknown := [name for name in channels if name not in CHANNELS]:
            raise DataError(f"there is no channel {', '.join(unknown)}", f"channels are {', '.join(CHANNELS)}")
        both = np.kron(self.transmit.T, self.receive).astype(np.complex128)
        return both[[CHANNELS.index(name) for name in channels]]

    def apply(self, scattering: ArrayLike) -> Complexes:
        """What is measured of scattering matrices (..., 2, 2), without the constant."""
        return np.asarray(self.receive @ np.asarray(scattering, dtype=np.complex128) @ self.transmit)

    def residual(self, estimate: Distortion) -> Distortion:
        """What is left of this distortion when an estimate of it is taken off: ``R_e^-1 R`` and ``T T_e^-1``."""
        receive = np.linalg.solve(estimate.receive, self.receive)
        return Distortion(receive.astype(np.complex128), self.transmit @ np.linalg.inv(estimate.transmit))

    def inverse(self, channels: Sequence[str] = CHANNELS) -> Complexes:
        """(channels, channels) what takes the distortion off.

        All four channels give S by the inverse matrices. Three channels with one cross-polarized among them give the
        reciprocal S that explains them. With fewer, or with two cross-polarized and one co-polarized channel, crosstalk
        cannot be told from scattering, and each channel is divided by its own gain.

        Raises:
            DataError: unknown channels, or crosstalk too strong to be taken off.
        """
        names = tuple(channels)
        forward = self.matrix(names)
        if not self.has_crosstalk or not {"HH", "VV"} <= set(names) or len(names) < 3:
            return np.diag([1 / self.gain(name) for name in names]).astype(np.complex128)
        self._refuse_singular()
        if len(names) == 4:
            return np.asarray(np.linalg.inv(forward)[[CHANNELS.index(name) for name in names]])
        # Three equations for S_hh, S_hv = S_vh and S_vv.
        rows = [{"HH": 0, "VV": 2}.get(name, 1) for name in names]
        return np.asarray(np.linalg.inv(forward @ RECIPROCAL)[rows])

    def remove(self, image: ArrayLike, channels: Sequence[str] = CHANNELS) -> Complexes:
        """Take the distortion off an image, see :meth:`inverse`.

        Args:
            image: (channels, ...) complex.
            channels: names of the first axis.

        Returns:
            Same shape complex128; a pixel that is not finite in a channel that it depends on is NaN.

        Raises:
            DataError: a first axis of another length, or as :meth:`inverse`.
        """
        values = np.asarray(image, dtype=np.complex128)
        if values.shape[:1] != (len(channels),):
            raise DataError(
                f"an image of shape {values.shape} has not {len(channels)} channels", "give (channels, ...)"
            )
        inverse = self.inverse(channels)
        with np.errstate(invalid="ignore"):
            if np.count_nonzero(inverse - np.diag(np.diagonal(inverse))) == 0:
                # Channels that do not mix stay apart, so that what one lacks is not missing in all.
                return np.asarray(values * np.diagonal(inverse).reshape(-1, *[1] * (values.ndim - 1)))
            return np.asarray(np.tensordot(inverse, values, axes=1))

    def noise_after(self, noise: ArrayLike, channels: Sequence[str] = CHANNELS) -> NDArray[np.float64]:
        """Noise power (channels, ...) once the distortion is taken off, of independent noise in the channels."""
        share = np.abs(self.inverse(channels)) ** 2
        power = np.asarray(noise, dtype=np.float64)
        if np.count_nonzero(share - np.diag(np.diagonal(share))) == 0:
            return np.asarray(power * np.diagonal(share).reshape(-1, *[1] * (power.ndim - 1)))
        return np.asarray(np.tensordot(share, power, axes=1))

    def _refuse_singular(self) -> None:
        for name, matrix in (("receive", self.receive), ("transmit", self.transmit)):
            condition = float(np.linalg.cond(matrix))
            if not condition < WORST_CONDITION:
                raise DataError(
                    f"the two {name} channels are nearly alike (condition number {condition:.3g})",
                    "check that the antennas stand at right angles and that the switches change over",
                )


NO_DISTORTION = Distortion.isolated(1.0, 1.0)
