"""Accuracy of polarimetric calibration: what it leaves of a known distortion, and errors against those told."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.calibration_trials import (
    AMPLITUDE,
    Errors,
    Trial,
    blank_image,
    draw_distortion,
    run_trial,
    write_rig_series,
)
from benchmarks.rows import Row
from polfuse_lab.products.calibration_series import look_at_series
from polfuse_lab.session import open_session
from processing.calibration.distortion import Distortion, channel_values, matrices
from processing.calibration.distributed import estimate_crosstalk
from processing.calibration.polarimetric import calibrate_targets
from processing.calibration.target_fit import fit_targets
from processing.calibration.whitt import solve_targets

STATED = Errors(angle_deg=1.0, fold_deg=0.3, position_m=0.03, edge_m=0.002)
COVERED = 0.95


def run(quick: bool) -> list[Row]:
    """Trials on closed-form profiles (with and without errors of what is stated), and series of the simulated rig."""
    count = 10 if quick else 100
    exact = [run_trial(seed, Errors()) for seed in range(count)]
    stated = [run_trial(1000 + seed, STATED) for seed in range(count)]
    return [
        *_accuracy("calibration", exact),
        _peer(exact),
        *_coverage("calibration.coverage_noise", exact),
        *_coverage("calibration.coverage_stated_errors", stated),
        *_rig(1 if quick else 5),
        _bound(200 if quick else 1000),
        *_clutter(),
    ]


def _accuracy(name: str, trials: Sequence[Trial]) -> list[Row]:
    """The worst of all trials against the limits that calibration is to keep."""
    found = {
        "crosstalk_left_db": (max(trial.left.worst_crosstalk_db for trial in trials), -40.0, "below -40 dB"),
        "imbalance_left_db": (max(abs(trial.left.co_db) for trial in trials), 0.1, "below 0.1 dB"),
        "imbalance_left_deg": (max(abs(trial.left.co_deg) for trial in trials), 1.0, "below 1 degree"),
        "rcs_error_db": (max(abs(trial.check_error_db) for trial in trials), 0.2, "within 0.2 dB"),
    }
    words = (
        f"worst of {len(trials)}; -20 dB, 2 dB, 40 deg, 30 dB a profile, {np.mean([t.snr_db for t in trials]):.0f} dB"
    )
    return [
        Row(f"{name}.{key}", "", None, bool(value < limit), f"{target} ({words} in the mean)", error=round(value, 3))
        for key, (value, limit, target) in found.items()
    ]


def _peer(trials: Sequence[Trial]) -> Row:
    """Against isolated antennas (Freeman's special case, what the thesis's kind of calibration can do)."""
    ours = float(np.median([trial.left.worst_crosstalk_db for trial in trials]))
    isolated = [
        trial.truth.residual(Distortion.isolated(trial.truth.receive_gain, trial.truth.transmit_gain))
        for trial in trials
    ]
    theirs = float(np.median([left.worst_crosstalk_db for left in isolated]))
    return Row(
        "calibration.crosstalk_left", "isolated antennas", None, ours < theirs - 20, "20 dB below it, dB",
        error=round(ours, 1), peer_error=round(theirs, 1),
    )  # fmt: skip


def _coverage(name: str, trials: Sequence[Trial]) -> list[Row]:
    """In how many trials each result lies within its expanded uncertainty."""
    inside: dict[str, list[bool]] = {}
    for trial in trials:
        budget = trial.made.budget
        for key, value in results_of(trial.truth).items():
            error = budget.values[key] - value
            if key.endswith("_deg"):
                error = (error + 180) % 360 - 180
            inside.setdefault(key, []).append(abs(error) <= budget.expanded(key))
    shares = {key: float(np.mean(values)) for key, values in inside.items()}
    everything = float(np.mean(list(shares.values())))
    least = min(shares, key=lambda key: shares[key])
    # Of n trials of 95.45 % each, so many may miss by chance (three standard deviations of the binomial).
    chance = 0.9545 - 3 * np.sqrt(0.9545 * 0.0455 / len(trials))
    return [
        Row(f"{name}.all_results", "", everything, everything >= COVERED, f"95 of 100 within, {len(trials)} trials"),
        Row(f"{name}.constant", "", shares["constant_db"], shares["constant_db"] >= chance, "not below 95 % by chance"),
        Row(f"{name}.least", "", shares[least], shares[least] >= chance, f"{least}, not below 95 % by chance"),
    ]


def results_of(truth: Distortion) -> dict[str, float]:
    """What a calibration should report of a radar."""
    found = {"constant_db": -20 * np.log10(AMPLITUDE), "co_imbalance_db": truth.co_db, "co_imbalance_deg": truth.co_deg}
    for path, gain in (("receive", truth.receive_gain), ("transmit", truth.transmit_gain)):
        found[f"{path}_imbalance_db"] = float(20 * np.log10(abs(gain)))
        found[f"{path}_imbalance_deg"] = float(np.degrees(np.angle(gain)))
    for name, leak in truth.crosstalk.items():
        found[f"crosstalk_{name}_re"], found[f"crosstalk_{name}_im"] = leak.real, leak.imag
    return found


def _rig(count: int) -> list[Row]:
    """Whole chain: the simulated sound card's samples, sync, range profiles, images, targets, fit."""
    trials = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(count):
            truth = draw_distortion(np.random.default_rng(5000 + seed))
            path = write_rig_series(Path(folder) / f"{seed}.h5", truth, 7 + seed, positions=37, repeats=1)
            with open_session(path) as session:
                image = blank_image(np.zeros((1, 3)))
                settings = {"beamwidth_rad": np.radians(70), "depression_rad": np.radians(17)}
                image = type(image)(**{**vars(image), "settings": settings})
                views = list(look_at_series(session, image, radius_m=1.0, min_snr_db=10.0))
            path.unlink()
            bad = [f"{view.spec.label}: {view.verdict.reason}" for view in views if not view.verdict.ok]
            if bad:
                return [Row("calibration.rig", "", None, False, "all targets are found good", error="; ".join(bad))]
            made = calibrate_targets([view.measured() for view in views[:3]], draws=300)
            measured = 10 ** (made.constant_db / 20) * made.distortion.remove(views[3].values)[0]
            error = float(20 * np.log10(abs(measured) / abs(views[3].expected[0, 0])))
            trials.append(Trial(truth, made, error, views[0].snr_db))
    return _accuracy("calibration.rig", trials)


def _bound(count: int) -> Row:
    """30 dB in a single measurement of each target: error over what first order allows, and the closed form's."""
    random = np.random.default_rng(9)
    s = np.stack([np.eye(2), np.diag([-1, 1]), [[0, 1], [1, 0]]]).astype(complex)
    noise = np.full((3, 4), 1e-3)
    ours, whitt, allowed = [], [], []
    for _ in range(count):
        truth = draw_distortion(random)
        clean = channel_values(truth.apply(s)) * np.exp(2j * np.pi * random.random((3, 1)))
        seen = clean + np.sqrt(noise / 2) * (random.normal(size=(3, 4)) + 1j * random.normal(size=(3, 4)))
        fit = fit_targets(seen, noise, s, np.zeros(3))
        other = solve_targets(matrices(seen), s).distortion
        ours.append(fit.distortion.receive[0, 1] - truth.receive[0, 1])
        whitt.append(other.receive[0, 1] - truth.receive[0, 1])
        allowed.append(fit.covariance[0, 0] + fit.covariance[9, 9])
    bound = np.sqrt(np.mean(allowed))
    ratio = float(np.sqrt(np.mean(np.abs(ours) ** 2)) / bound)
    peer = float(np.sqrt(np.mean(np.abs(whitt) ** 2)) / bound)
    return Row(
        "calibration.single_look_30_db", "Whitt's closed form", ratio / peer, ratio < 1.1 and ratio <= peer,
        f"error within 10 % of the first-order bound ({20 * np.log10(bound):.1f} dB)",
        error=round(ratio, 3), peer_error=round(peer, 3),
    )  # fmt: skip


def _clutter() -> list[Row]:
    """Distributed targets: what is left after Quegan (no slope) and by how far Ainsworth's channels are reciprocal."""
    random = np.random.default_rng(3)
    truth, count = draw_distortion(random), 40_000

    def noise() -> np.ndarray:
        return random.normal(size=count) + 1j * random.normal(size=count)

    hh = noise()
    vv, x = 0.5 * hh + 0.8 * noise(), 0.4 * noise()
    seen = channel_values(truth.apply(np.moveaxis(np.array([[hh, x], [x, vv]]), -1, 0))).T
    found = estimate_crosstalk(seen, method="quegan")
    trihedral = found.without_crosstalk(channel_values(truth.apply(np.eye(2))))
    left = truth.residual(found.distortion(complex(trihedral[3] / trihedral[0]))).worst_crosstalk_db
    other = estimate_crosstalk(seen, method="ainsworth")
    clean = other.without_crosstalk(seen)
    unlike = 20 * np.log10(np.linalg.norm(clean[1] - other.cross_ratio * clean[2]) / np.linalg.norm(clean[1]))
    return [
        Row(
            "calibration.quegan_crosstalk_left",
            "",
            None,
            left < -40,
            "below -40 dB, 40 000 pixels",
            error=round(left, 1),
        ),
        Row(
            "calibration.ainsworth_reciprocity", "", None, bool(unlike < -100), "below -100 dB", error=round(unlike, 1)
        ),
    ]
