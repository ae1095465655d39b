"""What a rig will be able to do, by formulas: can, beam, range, resolution, swath, noise, far field, ambiguities."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from polfuse_lab.plans.prediction import NOISE_FIGURE_DB, POWER_W, predict_image
from polfuse_lab.plans.rail import RailSarPlan
from polfuse_lab.rig import Rig
from processing.calibration.radar_equation import noise_power, received_power
from processing.calibration.rcs import square_trihedral_rcs
from processing.errors import DataError
from processing.radar.can import RULE, design_can, single_mode_diameters_m
from processing.radar.ranging import unambiguous_range_m
from processing.sar.sensitivity import antenna_gain

EDGE_M = 1.2192
"""Edge of the thesis's corner reflectors: 4 ft."""
BEST_ELEVATION_RAD = math.asin(1 / math.sqrt(3))
"""A trihedral's axis: 35.264 degrees above its floor, 45 degrees between its walls."""


@dataclass(frozen=True)
class DesignValue:
    """One figure of a design."""

    value: float | bool | None
    """None where there is none (a beam that reaches the horizon has no far end)."""
    unit: str
    equation: str
    """How it follows, and from where."""
    note: str = ""


@dataclass(frozen=True)
class DesignWishes:
    """What a rig file does not tell."""

    at_m: float = 10.0
    """Ground range at which resolution, power and sensitivity are told, m."""
    aperture_m: float | None = None
    """Length of the synthetic aperture, m; the whole rail, if left out."""
    step_m: float = 0.0508
    """Distance between positions, m."""
    sweeps: int = 10
    """Up-ramps averaged at each position and channel."""
    can_diameter_m: float | None = None
    """Inner diameter of the cans, m; the middle of the thesis's rule, if left out."""
    edge_m: float = EDGE_M
    """Edge of the calibration target, m."""
    power_w: float = POWER_W
    """Transmitted power, W."""
    noise_figure_db: float = NOISE_FIGURE_DB
    """Noise figure of the receiver, dB."""


def design(rig: Rig, wishes: DesignWishes | None = None) -> dict[str, DesignValue]:
    """The figures of a rig, by name, in the order in which they are worth reading.

    Raises:
        DataError: a length or power that is not positive, or a can in which no wave travels.
    """
    wishes = DesignWishes() if wishes is None else wishes
    _check(wishes)
    return dict(
        [*_can(rig, wishes), *_ranging(rig), *_imaging(rig, wishes), *_power(rig, wishes), *_camera(rig, wishes)]
    )


Named = Iterator[tuple[str, DesignValue]]


def _check(wishes: DesignWishes) -> None:
    for name, value in vars(wishes).items():
        if name == "noise_figure_db":
            if not math.isfinite(value):
                raise DataError(f"a noise figure of {value} dB", "give a finite one")
        elif value is not None and not (math.isfinite(value) and value > 0):
            raise DataError(f"{name} is {value}", "give a positive, finite number")


def _can(rig: Rig, wishes: DesignWishes) -> Named:
    wavelength = rig.waveform.wavelength_m
    least, most = single_mode_diameters_m(wavelength)
    yield "wavelength", DesignValue(wavelength, "m", "c / f (thesis 5.1)")
    yield "can_diameter_least", DesignValue(least, "m", "TE11 travels: 1.8412 wavelength / pi")
    yield "can_diameter_most", DesignValue(most, "m", "TM01 does not: 2.4048 wavelength / pi")
    for name, share in zip(("can_rule_least", "can_rule_most"), RULE, strict=True):
        yield name, DesignValue(share * wavelength, "m", f"{share:.2f} wavelength (thesis 5.3)")
    diameter = wishes.can_diameter_m or sum(RULE) / 2 * wavelength
    can = design_can(diameter, wavelength)
    note = "" if can.single_mode else "a second mode (TM01) travels in it: the beam and the match depend on the probe"
    yield "can_diameter", DesignValue(diameter, "m", "as told, or the middle of the rule", note)
    yield (
        "guide_wavelength",
        DesignValue(can.guide_wavelength_m, "m", "wavelength / sqrt(1 - (wavelength / 1.706 D)^2) (thesis 5.2)"),
    )
    yield "can_single_mode", DesignValue(can.single_mode, "", "D below 2.4048 wavelength / pi", note)
    yield "probe_length", DesignValue(can.probe_m, "m", "wavelength / 4, to be trimmed")
    yield "probe_from_back", DesignValue(can.probe_from_back_m, "m", "guide wavelength / 4, to be trimmed")
    yield "can_length", DesignValue(can.length_m, "m", "3/4 guide wavelength")
    for name, width in (("can_beam_e", can.beamwidth_e_rad), ("can_beam_h", can.beamwidth_h_rad)):
        plane = "plane of the electric field" if name == "can_beam_e" else "plane across the electric field"
        yield name, DesignValue(math.degrees(width), "deg", f"half power of a TE11 aperture, {plane} (Balanis 12.2)")
    beam = math.radians(rig.geometry.beamwidth_deg)
    yield "beam", DesignValue(rig.geometry.beamwidth_deg, "deg", "half power, as the rig file tells")
    gain = 10 * math.log10(antenna_gain(beam))
    yield "antenna_gain", DesignValue(gain, "dBi", "2 (n + 1) of a cos^n power pattern with that beam")
    yield "antenna_far_field", DesignValue(2 * diameter**2 / wavelength, "m", "2 D^2 / wavelength")


def _ranging(rig: Rig) -> Named:
    wave = rig.waveform
    yield "range_resolution", DesignValue(wave.range_resolution_m, "m", "c / 2B (thesis 2.34)")
    beat = wave.bandwidth_hz / wave.ramp_up_s / (wave.range_resolution_m * wave.bandwidth_hz)
    yield "beat_per_metre", DesignValue(beat, "Hz/m", "2B / (c T)")
    longest = unambiguous_range_m(wave.bandwidth_hz, wave.ramp_up_s * rig.radar.sample_rate_hz)
    yield "unambiguous_range", DesignValue(longest, "m", "c T fs / 4B: the beat at half the sample rate")
    fastest = wave.wavelength_m / (4 * wave.sweep_period_s)
    yield "unambiguous_speed", DesignValue(fastest, "m/s", "wavelength / (4 sweep period), either way")


def _imaging(rig: Rig, wishes: DesignWishes) -> Named:
    aperture = min(wishes.aperture_m or rig.trolley.length_m, rig.trolley.length_m)
    step = min(wishes.step_m, aperture)
    plan = RailSarPlan(aperture_m=aperture, step_m=step, sweeps_per_channel=wishes.sweeps)
    told = predict_image(
        rig,
        plan.steps(mosaic=rig.has_mosaic),
        at_m=wishes.at_m,
        power_w=wishes.power_w,
        noise_figure_db=wishes.noise_figure_db,
    )
    assert told is not None  # two places at least, of a ramp
    at = f"at {wishes.at_m:g} m"
    yield "aperture", DesignValue(aperture, "m", "as told, or the rail's length")
    yield "positions", DesignValue(len(plan.places_m), "", "aperture / step + 1")
    slant = math.hypot(wishes.at_m, rig.geometry.antenna_height_m)
    simple = slant * rig.waveform.wavelength_m / (2 * aperture)
    note = "" if aperture < slant / 2 else "the aperture is too long for this form: see resolution_along_rail"
    yield "cross_range_small_angle", DesignValue(simple, "m", f"R wavelength / 2L {at} (thesis 2.35)", note)
    cell = told["resolution_m"]
    exact = "-3 dB of a point, from the support in wavenumbers, Hann over the ramp"
    yield "resolution_along_rail", DesignValue(cell["x"], "m", f"{exact}, {at}")
    yield "resolution_on_ground", DesignValue(cell["y"], "m", f"{exact}, {at}")
    swath = told["swath_m"]
    height = "height / tan(depression +- beam / 2), no further than beats are unambiguous"
    yield "swath_near", DesignValue(swath["near"], "m", height)
    yield "swath_far", DesignValue(swath["far"] if math.isfinite(swath["far"]) else None, "m", height)
    yield "swath_aside", DesignValue(swath["x"], "m", f"to either side {at}, in the beam and free of grating lobes")
    yield "step_wavelengths", DesignValue(told["step_wavelengths"], "wavelengths", "step / wavelength")
    free = told["alias_free_deg"]
    note = "" if free >= 90 else f"bright targets beyond {free:.0f} degrees leave grating lobes"
    yield "grating_lobe_free", DesignValue(free, "deg", "asin(wavelength / (4 step)) from broadside", note)
    assumed = told["assumed"]
    how = f"thermal noise, thesis 2.33, {at}, {assumed['integration_s']:.3g} s of up-ramps"
    yield "noise_equivalent_rcs", DesignValue(told["noise_equivalent_rcs_dbsm"], "dBsm", how)
    yield "noise_equivalent_sigma0", DesignValue(told["noise_equivalent_sigma0_db"], "dB", f"{how}, per cell of ground")


def _power(rig: Rig, wishes: DesignWishes) -> Named:
    wavelength = rig.waveform.wavelength_m
    rcs = float(square_trihedral_rcs(wishes.edge_m, wavelength, math.pi / 4, BEST_ELEVATION_RAD))
    far = 2 * wishes.edge_m**2 / wavelength
    yield "trihedral_rcs", DesignValue(10 * math.log10(rcs), "dBsm", "12 pi a^4 / wavelength^2 (thesis 5.4)")
    note = "" if wishes.at_m >= far else f"a target at {wishes.at_m:g} m stands nearer: use the near-field correction"
    yield "target_far_field", DesignValue(far, "m", "2 a^2 / wavelength", note)
    area = antenna_gain(math.radians(rig.geometry.beamwidth_deg)) * wavelength**2 / (4 * math.pi)
    slant = math.hypot(wishes.at_m, rig.geometry.antenna_height_m)
    power = float(received_power(rcs, slant, transmit_w=wishes.power_w, aperture_m2=area, wavelength_m=wavelength))
    yield (
        "received_power",
        DesignValue(10 * math.log10(power) + 30, "dBm", f"thesis 5.8: the trihedral on the axis at {wishes.at_m:g} m"),
    )
    noise = noise_power(1 / rig.waveform.ramp_up_s, wishes.noise_figure_db)
    yield "snr_one_sweep", DesignValue(10 * math.log10(power / noise), "dB", "over k T F in one range bin (1 / ramp)")


def _camera(rig: Rig, wishes: DesignWishes) -> Named:
    camera = rig.camera
    if camera is None:
        return
    angle = camera.pixel_pitch_m / camera.focal_length_m
    yield "pixel_angle", DesignValue(angle * 1e3, "mrad", "pixel pitch / focal length")
    yield "pixel_at_range", DesignValue(angle * wishes.at_m, "m", f"pixel angle x range, {wishes.at_m:g} m, head on")
    for name, count in (("field_of_view_across", camera.width_px), ("field_of_view_down", camera.height_px)):
        yield (
            name,
            DesignValue(
                2 * math.degrees(math.atan(count * angle / 2)), "deg", "2 atan(pixels x pitch / 2 focal lengths)"
            ),
        )
