"""Figures of the thesis that have closed forms: computed by the library, compared with what the thesis prints."""

from __future__ import annotations

import math

from polfuse_lab.plans import RailSarPlan
from polfuse_lab.products.checks import Check
from polfuse_lab.rig import Waveform
from processing.calibration.rcs import accuracy, dihedral_rcs, square_trihedral_rcs, to_dbsm

FOOT_M = 0.3048
WAVELENGTH_M = 0.125
"""As the thesis rounds it (5.1)."""


def thesis_checks() -> list[Check]:
    """Trihedral, dihedral, range resolution, positions, and the thesis's accuracy beside the honest one."""
    edge_m = 4 * FOOT_M
    trihedral = float(to_dbsm(square_trihedral_rcs(edge_m, WAVELENGTH_M, math.radians(40), math.radians(17))))
    dihedral = float(to_dbsm(dihedral_rcs(edge_m, edge_m, WAVELENGTH_M)))
    measured = accuracy(31.05, 35.5)
    waveform = Waveform(centre_hz=2.4e9, bandwidth_hz=80e6, ramp_up_s=0.02, sweep_period_s=0.04)
    positions = len(RailSarPlan(aperture_m=10 * FOOT_M, step_m=2 * FOOT_M / 12).positions_m)
    return [
        Check(
            "thesis_trihedral_rcs",
            trihedral,
            30.78,
            0.005,
            "dBsm",
            "Square trihedral of 4 ft at azimuth 40°, elevation 17°, 12.5 cm (thesis 5.5): the form agrees with 30.78.",
        ),
        Check("thesis_dihedral_rcs", dihedral, 35.51, 0.005, "dBsm", "Dihedral of 4 ft, 12.5 cm (thesis 5.10)."),
        Check(
            "thesis_range_resolution",
            waveform.range_resolution_m,
            1.874,
            0.0005,
            "m",
            "c / 2B for 80 MHz (thesis 2.34); the thesis rounds it to 1.88 m.",
        ),
        Check("thesis_positions", positions, 61, 0, "", "Positions on 10 ft in steps of 2 in (thesis 5.5)."),
        Check(
            "thesis_accuracy",
            measured.thesis_accuracy_percent,
            87.46,
            0.005,
            "%",
            "Thesis 5.13 as printed: ratio of two dBsm numbers, 31.05 over 35.5.",
        ),
        Check(
            "thesis_accuracy_db",
            measured.error_db,
            -4.45,
            0.005,
            "dB",
            "The same measurement told honestly: a third of the power was found, −4.45 dB.",
        ),
    ]
