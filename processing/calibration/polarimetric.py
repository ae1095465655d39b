"""A radar's constant, imbalance and crosstalk from measured targets, each with its budget of uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from processing.calibration.budget import Budget, Cause, uncertainty_budget
from processing.calibration.distortion import CHANNELS, Complexes, Distortion, channel_values
from processing.calibration.imbalance import imbalance
from processing.calibration.rcs import to_dbsm
from processing.calibration.target_checks import check_different
from processing.calibration.target_fit import Parameters, TargetFit, fit_targets, refine, turned
from processing.calibration.whitt import contrast
from processing.errors import DataError

Floats = NDArray[np.float64]

WORST_RESIDUAL_DB = -14.0
"""Largest part of a target's channels that the fit may leave unexplained: a fold that is off by 6 degrees."""

STATED_CONTRAST = 0.5
"""From which two targets are stated to be of different kind (see :func:`processing.calibration.whitt.contrast`)."""

DRAW_STEPS = 4
"""Gauss-Newton steps of each draw, from the solution as measured."""

PATHS = ("receive_h", "receive_v", "transmit_h", "transmit_v")
CO = ("constant_db", "co_imbalance_db", "co_imbalance_deg")
SPLIT = ("receive_imbalance_db", "receive_imbalance_deg", "transmit_imbalance_db", "transmit_imbalance_deg")
LEAKS = tuple(f"crosstalk_{path}_{part}" for path in PATHS for part in ("re", "im"))
RESULTS = (*CO, *SPLIT, *LEAKS)
"""Results of a full calibration; crosstalk over its own channel, real and imaginary part."""
ANGLES = tuple(name for name in RESULTS if name.endswith("_deg"))


@dataclass(frozen=True)
class ReferenceErrors:
    """How well the RCS of the target that gives the constant is known."""

    angle_sd_rad: float = 0.0
    """Of its azimuth and of its elevation, rad."""
    position_sd_m: float = 0.0
    """Of its place in x and in y, m."""
    edge_sd_m: float = 0.0
    """Of its edge, m."""
    range_sd_m: float = 0.0
    """Of the ground range at which its peak was found, by which the compensation of range is off, m."""
    range_db_per_m: float = 0.0
    """By which the constant falls with that range, dB/m."""
    rcs_dbsm: Callable[[Floats], Floats] | None = None
    """(draws, 5) errors of azimuth and elevation (rad), x, y and edge (m) to (draws,) RCS, dBsm; None: not affected."""


@dataclass(frozen=True)
class MeasuredTarget:
    """A target of known scattering matrix as the radar measured it."""

    name: str
    values: Complexes
    """(4,) mean over the repeats, in the order HH, HV, VH, VV."""
    noise: Floats
    """(4,) noise power of that mean."""
    expected: Complexes
    """(2, 2) S in its stated orientation, sqrt(m^2)."""
    turn_sd_rad: float = 0.0
    """Standard deviation of its orientation about the line of sight, rad."""
    amplitude_sd_db: float = 0.0
    """Standard uncertainty of the mean's amplitude from how much the repeats differ, dB."""
    repeats: int = 1


@dataclass(frozen=True)
class PolarimetricCalibration:
    """What a set of targets says of the radar."""

    distortion: Distortion
    constant_db: float
    """dBsm minus dB of power, in HH."""
    budget: Budget
    fit: TargetFit | None
    """None for isolated antennas."""
    target_errors_db: dict[str, float]
    """RCS measured minus expected of every target, dB; 0 for the one that gives the constant."""

    @property
    def crosstalk_sd(self) -> dict[str, float]:
        """Standard deviation of each crosstalk: root of the mean square of the complex error."""
        if self.fit is None:
            return {}
        return {
            path: float(np.hypot(self.budget.sd(f"crosstalk_{path}_re"), self.budget.sd(f"crosstalk_{path}_im")))
            for path in PATHS
        }


def calibrate_targets(
    targets: Sequence[MeasuredTarget],
    *,
    reference: int = 0,
    errors: ReferenceErrors | None = None,
    phase_sd_rad: float = 0.0,
    draws: int = 1000,
    seed: int = 0,
) -> PolarimetricCalibration:
    """Constant, imbalance and crosstalk from at least three targets that differ.

    Noise that the fit shows to be larger than measured is taken as that much larger in the budget (Birge's ratio).

    Args:
        targets: trihedral, dihedral and 45-degree dihedral, or more.
        reference: index of the target that gives the constant.
        errors: how well its RCS is known.
        phase_sd_rad: standard deviation of the phase between channels that were recorded one after the other, rad.
        draws: of the Monte Carlo.
        seed: of its random numbers.

    Raises:
        DataError: targets that do not suffice, do not fit together, or are described with wrong numbers.
    """
    if not 0 <= reference < len(targets):
        raise DataError(f"there is no target {reference} to give the constant", "give one of the targets")
    values = np.stack([np.asarray(target.values, dtype=np.complex128) for target in targets])
    shapes = np.stack([target.expected / np.linalg.norm(target.expected) for target in targets])
    turn = np.array([target.turn_sd_rad for target in targets])
    for one, other in combinations(range(len(targets)), 2):
        if contrast(shapes[one], shapes[other]) > STATED_CONTRAST:
            check_different((targets[one].name, targets[other].name), values[one], values[other])
    # Phase noise of a channel is noise of its quadrature.
    noise = np.stack([target.noise for target in targets]) + phase_sd_rad**2 * np.abs(values) ** 2
    fit = fit_targets(values, noise, shapes, turn)
    _refuse_misfit(targets, values, shapes, fit)
    inflation = max(fit.misfit, 1.0) ** 2
    measured_noise = np.stack([target.noise for target in targets]) * inflation
    model = _FitModel(targets, values, shapes, turn, noise, fit.parameters, reference, errors)
    budget = uncertainty_budget(
        model,
        _causes(targets, values, measured_noise, turn, phase_sd_rad, targets[reference], errors),
        RESULTS,
        draws=draws,
        seed=seed,
        angles=ANGLES,
    )
    strength = np.abs(fit.parameters.scale) ** 2 / np.array([np.linalg.norm(t.expected) ** 2 for t in targets])
    return PolarimetricCalibration(
        fit.distortion,
        budget.values["constant_db"],
        budget,
        fit,
        {t.name: float(to_dbsm(s / strength[reference])) for t, s in zip(targets, strength, strict=True)},
    )


def calibrate_isolated(
    target: MeasuredTarget,
    *,
    cross_ratio: complex | None = None,
    errors: ReferenceErrors | None = None,
    phase_sd_rad: float = 0.0,
    draws: int = 1000,
    seed: int = 0,
) -> PolarimetricCalibration:
    """Constant and co-polarized imbalance from a trihedral or plate alone, with antennas taken as isolated.

    Args:
        target: HH and VV must be finite; the crosstalk that its cross-polarized channels show counts as an error of the
            imbalance, for it is not removed.
        cross_ratio: HV over VH of reciprocal scatterers; receive and transmit are taken as alike where left out.
        errors, phase_sd_rad, draws, seed: as in :func:`calibrate_targets`.

    Raises:
        DataError: HH or VV is zero or undefined.
    """
    hh, vv = (complex(target.values[CHANNELS.index(name)]) for name in ("HH", "VV"))
    stated = complex(target.expected[1, 1] / target.expected[0, 0])
    distortion = imbalance(vv / hh / stated if hh else float("nan"), cross_ratio)
    values = np.array([[hh, vv]])
    noise = np.asarray(target.noise)[[0, 3]]
    crosses = np.asarray(target.values)[[1, 2]]
    leak = float(np.nanmax(np.abs(crosses)) / min(abs(hh), abs(vv))) if np.isfinite(crosses).any() else 0.0
    expected_db = float(to_dbsm(abs(target.expected[0, 0]) ** 2))

    def model(deviations: Floats) -> Floats:
        n, p, a, r = _split(deviations, (4, 2, 1, 6))
        off = values * np.exp(1j * np.radians(p)) + (n[:, :2] + 1j * n[:, 2:])
        ratio = off[:, 1] / off[:, 0] / stated
        constant = expected_db + _rcs_change_db(errors, r) - to_dbsm(np.abs(off[:, 0]) ** 2) + a[:, 0]
        return np.stack([constant, to_dbsm(np.abs(ratio) ** 2), np.degrees(np.angle(ratio))], axis=1)

    root = np.sqrt(noise / 2)
    causes = [
        Cause("noise of the channels (SNR)", (*root, *root), "dB", "A", stated=float(_snr_db(values[0], noise).min())),
        Cause("phase between channels", (float(np.degrees(phase_sd_rad)),) * 2, "deg"),
        Cause(f"repeats ({target.repeats})", (target.amplitude_sd_db,), "dB", "A"),
        *_reference_causes(errors),
    ]
    budget = uncertainty_budget(model, causes, CO, draws=draws, seed=seed, angles=ANGLES)
    budget = _with_leak(budget, leak)
    return PolarimetricCalibration(distortion, budget.values["constant_db"], budget, None, {target.name: 0.0})


class _FitModel:
    """Deviations of all causes to the results of a full calibration, many draws at once."""

    def __init__(
        self,
        targets: Sequence[MeasuredTarget],
        values: Complexes,
        shapes: Complexes,
        turn: Floats,
        noise: Floats,
        start: Parameters,
        reference: int,
        errors: ReferenceErrors | None,
    ) -> None:
        self._values, self._shapes, self._turn, self._noise = values, shapes, turn, noise
        self._start, self._reference, self._errors = start, reference, errors
        self._expected_db = float(to_dbsm(np.linalg.norm(targets[reference].expected) ** 2))
        fitted = Distortion(start.receive, start.transmit)
        model = start.scale[:, None, None] * fitted.apply(turned(shapes, start.turn_rad))
        self._explained = channel_values(model)
        self._distortion = fitted

    def __call__(self, deviations: Floats) -> Floats:
        count = len(self._values)
        n, d, p, a, r = _split(deviations, (8 * count, count, 4 * count, count, 6))
        lead = len(deviations)
        half = n.reshape(lead, 2, count, 4)
        # What a target that is turned by d more than it seems adds to its channels.
        turns = self._start.turn_rad + np.radians(d)
        scale = self._start.scale[:, None, None]
        more = channel_values(scale * self._distortion.apply(turned(self._shapes, turns))) - self._explained
        off = (self._values + more) * np.exp(1j * np.radians(p.reshape(lead, count, 4))) + half[:, 0] + 1j * half[:, 1]
        found = refine(self._start, off, self._noise, self._shapes, self._turn, steps=DRAW_STEPS)
        strength = to_dbsm(np.abs(found.scale[:, self._reference]) ** 2)
        constant = self._expected_db + _rcs_change_db(self._errors, r) - strength + a[:, self._reference]
        f_r, f_t = found.receive[:, 1, 1], found.transmit[:, 1, 1]
        co = f_r * f_t
        leaks = (
            found.receive[:, 0, 1],
            found.receive[:, 1, 0] / f_r,
            found.transmit[:, 1, 0],
            found.transmit[:, 0, 1] / f_t,
        )
        columns = [constant]
        for gain in (co, f_r, f_t):
            columns += [to_dbsm(np.abs(gain) ** 2), np.degrees(np.angle(gain))]
        for leak in leaks:
            columns += [leak.real, leak.imag]
        return np.stack(columns, axis=1)


def _causes(
    targets: Sequence[MeasuredTarget],
    values: Complexes,
    noise: Floats,
    turn: Floats,
    phase_sd_rad: float,
    reference: MeasuredTarget,
    errors: ReferenceErrors | None,
) -> list[Cause]:
    root = np.sqrt(noise / 2).reshape(-1)
    strongest = np.max(np.abs(values) ** 2, axis=1) / np.max(noise, axis=1)
    return [
        Cause("noise of the channels (SNR)", (*root, *root), "dB", "A", stated=float(to_dbsm(strongest.min()))),
        Cause("orientation of the folds", tuple(np.degrees(turn)), "deg"),
        Cause("phase between channels", (float(np.degrees(phase_sd_rad)),) * (4 * len(targets)), "deg"),
        Cause(
            f"repeats ({reference.repeats})", tuple(t.amplitude_sd_db for t in targets), "dB", "A",
            stated=reference.amplitude_sd_db,
        ),
        *_reference_causes(errors),
    ]  # fmt: skip


def _reference_causes(errors: ReferenceErrors | None) -> list[Cause]:
    known = ReferenceErrors() if errors is None else errors
    return [
        Cause("angles of the reference", (float(np.degrees(known.angle_sd_rad)),) * 2, "deg"),
        Cause("position of the reference", (known.position_sd_m,) * 2, "m"),
        Cause("edge of the reference", (known.edge_sd_m,), "m"),
        Cause("range of the reference's peak", (known.range_sd_m,), "m", "A"),
    ]


def _rcs_change_db(errors: ReferenceErrors | None, deviations: Floats) -> Floats:
    """By how much the constant differs for the reference, dB; its angles come in degrees, as the budget states them."""
    if errors is None:
        return np.zeros(len(deviations))
    compensation = -errors.range_db_per_m * deviations[:, 5]
    if errors.rcs_dbsm is None:
        return np.asarray(compensation)
    stated = deviations[:, :5] * np.array([np.pi / 180, np.pi / 180, 1.0, 1.0, 1.0])
    rcs_db = np.asarray(errors.rcs_dbsm(np.concatenate([np.zeros((1, 5)), stated])), dtype=np.float64)
    return np.asarray(rcs_db[1:] - rcs_db[0] + compensation)


def _split(deviations: Floats, sizes: Sequence[int]) -> list[Floats]:
    return np.split(deviations, np.cumsum(sizes)[:-1], axis=1)


def _snr_db(values: Complexes, noise: Floats) -> Floats:
    with np.errstate(divide="ignore"):
        return to_dbsm(np.abs(values) ** 2 / noise)


def _with_leak(budget: Budget, leak: float) -> Budget:
    """Add what crosstalk that is not removed may do to the co-polarized channels of a target: each by twice the product
    of two leaks at most, taken as uniform."""
    from dataclasses import replace

    from processing.calibration.budget import Contribution

    second_order = 2 * leak**2 / np.sqrt(3)
    share = {
        "constant_db": float(20 / np.log(10) * second_order),
        "co_imbalance_db": float(20 / np.log(10) * second_order * np.sqrt(2)),
        "co_imbalance_deg": float(np.degrees(second_order * np.sqrt(2))),
    }
    line = Contribution("crosstalk left in", float(to_dbsm(leak**2)), "dB", "B", share)
    grown = {name: float(np.hypot(budget.first_order_sd[name], share[name])) for name in budget.results}
    drawn = {name: float(np.hypot(budget.drawn_sd[name], share[name])) for name in budget.results}
    return replace(budget, lines=(*budget.lines, line), first_order_sd=grown, drawn_sd=drawn)


def _refuse_misfit(targets: Sequence[MeasuredTarget], values: Complexes, shapes: Complexes, fit: TargetFit) -> None:
    at = fit.parameters
    model = channel_values(at.scale[:, None, None] * fit.distortion.apply(turned(shapes, at.turn_rad)))
    left = np.linalg.norm(values - model, axis=1) / np.linalg.norm(values, axis=1)
    worst = int(np.argmax(left))
    if not to_dbsm(left[worst] ** 2) <= WORST_RESIDUAL_DB:
        raise DataError(
            f"the targets do not fit together: {float(to_dbsm(left[worst] ** 2)):.1f} dB of {targets[worst].name} stay "
            "unexplained",
            "check the orientation of each (folds upright and at 45 degrees) and measure them again",
        )
