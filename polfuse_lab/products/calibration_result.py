"""What a calibration found, and how it is told in settings, JSON and reports."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.products.calibration_targets import TargetView
from processing.calibration.budget import Budget
from processing.calibration.channel_phase import ChannelPhases
from processing.calibration.distortion import CHANNELS, Distortion
from processing.calibration.distributed import CrosstalkEstimate
from processing.calibration.range_dependence import RangeDistortion


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
    """Standard deviation of that from noise, from its stated angles and edge, and from the calibration's own, dB."""
    thesis_accuracy_percent: float
    """Ratio of the two dBsm numbers (thesis 5.13); see :func:`processing.calibration.rcs.accuracy`."""
    values: dict[str, complex] = field(repr=False)
    """Calibrated scattering amplitude by channel, sqrt(m^2)."""


@dataclass(frozen=True)
class CalibrationResult:
    """What the calibration found."""

    products: Path
    method: str
    """``"isolated"`` (crosstalk is left in), ``"targets"`` (three or more known targets), ``"quegan"`` or
    ``"ainsworth"`` (a region of distributed targets)."""
    constant_db: float
    """dBsm minus dB of image power, at the target (everywhere, in mode "offset")."""
    constant_sd_db: float
    """Its standard uncertainty: of ``budget`` where there is one."""
    slope: float
    """dBsm per dB; 1 except in mode "thesis"."""
    target: TargetView
    """The target that gave the constant."""
    targets: tuple[TargetView, ...]
    """All targets that were looked at, refused ones as well."""
    expected_dbsm: float
    """Apparent RCS of the target over the aperture, dBsm."""
    crosstalk_db: dict[str, float]
    """Crosstalk that the target shows before it is taken off, by cross-polarized channel, dB."""
    distortion: Distortion
    """What was taken off the channels."""
    imbalance_db: float
    """VV over HH, amplitude, dB; NaN without VV."""
    imbalance_deg: float
    """VV over HH, phase, degrees; NaN without VV."""
    cross_imbalance: complex | None
    """HV over VH from reciprocal scatterers, or None where nothing tells it."""
    noise_source: str
    noise_equivalent_dbsm: float
    """Noise-equivalent RCS in HH at the target's ground range, dBsm."""
    budget: Budget
    target_errors_db: dict[str, float]
    """RCS measured minus expected of each target used, dB."""
    misfit: float | None
    """What the fit left unexplained over its noise: about 1 where targets and model agree; None without a fit."""
    clutter: CrosstalkEstimate | None
    by_range: RangeDistortion | None
    """What was taken off range by range, where targets stood at several; ``distortion`` is that at the reference."""
    phases: ChannelPhases | None
    """Phases of the channels against the calibration series, from the target in the scene."""
    check: CheckResult | None

    @property
    def worst_crosstalk_db(self) -> float:
        """Largest crosstalk that the target shows, dB; NaN without a cross-polarized channel."""
        return max(self.crosstalk_db.values(), default=float("nan"))

    def uncertainties(self) -> dict[str, dict[str, float]]:
        """Each result of the budget: value, standard uncertainty by first order and drawn, and expanded (95 %)."""
        b = self.budget
        return {
            name: {
                "value": b.values[name],
                "sd": b.sd(name),
                "first_order_sd": b.first_order_sd[name],
                "monte_carlo_sd": b.drawn_sd[name],
                "expanded": b.expanded(name),
            }
            for name in b.results
        }

    def paths(self) -> dict[str, dict[str, float]]:
        """Crosstalk of each path that is taken off: dB, degrees, and its standard deviation over the path's gain."""
        found = {}
        clutter = _clutter_sd(self.clutter, self.distortion)
        for name, value in self.distortion.crosstalk.items():
            sd = clutter.get(name, float("nan"))
            if f"crosstalk_{name}_re" in self.budget.results:
                sd = float(np.hypot(self.budget.sd(f"crosstalk_{name}_re"), self.budget.sd(f"crosstalk_{name}_im")))
            level = 20 * np.log10(abs(value)) if value else -np.inf
            found[name] = {"db": float(level), "deg": float(np.degrees(np.angle(value))), "sd": sd}
        return found

    def summary(self) -> dict[str, Any]:
        """For settings and JSON."""
        d = self.distortion
        phases = None
        if self.phases is not None:
            sd = np.degrees(self.phases.phase_sd_rad())
            phases = {
                name: {
                    "deg": float(np.degrees(self.phases.phase_rad[i])),
                    "sd_deg": float(sd[i]),
                    "shift_m": float(self.phases.shift_m[i]),
                    "known": name in self.phases.known(),
                }
                for i, name in enumerate(CHANNELS)
            }
        return {
            "method": self.method,
            "constant_db": self.constant_db,
            "constant_sd_db": self.constant_sd_db,
            "slope": self.slope,
            "crosstalk_db": self.crosstalk_db,
            "imbalance_db": self.imbalance_db,
            "imbalance_deg": self.imbalance_deg,
            "cross_imbalance": None
            if self.cross_imbalance is None
            else [self.cross_imbalance.real, self.cross_imbalance.imag],
            "receive": _pairs(d.receive),
            "transmit": _pairs(d.transmit),
            "crosstalk_paths": self.paths(),
            "uncertainty": self.uncertainties(),
            "budget": self.budget.table(),
            "targets": [
                view.summary() | {"rcs_error_db": self.target_errors_db.get(view.spec.label)} for view in self.targets
            ],
            "misfit": self.misfit,
            "clutter": None
            if self.clutter is None
            else {"pixels": self.clutter.pixels, "coherence": self.clutter.coherence, "sd": self.clutter.sd},
            "channel_phases": phases,
            "by_range": None
            if self.by_range is None
            else [
                {"range_m": r, "receive": _pairs(d.receive), "transmit": _pairs(d.transmit)}
                for r, d in zip(self.by_range.range_m, self.by_range.distortions, strict=True)
            ],
        }


def _pairs(matrix: NDArray[np.complex128]) -> list[list[list[float]]]:
    """Real and imaginary part of each element."""
    return [[[value.real, value.imag] for value in row] for row in matrix.tolist()]


def _clutter_sd(clutter: CrosstalkEstimate | None, distortion: Distortion) -> dict[str, float]:
    """Standard deviations of the paths' crosstalk from distributed targets, whose estimates lie outside the gains."""
    if clutter is None:
        return {}
    receive, transmit = abs(distortion.receive_gain), abs(distortion.transmit_gain)
    return {
        "receive_h": clutter.sd["w"] * receive,
        "receive_v": clutter.sd["u"] / receive,
        "transmit_h": clutter.sd["z"] * transmit,
        "transmit_v": clutter.sd["v"] / transmit,
    }
