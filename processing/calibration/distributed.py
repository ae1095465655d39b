"""Crosstalk and cross-polarized imbalance from distributed targets: vegetation, rough ground.

``M = C_r S' C_t`` with ``S' = D_r S D_t``: the channels' gains D inside, small crosstalk ``C_r = [[1, w], [u, 1]]``
and ``C_t = [[1, v], [z, 1]]`` outside. For reciprocal scatterers the covariances between a cross-polarized and a
co-polarized channel are, to first order in the crosstalk, with both cross-polarized channels balanced (x = S'_hv),

    <HV HH*> = A + u <HH HH*> + z <VV HH*> + (w* + z*) <x x*>
    <VH HH*> = A + v <HH HH*> + w <VV HH*> + (w* + z*) <x x*>
    <HV VV*> = B + u <HH VV*> + z <VV VV*> + (u* + v*) <x x*>
    <VH VV*> = B + v <HH VV*> + w <VV VV*> + (u* + v*) <x x*>

- **Quegan**: scatterers without a preferred slope (reflection symmetry) have A = <x HH*> = 0 and B = <x VV*> = 0, so
  the four equations give the four unknowns.
- **Ainsworth**: A and B are unknown means, so only what differs between HV and VH is crosstalk: u - v and w - z. What
  both have in common cannot be told from sloping scatterers and is left in the data.

Both are solved again with what they found taken off, until nothing changes, so the first order does not limit them.
Neither gives the co-polarized imbalance, for which a trihedral is needed.
Sources: Quegan, A unified algorithm for phase and cross-talk calibration (IEEE TGRS 32, 1994); Ainsworth, Ferro-Famil
and Lee, Orientation angle preserving a posteriori polarimetric SAR calibration (IEEE TGRS 44, 2006).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from processing.calibration.distortion import CHANNELS, Complexes, Distortion
from processing.errors import DataError

Method = Literal["quegan", "ainsworth"]

LEAST_PIXELS = 64
LEAST_COHERENCE = 0.5
"""Of HV and VH: below, noise or a switch that does not change over hides what is reciprocal."""
MOST_CROSSTALK = 0.5
"""Amplitude of crosstalk beyond which it is the region that mixes the polarizations, not the radar."""
LARGEST_CO_COHERENCE = 0.98
"""Of HH and VV: above, the four equations hold only two."""
BLOCKS = 16
"""Parts of the region whose differences give the standard deviations (jackknife)."""
STEPS = 50
SMALLEST_STEP = 1e-12

HH, HV, VH, VV = range(4)


@dataclass(frozen=True)
class CrosstalkEstimate:
    """What distributed targets tell of a radar."""

    receive: Complexes
    """(2, 2) ``C_r``, unit diagonal."""
    transmit: Complexes
    """(2, 2) ``C_t``, unit diagonal."""
    cross_ratio: complex
    """``f_r / f_t``: HV over VH once the crosstalk is gone."""
    coherence: float
    """Of HV and VH."""
    pixels: int
    sd: dict[str, float]
    """Standard deviations of ``u``, ``v``, ``w``, ``z`` (root of the mean square of the complex error) and of
    ``cross_ratio`` relative to itself, from the scatter between parts of the region."""

    def distortion(self, co_ratio: complex) -> Distortion:
        """R and T with a trihedral's VV / HH, crosstalk taken off (see :meth:`without_crosstalk`).

        The sign that the root leaves open is taken as by :func:`processing.calibration.imbalance.imbalance`.

        Raises:
            DataError: a ratio that is zero or not finite.
        """
        from processing.calibration.imbalance import imbalance

        gains = imbalance(co_ratio, self.cross_ratio)
        return Distortion(self.receive @ gains.receive, gains.transmit @ self.transmit)

    def without_crosstalk(self, channels: ArrayLike) -> Complexes:
        """Channel values (4, ...) with the crosstalk, but not the imbalance, taken off."""
        return Distortion(self.receive, self.transmit).remove(channels)


def estimate_crosstalk(
    image: ArrayLike, *, method: Method = "quegan", mask: ArrayLike | None = None
) -> CrosstalkEstimate:
    """Crosstalk from the pixels of distributed targets.

    Args:
        image: (4, ...) complex, channels in the order HH, HV, VH, VV.
        method: ``"quegan"`` or ``"ainsworth"``, see the module.
        mask: pixels to use, shape of one channel; all where left out. Pixels that are not finite are left out.

    Raises:
        DataError: an unknown method, too few pixels, empty channels, HV and VH that are not coherent, or crosstalk
            that grows instead of settling (targets that are not distributed).
    """
    if method not in ("quegan", "ainsworth"):
        raise DataError(f"there is no method {method!r}", "use quegan or ainsworth")
    values = np.asarray(image, dtype=np.complex128)
    if values.ndim < 2 or len(values) != 4:
        raise DataError(f"an image of shape {values.shape} is not four channels", f"give {', '.join(CHANNELS)}")
    use = np.isfinite(values).all(axis=0)
    if mask is not None:
        use &= np.asarray(mask, dtype=bool)
    pixels = values[:, use]
    count = pixels.shape[1]
    if count < LEAST_PIXELS:
        raise DataError(
            f"{count} pixels of distributed targets are too few (at least {LEAST_PIXELS})", "give a larger region"
        )
    blocks = list(np.array_split(np.arange(count), BLOCKS))
    sums = np.stack([pixels[:, part] @ pixels[:, part].conj().T for part in blocks])
    total = sums.sum(axis=0)
    if not (np.diagonal(total).real > 0).all():
        empty = [name for name, power in zip(CHANNELS, np.diagonal(total).real, strict=True) if not power > 0]
        raise DataError(f"channel {', '.join(empty)} is empty in the region", "check switches and cables")
    alike = float(abs(total[HH, VV]) / np.sqrt(total[HH, HH].real * total[VV, VV].real))
    if alike > LARGEST_CO_COHERENCE:
        raise DataError(
            f"HH and VV of the region are one and the same (coherence {alike:.3f}), as of a single target",
            "choose a region of many scatterers, such as vegetation",
        )
    whole = _solve(total / count, method)
    balanced = _corrected(total / count, whole)
    coherence = float(abs(balanced[HV, VH]) / np.sqrt(balanced[HV, HV].real * balanced[VH, VH].real))
    if not coherence >= LEAST_COHERENCE:
        raise DataError(
            f"HV and VH of the region have a coherence of {coherence:.2f} (at least {LEAST_COHERENCE})",
            "choose a region of vegetation whose cross-polarized return stands above the noise",
        )
    parts = np.array(
        [_solve((total - part) / (count - len(own)), method) for part, own in zip(sums, blocks, strict=True)]
    )
    spread = np.sqrt((BLOCKS - 1) * np.mean(np.abs(parts - parts.mean(axis=0)) ** 2, axis=0))
    u, v, w, z, ratio = whole
    return CrosstalkEstimate(
        np.array([[1, w], [u, 1]]),
        np.array([[1, v], [z, 1]]),
        complex(ratio),
        coherence,
        count,
        {"u": spread[0], "v": spread[1], "w": spread[2], "z": spread[3], "cross_ratio": spread[4] / abs(ratio)},
    )


def _solve(covariance: Complexes, method: Method) -> Complexes:
    """(u, v, w, z, cross ratio) of a covariance (4, 4)."""
    found = np.array([0, 0, 0, 0, 1], dtype=np.complex128)
    for _ in range(STEPS):
        found[4] *= _cross_ratio(_corrected(covariance, found, balanced=False)) / found[4]
        step = _increment(_corrected(covariance, found), method)
        # Seen behind gains that balance HV and VH: crosstalk of a path over its own channel scales by that gain.
        root = np.sqrt(found[4])
        found[:4] += step * np.array([root, 1 / root, 1 / root, root])
        if not np.isfinite(found).all() or np.abs(found[:4]).max() > MOST_CROSSTALK:
            raise DataError(
                "the crosstalk that would explain the region is above -6 dB",
                "choose a region of many scatterers without a preferred direction, such as vegetation",
            )
        if np.abs(step).max() < SMALLEST_STEP:
            break
    found[4] = _cross_ratio(_corrected(covariance, found, balanced=False))
    return found


def _corrected(covariance: Complexes, found: Complexes, *, balanced: bool = True) -> Complexes:
    """Covariance with the crosstalk found so far taken off, and with HV and VH balanced."""
    u, v, w, z, ratio = found
    inverse = np.linalg.inv(np.kron(np.array([[1, v], [z, 1]]).T, np.array([[1, w], [u, 1]])))
    if balanced:
        root = np.sqrt(ratio)
        inverse = np.array([1, 1 / root, root, 1])[:, None] * inverse
    return np.asarray(inverse @ covariance @ inverse.conj().T)


def _cross_ratio(covariance: Complexes) -> complex:
    """HV over VH by total least squares (noise alike in both)."""
    main = np.linalg.eigh(covariance[HV : VH + 1, HV : VH + 1])[1][:, -1]
    if main[1] == 0:
        raise DataError("channel VH of the region is empty", "check switches and cables")
    return complex(main[0] / main[1])


def _increment(c: Complexes, method: Method) -> Complexes:
    """(u, v, w, z) that explain a corrected and balanced covariance, by the four equations of the module."""
    hh, vv, both, x = c[HH, HH].real, c[VV, VV].real, c[HH, VV], abs(c[HV, VH])
    linear = np.array(
        [[hh, 0, 0, np.conj(both)], [0, hh, np.conj(both), 0], [both, 0, 0, vv], [0, both, vv, 0]], dtype=np.complex128
    )
    conjugate = x * np.array([[0, 0, 1, 1], [0, 0, 1, 1], [1, 1, 0, 0], [1, 1, 0, 0]])
    seen = np.array([c[HV, HH], c[VH, HH], c[HV, VV], c[VH, VV]])
    if method == "ainsworth":
        seen = seen - np.repeat([seen[:2].mean(), seen[2:].mean()], 2)
    system = np.block([[linear.real + conjugate, -linear.imag], [linear.imag, linear.real - conjugate]])
    scale = np.sqrt(np.tile([hh, hh, vv, vv], 2))
    columns = np.sqrt(np.tile([hh, hh, vv, vv], 2))
    balanced = system / scale[:, None] / columns
    solved = np.linalg.solve(balanced, np.concatenate([seen.real, seen.imag]) / scale) / columns
    return np.asarray(solved[:4] + 1j * solved[4:])
