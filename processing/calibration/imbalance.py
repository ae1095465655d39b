"""The isolated-antenna case: a radar whose antennas do not leak into each other.

R and T of ``M = R S T`` are then diagonal (see :mod:`processing.calibration.distortion`), and relative to HH the
channels carry ``VV: f_r f_t``, ``HV: f_r``, ``VH: f_t`` (names transmit-then-receive; ``f_r = R_vv / R_hh``, ``f_t =
T_vv / T_hh``). A trihedral gives the product f_r f_t; the quotient f_r / f_t comes from any target with S_hv = S_vh.
What a trihedral shows in HV and VH is crosstalk, which is reported, not removed.
Source: Freeman, SAR calibration: an overview (IEEE TGRS 1992), without its crosstalk terms.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.calibration.distortion import Distortion
from processing.errors import DataError


def imbalance(co_ratio: complex, cross_ratio: complex | None) -> Distortion:
    """Isolated antennas' gains of V over H, from VV / HH on a trihedral and HV / VH on a reciprocal target.

    ``f_r^2 = co_ratio * cross_ratio`` leaves the common sign of f_r and f_t open; the root with the smaller phase is
    taken, which is right while the receive phases of V and H differ by less than 90 degrees. The sign matters for
    S_hv alone, not for its power. Without a cross ratio both sides are taken as alike.

    Raises:
        DataError: a ratio that is zero or not finite.
    """
    cross = 1.0 + 0j if cross_ratio is None else complex(cross_ratio)
    for name, ratio in (("VV / HH", co_ratio), ("HV / VH", cross)):
        if not np.isfinite(ratio) or ratio == 0:
            raise DataError(f"{name} of the calibration target is {ratio}", "choose a target that all channels see")
    receive = complex(np.sqrt(complex(co_ratio) * cross))
    return Distortion.isolated(receive, complex(co_ratio) / receive)


def crosstalk_db(values: Mapping[str, complex]) -> dict[str, float]:
    """Crosstalk seen on a trihedral, dB: |HV / HH|^2 and |VH / VV|^2, for the channels that are there.

    Each is what arrives with the wrong polarization over what arrives with the right one for the same transmitted
    polarization. Missing co-polarized partners fall back to HH.
    """
    found = {}
    for cross, co in (("HV", "HH"), ("VH", "VV")):
        if cross in values:
            ratio = abs(values[cross]) / abs(values.get(co, values["HH"]))
            found[cross] = float(20 * np.log10(ratio)) if ratio > 0 else -float("inf")
    return found


@dataclass(frozen=True)
class CrossRatio:
    """HV / VH of reciprocal scatterers."""

    ratio: complex
    coherence: float
    """|<HV VH*>| / sqrt(<|HV|^2> <|VH|^2>); noise and crosstalk lower it."""
    pixels: int


def cross_ratio(
    s_hv: ArrayLike, s_vh: ArrayLike, mask: ArrayLike, *, min_pixels: int = 16, min_coherence: float = 0.9
) -> CrossRatio | None:
    """HV / VH over the pixels of a mask, by total least squares (noise alike in both channels).

    Args:
        s_hv, s_vh: complex images of one shape.
        mask: pixels in which true cross-polarized returns dominate crosstalk and noise.
        min_pixels: fewest pixels.
        min_coherence: least coherence.

    Returns:
        The ratio, or None where the data hold no usable cross-polarized target.
    """
    use = np.asarray(mask, dtype=bool) & np.isfinite(s_hv) & np.isfinite(s_vh)
    hv = np.asarray(s_hv, dtype=np.complex128)[use]
    vh = np.asarray(s_vh, dtype=np.complex128)[use]
    if hv.size < min_pixels:
        return None
    both = np.stack([hv, vh])
    covariance = both @ both.conj().T / hv.size
    power = np.sqrt(covariance[0, 0].real * covariance[1, 1].real)
    coherence = float(abs(covariance[0, 1]) / power) if power > 0 else 0.0
    if coherence < min_coherence:
        return None
    main = np.linalg.eigh(covariance)[1][:, -1]
    return CrossRatio(complex(main[0] / main[1]), coherence, int(hv.size))


def cross_polarized_pixels(
    image: Mapping[str, ArrayLike], crosstalk: Mapping[str, float], noise: Mapping[str, float], margin_db: float = 10.0
) -> NDArray[np.bool_]:
    """Pixels whose HV and VH stand ``margin_db`` above both the noise and the crosstalk from the co-polarized channels.

    Args:
        image: complex images HH, HV, VH, VV of one shape.
        crosstalk: dB of HV and VH, as from :func:`crosstalk_db`.
        noise: mean background power of HV and VH.
        margin_db: dB above both.
    """
    power = {name: np.abs(np.asarray(values)) ** 2 for name, values in image.items()}
    strongest = np.maximum(power["HH"], power["VV"])
    margin = 10 ** (margin_db / 10)
    good = np.ones(strongest.shape, dtype=bool)
    for name in ("HV", "VH"):
        leak = strongest * 10 ** (crosstalk[name] / 10)
        good &= power[name] > margin * np.maximum(leak, noise[name])
    return good
