"""A radar with known distortion, and what it measures of known targets: truth for the tests of calibration."""

from __future__ import annotations

import numpy as np

from processing.calibration.distortion import Distortion, channel_values
from processing.calibration.polarimetric import MeasuredTarget
from processing.calibration.target_fit import turned

TRIHEDRAL = np.eye(2, dtype=complex)
DIHEDRAL = np.diag([-1, 1]).astype(complex)
DIHEDRAL_45 = np.array([[0, 1], [1, 0]], dtype=complex)
THREE = np.stack([TRIHEDRAL, DIHEDRAL, DIHEDRAL_45])
NAMES = ("trihedral", "dihedral", "dihedral_45")


def distortion(random, crosstalk_db=-20.0, imbalance_db=2.0, imbalance_deg=40.0) -> Distortion:
    """Crosstalk of random phase in every path, one imbalance on receive and on transmit."""
    gain = 10 ** (imbalance_db / 20) * np.exp(1j * np.radians(imbalance_deg))
    leak = 10 ** (crosstalk_db / 20) * np.exp(2j * np.pi * random.random(4))
    receive = np.diag([1, gain]) @ np.array([[1, leak[0]], [leak[1], 1]])
    transmit = np.array([[1, leak[2]], [leak[3], 1]]) @ np.diag([1, gain])
    return Distortion(receive, transmit)


def complex_noise(random, shape, power):
    """Circular complex Gaussian noise."""
    return np.sqrt(np.asarray(power) / 2) * (random.normal(size=shape) + 1j * random.normal(size=shape))


def measure(random, truth, *, snr_db=45.0, amplitude=0.02, size=18.0, turn_sd_deg=0.3, expected=THREE, names=NAMES):
    """Targets as measured with random phases, orientations and noise."""
    s = size * expected
    fold = np.array([not np.allclose(one, TRIHEDRAL) for one in expected])
    sd = np.radians(turn_sd_deg) * fold
    phase = np.exp(2j * np.pi * random.random(len(s)))
    values = amplitude * phase[:, None] * channel_values(truth.apply(turned(s, sd * random.normal(size=len(s)))))
    noise = np.full(values.shape, (size * amplitude) ** 2 * 10 ** (-snr_db / 10))
    values = values + complex_noise(random, values.shape, noise)
    return [
        MeasuredTarget(name, value, power, one, float(turn))
        for name, value, power, one, turn in zip(names, values, noise, s, sd, strict=True)
    ]


def results_of(truth, amplitude=0.02) -> dict[str, float]:
    """What a calibration should report of a radar."""
    found = {"constant_db": -20 * np.log10(amplitude), "co_imbalance_db": truth.co_db, "co_imbalance_deg": truth.co_deg}
    for path, gain in (("receive", truth.receive_gain), ("transmit", truth.transmit_gain)):
        found[f"{path}_imbalance_db"] = 20 * np.log10(abs(gain))
        found[f"{path}_imbalance_deg"] = float(np.degrees(np.angle(gain)))
    for name, leak in truth.crosstalk.items():
        found[f"crosstalk_{name}_re"], found[f"crosstalk_{name}_im"] = leak.real, leak.imag
    return found
