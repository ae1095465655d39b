"""What the radar image of a plan will be worth, before the collect: resolution, swath, ambiguities, sensitivity."""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from collections.abc import Iterable
from typing import Any

import numpy as np

from polfuse_lab.plans.costs import pass_seconds
from polfuse_lab.plans.steps import MoveTo, RecordPass, RecordSeconds, RecordSweeps, Step
from polfuse_lab.rig import Rig
from processing.radar.ranging import unambiguous_range_m
from processing.sar.aperture import alias_free_angle_rad
from processing.sar.resolution import point_resolution
from processing.sar.sensitivity import antenna_gain, beam_swath_m, noise_equivalent_rcs_m2

POWER_W = 1.0
"""Transmitted power where none is told (thesis, Table 5.1)."""

NOISE_FIGURE_DB = 10.0
"""Receiver's noise figure where none is told: an assumption, of a receiver without a low-noise amplifier."""

AT_M = 10.0
"""Ground range for which numbers are given where none is told, m."""


def predict_image(
    rig: Rig,
    steps: Iterable[Step],
    *,
    at_m: float = AT_M,
    window: str = "hann",
    power_w: float = POWER_W,
    noise_figure_db: float = NOISE_FIGURE_DB,
) -> dict[str, Any] | None:
    """Predicted quality of the image that a plan's records give, as plain values; None where they make no aperture.

    Args:
        rig: waveform, antennas and sound card.
        steps: of the plan.
        at_m: ground range straight ahead at which resolution and sensitivity are told, m.
        window: over the ramp.
        power_w: transmitted.
        noise_figure_db: of the receiver.

    Returns:
        ``at_m``; ``resolution_m`` (``slant``, ``x``, ``y``: -3 dB widths of a point); ``swath_m`` (``near``, ``far``
        ground range in the half-power beam and in front of where beats alias, ``x`` to either side free of grating
        lobes at ``at_m``); ``unambiguous_range_m``; ``step_m`` and ``step_wavelengths``; ``alias_free_deg``
        (90: none); ``noise_equivalent_rcs_dbsm`` and ``noise_equivalent_sigma0_db`` (the same for one resolution cell
        of ground) of thermal noise; ``assumed`` (what they take for granted).

    Raises:
        DataError: a range, power or window that makes no sense.
    """
    listed = list(steps)
    places, seconds = _aperture(rig, listed)
    if len(places) < 2 or not rig.waveform.bandwidth_hz > 0:
        return None
    wave, geometry = rig.waveform, rig.geometry
    height = geometry.antenna_height_m
    antenna = np.column_stack([places, np.zeros((len(places), 2))])
    middle = float(np.mean(places))
    cell = point_resolution(
        antenna, (middle, at_m, -height), centre_hz=wave.centre_hz, bandwidth_hz=wave.bandwidth_hz, window=window
    )
    step = max(b - a for a, b in itertools.pairwise(places))
    free = alias_free_angle_rad(step, wave.wavelength_m)
    beam = math.radians(geometry.beamwidth_deg)
    tilt = math.radians(geometry.antenna_elevation_deg)
    longest = unambiguous_range_m(wave.bandwidth_hz, wave.ramp_up_s * rig.radar.sample_rate_hz)
    near, far = beam_swath_m(height, tilt, beam)
    far = min(far, math.sqrt(max(longest**2 - height**2, 0.0)))
    slant = math.hypot(at_m, height)
    off = abs(math.atan2(height, at_m) - tilt)
    gain = antenna_gain(beam) * max(math.cos(off), 1e-9) ** (antenna_gain(beam) / 2 - 1)
    rcs = noise_equivalent_rcs_m2(
        slant, wavelength_m=wave.wavelength_m, power_w=power_w, gain=gain, noise_figure_db=noise_figure_db,
        seconds=seconds, window=window,
    )  # fmt: skip
    aside = min(free, beam / 2)
    return {
        "at_m": at_m,
        "resolution_m": {"slant": cell.slant_m, "x": cell.x_m, "y": cell.y_m},
        "swath_m": {"near": near, "far": far, "x": slant * math.tan(aside) if aside < math.pi / 2 else None},
        "unambiguous_range_m": longest,
        "step_m": step,
        "step_wavelengths": step / wave.wavelength_m,
        "alias_free_deg": math.degrees(free),
        "noise_equivalent_rcs_dbsm": 10 * math.log10(rcs),
        "noise_equivalent_sigma0_db": 10 * math.log10(rcs / (cell.x_m * cell.y_m)),
        "assumed": {
            "power_w": power_w,
            "noise_figure_db": noise_figure_db,
            "temperature_k": 290.0,
            "gain_db": 10 * math.log10(gain),
            "integration_s": seconds,
            "window": window,
        },
    }


def prediction_lines(told: dict[str, Any] | None) -> list[str]:
    """The prediction in words."""
    if told is None:
        return []
    cell, swath = told["resolution_m"], told["swath_m"]
    lines = [
        f"image at {told['at_m']:g} m: cells of {cell['x']:.2g} m along the rail, {cell['y']:.3g} m on the ground and "
        f"{cell['slant']:.3g} m in range",
        f"swath: {swath['near']:.2g} to {swath['far']:.3g} m on the ground",
        f"thermal noise as RCS: {told['noise_equivalent_rcs_dbsm']:.0f} dBsm "
        f"({told['noise_equivalent_sigma0_db']:.0f} dB for a square metre of ground), for "
        f"{told['assumed']['power_w']:g} W and a noise figure of {told['assumed']['noise_figure_db']:g} dB",
    ]
    if told["alias_free_deg"] < 89.99:
        lines.append(
            f"steps of {told['step_m'] * 100:.3g} cm are {told['step_wavelengths']:.2f} wavelengths: grating lobes of "
            f"targets beyond {told['alias_free_deg']:.0f} degrees from broadside"
        )
    return lines


def _aperture(rig: Rig, listed: list[Step]) -> tuple[list[float], float]:
    """Places at which there are records, sorted, m, and the ramps' time of one channel over all of them, s."""
    places: set[float] = set()
    ramps: defaultdict[object, float] = defaultdict(float)
    at: float | None = None
    duty = rig.waveform.ramp_up_s / rig.waveform.sweep_period_s
    for step in listed:
        match step:
            case MoveTo():
                at = step.x_m
            case RecordSweeps():
                ramps[step.channel] += step.sweeps * rig.waveform.ramp_up_s
                if at is not None:
                    places.add(at)
            case RecordSeconds():
                ramps[step.channel] += step.seconds * duty
                if at is not None:
                    places.add(at)
            case RecordPass():
                long = pass_seconds(rig, step)
                ramps[step.channel] += long * duty
                count = max(round(long / rig.waveform.sweep_period_s), 1)
                places.update(np.linspace(step.x_from_m, step.x_to_m, count + 1).tolist())
    distinct: list[float] = []
    for place in sorted(places):
        if not distinct or place - distinct[-1] > 1e-6:
            distinct.append(place)
    return distinct, float(max(ramps.values(), default=0.0))
