"""Whether what was measured is the target that it is said to be: tests that the radar's imbalance cannot spoil.

With isolated antennas ``HV VH / (HH VV)`` is the same before and after imbalance: minus the squared tangent of twice
the fold's angle for a dihedral, 0 for a trihedral or plate. Crosstalk below -10 dB changes it by no more than a few
degrees of fold.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.calibration.distortion import CHANNELS, matrices
from processing.calibration.rcs import to_dbsm
from processing.calibration.whitt import LEAST_CONTRAST, contrast
from processing.errors import DataError

Complexes = NDArray[np.complex128]

LARGEST_TURN_RAD = float(np.radians(12.0))
"""By which a target's fold may seem to be off: crosstalk of -10 dB looks like 9 degrees."""
LARGEST_CROSS_DB = -8.0
"""Cross over co-polarized return of a target without a fold, at most."""
DEAD = 1e-3
"""Amplitude of a channel over its partner's (HH and VV, HV and VH) below which it is dead, and of a pair over the
strongest channel below which it is too weak to be judged."""
LEAST_JUDGED = 0.5
"""Amplitude that a target returns in a pair of channels, of its whole, from which on they are judged: what crosstalk
alone brings into a pair may be as good as nothing in one of the two."""
LARGEST_RCS_ERROR_DB = 3.0
"""By which a target's RCS may differ from the other targets', beyond three standard deviations."""


class Verdict(NamedTuple):
    """Whether a target may be used."""

    ok: bool
    reason: str
    """Empty where it may."""
    advice: str


GOOD = Verdict(True, "", "")


def fold_seen(values: ArrayLike) -> float:
    """Angle of a dihedral's fold from the nearest of level and upright, 0 to 45 degrees, in rad, from its channels.

    ``tan^2(2 f) = |HV VH| / |HH VV|``, which gains of the channels do not change.

    Args:
        values: (4,) complex in the order HH, HV, VH, VV.
    """
    hh, hv, vh, vv = np.abs(np.asarray(values, dtype=np.complex128))
    return float(0.5 * np.arctan2(np.sqrt(hv * vh), np.sqrt(hh * vv)))


def check_orientation(kind: str, values: ArrayLike, fold_rad: float = 0.0) -> Verdict:
    """Judge a target's orientation about the line of sight by its four channels.

    Args:
        kind: ``"trihedral"``, ``"plate"`` or ``"dihedral"``.
        values: (4,) complex in the order HH, HV, VH, VV.
        fold_rad: a dihedral's stated fold, from horizontal.
    """
    seen = np.asarray(values, dtype=np.complex128)
    if not np.isfinite(seen).all():
        return Verdict(False, f"a channel of the {kind} is undefined", "record it again with all four channels")
    size = np.abs(seen)
    own = 2 * fold_rad if kind == "dihedral" else 0.0
    for one, other, returned in ((0, 3, np.cos(own)), (1, 2, np.sin(own))):
        if abs(returned) < LEAST_JUDGED:
            continue
        low, high = sorted((one, other), key=lambda channel: float(size[channel]))
        seen_at_all = size[high] > DEAD * size.max()
        if not size.max() > 0 or (seen_at_all and not size[low] > DEAD * size[high]):
            return Verdict(
                False,
                f"channel {CHANNELS[low]} shows nothing of the {kind}",
                "check the switches, the antennas and their cables",
            )
    fold = fold_seen(seen)
    if kind != "dihedral":
        cross = float(to_dbsm(max(size[1], size[2]) ** 2) - to_dbsm(size[0] * size[3]))
        if cross > LARGEST_CROSS_DB:
            return Verdict(
                False,
                f"its cross-polarized return is {cross:.1f} dB of the co-polarized one, which a {kind} has not",
                "check that it is the right target, that it looks at the radar and that nothing else stands near it",
            )
        return GOOD
    # Distance from the nearest of level and upright: 0 to 45 degrees.
    stated = abs((fold_rad + np.pi / 4) % (np.pi / 2) - np.pi / 4)
    if abs(fold - stated) > LARGEST_TURN_RAD:
        return Verdict(
            False,
            f"its fold stands {np.degrees(fold):.0f} degrees from level or upright instead of {np.degrees(stated):.0f}",
            "turn it about the line of sight and measure it again",
        )
    return GOOD


def check_different(names: tuple[str, str], first: ArrayLike, second: ArrayLike) -> None:
    """Refuse two targets of different kind that look alike.

    Args:
        names: of the two.
        first, second: (4,) complex channel values.

    Raises:
        DataError: they look alike, or the first one is singular.
    """
    value = contrast(matrices(first), matrices(second))
    if not value > LEAST_CONTRAST:
        raise DataError(
            f"{names[0]} and {names[1]} look alike to the radar (contrast {value:.2f} of 1)",
            "one of them is not what it is said to be, or the same target stood there twice",
        )


def check_amplitude(rcs_m2: float, expected_m2: float, sd_db: float) -> Verdict:
    """Judge a target's calibrated RCS against the one expected.

    Args:
        rcs_m2: measured with the constant of another target, m^2.
        expected_m2: from its size and angles, m^2.
        sd_db: standard deviation of the difference, dB.
    """
    error = float(to_dbsm(rcs_m2) - to_dbsm(expected_m2))
    if not abs(error) <= LARGEST_RCS_ERROR_DB + 3 * sd_db:
        return Verdict(
            False,
            f"its RCS is {abs(error):.1f} dB {'above' if error > 0 else 'below'} what its size and angles give",
            "check the stated edge and angles, that it looks at the radar and that nothing stands before it"
            if error < 0
            else "check the stated edge, and that nothing else stands near it",
        )
    return GOOD


def average_repeats(values: ArrayLike) -> tuple[Complexes, Complexes]:
    """Mean of repeated measurements of one target, whose place differs by parts of a wavelength.

    Each repeat is turned by one phase for all channels to agree with their mean, so that only what the place does to
    the phase is lost, not what the channels have among themselves.

    Args:
        values: (repeats, channels) complex; repeats that are not finite are left out.

    Returns:
        (channels,) mean, and (repeats used, channels) the repeats so turned.

    Raises:
        DataError: no repeat is finite.
    """
    all_repeats = np.asarray(values, dtype=np.complex128)
    repeats = all_repeats[np.isfinite(all_repeats).all(axis=1)]
    if not len(repeats):
        raise DataError("no repeat of the target is whole", "record it again with all channels")
    # The principal direction of the repeats does not depend on their phases.
    main = np.linalg.svd(repeats, full_matrices=False)[2][0]
    overlap = repeats @ main.conj()
    phase = np.exp(-1j * np.angle(overlap / np.exp(1j * np.angle(overlap[0]))))
    turned = repeats * phase[:, None]
    return turned.mean(axis=0), turned
