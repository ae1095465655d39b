"""What the calibration target itself tells in an analysis: its near field, and the antennas' pattern."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.products.calibration_inputs import FocusedImage, read_focused
from polfuse_lab.products.store import Products
from processing.calibration.near_field import near_field
from processing.calibration.pattern_measurement import TOGETHER, MeasuredPattern, measured_pattern
from processing.scene.model import Reflector
from processing.scene.radar_response import reflector_scattering

FLAT_FACED = ("plate", "dihedral", "trihedral", "trihedral_triangular")
"""Kinds of target whose near field is known."""
MOST_POSITIONS = 31
"""Positions that the near field is told from."""
CO_POLARIZED = ("HH", "VV")


@dataclass(frozen=True)
class NearFieldEffect:
    """How far the calibration target's RCS at its distance is from the closed form that it was calibrated with."""

    distance_m: float
    """Of the target from the nearest antenna, m."""
    far_field_m: float
    """Distance from which the closed form holds, m."""
    correction_db: dict[str, float]
    """By co-polarized channel: physical optics at the true distances over the closed form, dB."""


def near_field_effect(products: Products) -> NearFieldEffect | None:
    """Near field of the target that a products file was calibrated on; None for one without flat faces."""
    focused = read_focused(products)
    reflector = _reflector(products, focused)
    if reflector.kind not in FLAT_FACED:
        return None
    weights = focused.pulse_weights(np.asarray(reflector.position_m))
    # Neighbours see nearly the same: a few dozen positions have the mean over the aperture.
    step = -(-len(weights) // MOST_POSITIONS)
    seen = near_field(reflector, focused.antenna_m[::step], focused.wavelength_m, weights[::step])
    co = {name: float(seen.correction_db[index, index]) for index, name in enumerate(CO_POLARIZED)}
    return NearFieldEffect(seen.distance_m, seen.far_field_m, {k: v for k, v in co.items() if k in focused.channels})


def target_pattern(products: Products) -> tuple[tuple[str, ...], MeasuredPattern] | None:
    """Two-way pattern of the co-polarized channels along the rail, from the calibration target's echoes.

    None where profiles begin at ranges of their own (flights), or for a target measured in another file.
    """
    ranging = products.read("ranging")
    if "start_m" in ranging or not _stands_here(products):
        return None
    focused = read_focused(products)
    reflector = _reflector(products, focused)
    names = tuple(str(name) for name in products.settings("ranging")["channels"])
    chosen = [name for name in CO_POLARIZED if name in names]
    s = reflector_scattering(reflector, focused.antenna_m, focused.wavelength_m)
    response = np.stack([s[:, "HV".index(name[1]), "HV".index(name[0])] for name in chosen])
    values: NDArray[np.complexfloating] = ranging["profiles"][[names.index(name) for name in chosen]]
    depression = float(focused.settings.get("depression_rad", 0.0))
    found = measured_pattern(
        values,
        ranging["range_m"],
        focused.antenna_m,
        reflector.position_m,
        response,
        focused.wavelength_m,
        depression_rad=depression,
        together=TOGETHER if len(focused.antenna_m) >= 2 * TOGETHER else 1,
    )
    return tuple(chosen), found


def _stands_here(products: Products) -> bool:
    """Whether the calibration used this file's own image: no other file but the sky's went into it."""
    others = products.provenance("calibration")["inputs"]
    return len(others) <= (products.settings("calibration").get("noise_sd_db") is not None)


def _reflector(products: Products, focused: FocusedImage) -> Reflector:
    target = products.settings("calibration")["target"]
    return Reflector(
        name=str(target["kind"]),
        kind=str(target["kind"]),
        position_m=(float(target["x_m"]), float(target["y_m"]), focused.z_m + float(target["height_m"])),
        edge_m=float(target["edge_m"]),
        azimuth_rad=math.radians(target["azimuth_deg"]),
        elevation_rad=math.radians(target["elevation_deg"]),
        fold_rad=math.radians(target["fold_deg"]),
    )
