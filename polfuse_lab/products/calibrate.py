"""Focused amplitudes to scattering amplitudes in sqrt(m^2): the stages ``"calibration"`` and ``"polarimetry"``."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.calibration_inputs import (
    SKY_NOISE_SD_DB,
    FocusedImage,
    TargetSpec,
    read_focused,
    read_reference,
    sky_noise,
)
from polfuse_lab.products.store import Products
from processing.calibration.imbalance import (
    NO_IMBALANCE,
    Imbalance,
    balance,
    cross_polarized_pixels,
    cross_ratio,
    crosstalk_db,
    imbalance,
)
from processing.calibration.noise import background_by_row
from processing.calibration.offset import (
    AmplitudeMap,
    TargetPeak,
    background_power,
    locate_target,
    offset_map,
    snr_sd_db,
    two_point_map,
)
from processing.calibration.rcs import accuracy, to_dbsm, trihedral_angle_error
from processing.polarimetry.pauli import pauli_vector, span
from processing.scene.radar_response import apparent_scattering

__all__ = ["CalibrationResult", "CheckResult", "TargetSpec", "calibrate"]

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

ODD_BOUNCE = ("trihedral", "plate")
"""Kinds of target whose S is a multiple of the identity, which the calibration needs."""


@dataclass(frozen=True)
class CheckResult:
    """A second target, measured with the calibration of the first."""

    channel: str
    """Channel in which it was measured: the one in which it is expected to be strongest."""
    x_m: float
    y_m: float
    rcs_dbsm: float
    expected_dbsm: float
    error_db: float
    """Measured minus expected, dB."""
    sd_db: float
    """Standard deviation of that from noise and from the calibration's own, dB."""
    thesis_accuracy_percent: float
    """Ratio of the two dBsm numbers (thesis 5.13); see :func:`processing.calibration.rcs.accuracy`."""
    values: dict[str, complex] = field(repr=False)
    """Calibrated scattering amplitude by channel, sqrt(m^2)."""


@dataclass(frozen=True)
class CalibrationResult:
    """What the calibration found."""

    products: Path
    constant_db: float
    """dBsm minus dB of image power, at the target (everywhere, in mode "offset")."""
    constant_sd_db: float
    """Its standard deviation from the target's SNR and the stated error of its angles, dB."""
    slope: float
    """dBsm per dB; 1 except in mode "thesis"."""
    target: TargetPeak
    expected_dbsm: float
    """Apparent RCS of the target over the aperture, dBsm."""
    crosstalk_db: dict[str, float]
    """Crosstalk by cross-polarized channel, dB."""
    imbalance: Imbalance
    imbalance_db: float
    """VV over HH, amplitude, dB; NaN without VV."""
    imbalance_deg: float
    """VV over HH, phase, degrees; NaN without VV."""
    cross_imbalance: complex | None
    """HV over VH from reciprocal scatterers, or None where the scene holds none."""
    noise_source: str
    noise_equivalent_dbsm: float
    """Noise-equivalent RCS in HH at the target's ground range, dBsm."""
    check: CheckResult | None

    @property
    def worst_crosstalk_db(self) -> float:
        """Largest crosstalk of the channels, dB; NaN without a cross-polarized channel."""
        return max(self.crosstalk_db.values(), default=float("nan"))


def calibrate(
    products_path: Path | str,
    target: TargetSpec,
    *,
    sky: Path | str | None = None,
    check: TargetSpec | None = None,
    mode: Literal["offset", "thesis"] = "offset",
    search_radius_m: float = 1.0,
    min_snr_db: float = 10.0,
    reference: Path | str | None = None,
) -> CalibrationResult:
    """Calibrate the focused image of a products file on a reflector of known RCS, in it or in a reference.

    The reflector's expected RCS is its apparent one: the mean of its scattering amplitude over the antenna positions,
    which is what the focused image shows. Mode "offset" applies one constant to all channels (thesis 5.9 with slope 1)
    after removing the imbalance of the channels; mode "thesis" draws the straight line of thesis 5.9 through target and
    noise and leaves the channels as they are.

    Writes stage "calibration" (``scattering`` (C, ny, nx) complex64 sqrt(m^2), ``noise_equivalent_rcs_m2`` (C, ny),
    ``x_m``, ``y_m``) and, with HH, VV and a cross-polarized channel, stage "polarimetry" (``pauli`` (3, ny, nx),
    ``span`` m^2, ``x_m``, ``y_m``).

    Args:
        products_path: products file with stages "ranging" and "focus".
        target: trihedral or plate to calibrate on.
        sky: session (or products file) of a look at the clear sky with the same settings, for the noise.
        check: another reflector to measure with the calibration.
        mode: see above.
        search_radius_m: how far from its stated place a target's peak may be, m.
        min_snr_db: least peak over background, dB.
        reference: products file with the target's focused image, made with the same settings from a calibration
            series; the target is looked for in ``products_path`` itself where left out.

    Raises:
        PolfuseError: stages or channels that are missing, a reference that was made otherwise, or files that cannot be
            used.
        DataError: a target that is not there, too weak, or returns nothing at its angles.
    """
    products = Products(products_path)
    focused = read_focused(products)
    _refuse_unsuitable(products.path, target)
    hh = focused.channels.index("HH")
    seen = focused if reference is None else read_reference(Products(reference), focused)
    peak = locate_target(
        seen.image,
        seen.x_m,
        seen.y_m,
        target.image_place(seen.z_m),
        radius_m=search_radius_m,
        reference=seen.channels.index("HH"),
        min_snr_db=min_snr_db,
        gain=seen.range_gain,
    )
    # Where the target's range is in this image, for the noise there.
    row = int(np.argmin(np.abs(focused.y_m - peak.y_m)))
    expected = _expected(seen, target)
    expected_m2 = float(abs(expected["HH"]) ** 2)
    noise, noise_source = _noise(focused, sky)
    at_target = dict(zip(seen.channels, peak.values, strict=True))
    crosstalk = crosstalk_db(at_target)
    ratio = _cross_ratio(focused, crosstalk)
    gains = _gains(at_target, ratio)
    if mode == "offset":
        applied, amplitudes = gains, offset_map(peak.power, expected_m2)
    else:
        row_noise = float(noise[hh, row])
        applied, amplitudes = NO_IMBALANCE, two_point_map(peak.power, expected_m2, row_noise)
    balanced = balance(focused.image, focused.channels, applied)
    scattering = amplitudes.scattering(balanced)
    equivalent = _equivalent_rcs(noise, focused.channels, applied, amplitudes)
    constant_sd = float(np.hypot(snr_sd_db(peak.snr_db), _angle_sd_db(seen, target)))
    result = CalibrationResult(
        products=products.path,
        constant_db=float(to_dbsm(expected_m2) - to_dbsm(peak.power)),
        constant_sd_db=constant_sd,
        slope=amplitudes.slope,
        target=peak,
        expected_dbsm=float(to_dbsm(expected_m2)),
        crosstalk_db=crosstalk,
        imbalance=gains,
        imbalance_db=gains.co_db if "VV" in at_target else float("nan"),
        imbalance_deg=gains.co_deg if "VV" in at_target else float("nan"),
        cross_imbalance=ratio,
        noise_source=noise_source,
        noise_equivalent_dbsm=float(to_dbsm(equivalent[hh, row])),
        check=None
        if check is None
        else _checked(focused, balanced, amplitudes, check, search_radius_m, min_snr_db, constant_sd),
    )
    others = [Path(path) for path in (sky, reference) if path is not None]
    _write(products, focused, scattering, equivalent, result, others, mode=mode, target=target, check=check, sky=sky)
    return result


def _refuse_unsuitable(path: Path, target: TargetSpec) -> None:
    if target.kind not in ODD_BOUNCE:
        raise PolfuseError(
            f"a {target.kind} is no target to calibrate on, for its channels differ",
            where=str(path),
            advice=f"use a {' or a '.join(ODD_BOUNCE)}, and the {target.kind} as --check",
        )


def _expected(focused: FocusedImage, target: TargetSpec) -> dict[str, complex]:
    """Apparent scattering by channel name (transmit-then-receive), sqrt(m^2)."""
    reflector = target.reflector(focused.z_m)
    weights = focused.pulse_weights(np.asarray(reflector.position_m))
    s = apparent_scattering(reflector, focused.antenna_m, focused.wavelength_m, weights)
    if not np.any(np.abs(s) ** 2 > 0):
        raise PolfuseError(
            f"a {target.kind} with azimuth {np.degrees(target.azimuth_rad):.1f} and elevation "
            f"{np.degrees(target.elevation_rad):.1f} degrees returns nothing to this aperture",
            where=target.kind,
            advice="check the stated angles (a trihedral's are measured from its edges: 45 and 35.3 on its axis)",
        )
    return {name: complex(s["HV".index(name[1]), "HV".index(name[0])]) for name in ("HH", "HV", "VH", "VV")}


def _noise(focused: FocusedImage, sky: Path | str | None) -> tuple[Floats, str]:
    """Noise power by channel and image row, and where it comes from."""
    if sky is not None:
        return sky_noise(sky, focused), f"sky look {Path(sky).name}"
    return background_by_row(focused.image), "background of the image (an upper bound)"


def _cross_ratio(focused: FocusedImage, crosstalk: dict[str, float]) -> complex | None:
    if not {"HH", "HV", "VH", "VV"} <= set(focused.channels):
        return None
    image = {name: focused.image[index] for index, name in enumerate(focused.channels)}
    background = {name: background_power(image[name]) for name in ("HV", "VH")}
    found = cross_ratio(image["HV"], image["VH"], cross_polarized_pixels(image, crosstalk, background))
    return None if found is None else found.ratio


def _gains(at_target: dict[str, Any], ratio: complex | None) -> Imbalance:
    if "VV" not in at_target:
        return NO_IMBALANCE
    return imbalance(at_target["VV"] / at_target["HH"], ratio)


def _equivalent_rcs(noise: Floats, channels: tuple[str, ...], gains: Imbalance, amplitudes: AmplitudeMap) -> Floats:
    gain = np.array([abs(gains.gain(name)) ** 2 for name in channels])
    return np.asarray(10 ** (amplitudes.rcs_dbsm(noise / gain[:, None]) / 10))


def _angle_sd_db(focused: FocusedImage, target: TargetSpec) -> float:
    if target.angle_sd_rad == 0 or target.kind != "trihedral":
        return 0.0
    error = trihedral_angle_error(
        target.edge_m,
        focused.wavelength_m,
        target.azimuth_rad,
        target.elevation_rad,
        target.angle_sd_rad,
        target.angle_sd_rad,
    )
    return error.quadrature_db


def _checked(
    focused: FocusedImage,
    balanced: Complexes,
    amplitudes: AmplitudeMap,
    check: TargetSpec,
    radius_m: float,
    min_snr_db: float,
    constant_sd_db: float,
) -> CheckResult:
    expected = _expected(focused, check)
    channel = max(focused.channels, key=lambda name: abs(expected[name]))
    peak = locate_target(
        balanced,
        focused.x_m,
        focused.y_m,
        check.image_place(focused.z_m),
        radius_m=radius_m,
        reference=focused.channels.index(channel),
        min_snr_db=min_snr_db,
        gain=focused.range_gain,
    )
    measured, truth = float(amplitudes.rcs_dbsm(peak.power)), float(to_dbsm(abs(expected[channel]) ** 2))
    compared = accuracy(measured, truth)
    return CheckResult(
        channel=channel,
        x_m=peak.x_m,
        y_m=peak.y_m,
        rcs_dbsm=measured,
        expected_dbsm=truth,
        error_db=compared.error_db,
        sd_db=float(np.hypot(amplitudes.slope * snr_sd_db(peak.snr_db), constant_sd_db)),
        thesis_accuracy_percent=compared.thesis_accuracy_percent,
        values=dict(zip(focused.channels, amplitudes.scattering(peak.values).tolist(), strict=True)),
    )


def _write(
    products: Products,
    focused: FocusedImage,
    scattering: Complexes,
    equivalent: Floats,
    result: CalibrationResult,
    others: list[Path],
    *,
    mode: str,
    target: TargetSpec,
    check: TargetSpec | None,
    sky: Path | str | None,
) -> None:
    axes = {"x_m": focused.x_m, "y_m": focused.y_m}
    settings = {
        "channels": list(focused.channels),
        "z_m": focused.z_m,
        "centre_hz": focused.centre_hz,
        "bandwidth_hz": focused.bandwidth_hz,
        "mode": mode,
        "target": target.summary(),
        "check": None if check is None else check.summary(),
        "constant_db": result.constant_db,
        "constant_sd_db": result.constant_sd_db,
        "slope": result.slope,
        "crosstalk_db": result.crosstalk_db,
        "imbalance_db": result.imbalance_db,
        "imbalance_deg": result.imbalance_deg,
        "cross_imbalance": None
        if result.cross_imbalance is None
        else [result.cross_imbalance.real, result.cross_imbalance.imag],
        "noise_source": result.noise_source,
        "noise_sd_db": None if sky is None else SKY_NOISE_SD_DB,
    }
    products.write(
        "calibration",
        {"scattering": scattering.astype(np.complex64), "noise_equivalent_rcs_m2": equivalent, **axes},
        settings=settings,
        inputs=[products.path, *others],
        units={"scattering": "sqrt(m^2)", "noise_equivalent_rcs_m2": "m^2", "x_m": "m", "y_m": "m"},
    )
    by_name = dict(zip(focused.channels, scattering, strict=True))
    crosses = [by_name[name] for name in ("HV", "VH") if name in by_name]
    if "VV" not in by_name or not crosses:
        return
    k = pauli_vector(by_name["HH"], sum(crosses) / len(crosses), by_name["VV"])
    products.write(
        "polarimetry",
        {"pauli": k.astype(np.complex64), "span": span(k).astype(np.float32), **axes},
        settings={
            "z_m": focused.z_m,
            "components": ["odd bounce", "even bounce", "cross-polarized"],
            "from": "complex amplitudes",
            "cross_channels": len(crosses),
        },
        inputs=[products.path],
        units={"pauli": "sqrt(m^2)", "span": "m^2", "x_m": "m", "y_m": "m"},
    )
