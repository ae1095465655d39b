"""Calibration targets as an image shows them: what is expected, what was found, and whether it may be used."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.calibration_inputs import FocusedImage, TargetSpec
from processing.calibration.distortion import CHANNELS
from processing.calibration.near_field import near_field
from processing.calibration.offset import background_power, locate_target
from processing.calibration.polarimetric import MeasuredTarget, ReferenceErrors
from processing.calibration.rcs import to_dbsm
from processing.calibration.target_checks import GOOD, Verdict, check_orientation
from processing.errors import DataError
from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.scene.model import Reflector
from processing.scene.radar_response import apparent_scattering

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

PEAK_SD_CELLS = 0.5
"""Standard deviation of a peak's place in range by the parabola, over resolution cells c / 2B and the noise's amplitude
over the peak's: 0.49 with a Hann window over the ramp, 0.39 without one."""
NUMERICAL_FLOOR = 1e-9
"""Least noise over a target's power: what single precision and interpolation leave."""


@dataclass(frozen=True)
class TargetView:
    """A stated target, and what was found of it."""

    spec: TargetSpec
    expected: Complexes
    """(2, 2) apparent S[rx, tx] over the aperture, sqrt(m^2)."""
    verdict: Verdict
    values: Complexes
    """(4,) HH, HV, VH, VV, mean over the repeats; NaN for channels that were not recorded, and where it was refused."""
    noise: Floats
    """(4,) noise power of that mean."""
    x_m: float = float("nan")
    y_m: float = float("nan")
    snr_db: float = float("nan")
    """In the channel in which it is expected to be strongest."""
    repeats: int = 1
    amplitude_sd_db: float = 0.0
    """Standard uncertainty of the mean's amplitude from how much the repeats differ, dB."""
    clipped: float = 0.0
    """Share of the beat's samples at full scale."""

    @property
    def whole(self) -> bool:
        """Whether all four channels were measured."""
        return bool(np.isfinite(self.values).all())

    def measured(self) -> MeasuredTarget:
        """As the numerics take it."""
        return MeasuredTarget(
            self.spec.label,
            self.values,
            self.noise,
            self.expected,
            self.spec.angle_sd_rad if self.spec.kind == "dihedral" else 0.0,
            self.amplitude_sd_db,
            self.repeats,
        )

    def refused(self, verdict: Verdict) -> TargetView:
        """The same with a verdict that speaks against it."""
        return replace(self, verdict=verdict)

    def summary(self) -> dict[str, Any]:
        """For settings, JSON and reports."""
        return {
            "name": self.spec.label,
            "kind": self.spec.kind,
            "ok": self.verdict.ok,
            "reason": self.verdict.reason,
            "advice": self.verdict.advice,
            "x_m": self.x_m,
            "y_m": self.y_m,
            "snr_db": self.snr_db,
            "repeats": self.repeats,
            "repeat_sd_db": self.amplitude_sd_db,
            "clipped": self.clipped,
        }


def unseen(spec: TargetSpec, expected: Complexes, verdict: Verdict, **known: Any) -> TargetView:
    """A target that was refused before anything of it was measured."""
    return TargetView(spec, expected, verdict, np.full(4, np.nan + 0j), np.full(4, np.nan), **known)


def expected_scattering(focused: FocusedImage, target: TargetSpec) -> Complexes:
    """Apparent S[rx, tx] of a target in an image, (2, 2) sqrt(m^2): the mean over the aperture as the image weighs it.

    Raises:
        PolfuseError: it returns nothing to this aperture at its stated angles.
    """
    reflector = target.reflector(focused.z_m)
    weights = focused.pulse_weights(np.asarray(reflector.position_m))
    if target.near_field:
        s = _near(focused, reflector, weights)
    else:
        s = apparent_scattering(reflector, focused.antenna_m, focused.wavelength_m, weights)
    if not np.any(np.abs(s) ** 2 > 0):
        raise PolfuseError(
            f"a {target.kind} with azimuth {np.degrees(target.azimuth_rad):.1f} and elevation "
            f"{np.degrees(target.elevation_rad):.1f} degrees returns nothing to this aperture",
            where=target.label,
            advice="check the stated angles (a trihedral's are measured from its edges: 45 and 35.3 on its axis)",
        )
    return np.asarray(s, dtype=np.complex128)


def _near(focused: FocusedImage, reflector: Reflector, weights: Floats) -> Complexes:
    """Apparent S[rx, tx] by physical optics at the antennas' true distances, lit by the pattern that was told."""
    beamwidth = focused.settings.get("beamwidth_rad")
    return near_field(
        reflector,
        focused.antenna_m,
        focused.wavelength_m,
        weights,
        beamwidth_rad=None if beamwidth is None else float(beamwidth),
        depression_rad=float(focused.settings.get("depression_rad", 0.0)),
    ).near


def by_channel(scattering: Complexes) -> dict[str, complex]:
    """Elements of S[rx, tx] by channel name (transmit-then-receive)."""
    return {name: complex(scattering["HV".index(name[1]), "HV".index(name[0])]) for name in CHANNELS}


def reference_errors(focused: FocusedImage, target: TargetSpec, view: TargetView | None = None) -> ReferenceErrors:
    """How well the RCS of the target that gives the constant is known, and how well its range was measured.

    A target whose place is off stands as it was set up, so that it is seen under another angle by the error over its
    range.

    Args:
        focused: the image in which it stands.
        target: as stated.
        view: as found; without it the range counts as exact.
    """

    def rcs_dbsm(errors: Floats) -> Floats:
        found = np.empty(len(errors))
        slant = float(np.hypot(np.hypot(target.x_m, target.y_m), focused.z_m + target.height_m))
        for row, (azimuth, elevation, x, y, edge) in enumerate(errors):
            # Along the line of sight on the ground, and across it.
            bearing = np.arctan2(target.x_m, target.y_m)
            across = x * np.cos(bearing) - y * np.sin(bearing)
            along = x * np.sin(bearing) + y * np.cos(bearing)
            drop = (focused.z_m + target.height_m) / slant
            changed = replace(
                target,
                azimuth_rad=target.azimuth_rad + azimuth + across / slant,
                elevation_rad=target.elevation_rad + elevation + along * drop / slant,
                edge_m=max(target.edge_m + edge, 1e-3),
            )
            reflector = changed.reflector(focused.z_m)
            s = apparent_scattering(reflector, focused.antenna_m, focused.wavelength_m, weights)
            found[row] = to_dbsm(np.max(np.abs(s) ** 2))
        return found

    weights = focused.pulse_weights(np.asarray(target.reflector(focused.z_m).position_m))
    sds = (target.angle_sd_rad, target.position_sd_m, target.edge_sd_m)
    found = ReferenceErrors(*sds, rcs_dbsm=rcs_dbsm if any(sds) else None)
    if view is None or not np.isfinite(view.snr_db):
        return found
    slant2 = view.y_m**2 + view.x_m**2 + focused.z_m**2
    cell = SPEED_OF_LIGHT_M_S / (2 * focused.bandwidth_hz) * np.sqrt(slant2) / view.y_m
    return replace(
        found,
        range_sd_m=float(PEAK_SD_CELLS * cell * 10 ** (-view.snr_db / 20)),
        # The image holds R^2 in amplitude: 20 log10 of it changes by 40 / ln 10 y / R^2.
        range_db_per_m=float(40 / np.log(10) * view.y_m / slant2),
    )


def look_in_image(focused: FocusedImage, target: TargetSpec, *, radius_m: float, min_snr_db: float) -> TargetView:
    """Find a target in a focused image and judge it. What is wrong with it is told by its verdict.

    Args:
        focused: the image.
        target: as stated.
        radius_m: how far from its stated place its peak may be, m.
        min_snr_db: least peak over background, dB.

    Raises:
        PolfuseError: it returns nothing at its stated angles.
    """
    expected = expected_scattering(focused, target)
    wanted = by_channel(expected)
    strongest = max(focused.channels, key=lambda name: abs(wanted[name]))
    try:
        peak = locate_target(
            focused.image,
            focused.x_m,
            focused.y_m,
            target.image_place(focused.z_m),
            radius_m=radius_m,
            reference=focused.channels.index(strongest),
            min_snr_db=min_snr_db,
            gain=focused.range_gain,
        )
    except DataError as error:
        return unseen(target, expected, Verdict(False, error.what, error.advice))
    values, noise = np.full(4, np.nan + 0j), np.full(4, np.nan)
    floor = NUMERICAL_FLOOR * peak.power
    for index, name in enumerate(focused.channels):
        values[CHANNELS.index(name)] = peak.values[index]
        noise[CHANNELS.index(name)] = max(background_power(focused.image[index]), floor)
    found = TargetView(target, expected, GOOD, values, noise, peak.x_m, peak.y_m, peak.snr_db)
    return found.refused(judge(found)) if found.whole else found


def judge(view: TargetView) -> Verdict:
    """Whether a target that was found is the one that it is said to be, by its four channels."""
    return check_orientation(view.spec.kind, view.values, view.spec.fold_rad)
