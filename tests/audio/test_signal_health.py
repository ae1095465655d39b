"""Each trouble is made on purpose, with a known strength, and found; real recordings are judged as they are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from real_data import real_data
from scipy.io import wavfile

from drivers.radar.health import Severity, SyncMeasure, Trouble, examine_signal, fractions, level_of

RATE = 48_000
PERIOD_S, RAMP_S = 0.0413, 0.0289  # 70 % up: neither 50 nor 60 Hz is a multiple of the sweep rate


def rig_signal(seconds: float = 2.0, rate: int = RATE, period_s: float = PERIOD_S, up: float = 0.7) -> np.ndarray:
    """Beat of a point at 300 Hz on the ramps, sync of 0.7 of full scale; fractions of full scale."""
    t = np.arange(round(seconds * rate)) / rate
    phase = t % period_s
    beat = 0.2 * np.sin(2 * np.pi * 300 * np.minimum(phase, period_s - phase))
    sync = np.where(phase < up * period_s, 0.7, -0.7)
    return np.stack([beat, sync], axis=1)


def counts(signal: np.ndarray) -> np.ndarray:
    return np.rint(np.clip(signal, -1, 1) * 32_767).astype(np.int16)


def troubles(signal: np.ndarray, **expected: float) -> set[Trouble]:
    settings = {"nominal_period_s": PERIOD_S, "ramp_up_s": RAMP_S, "sync_channel": 1, **expected}
    return {finding.trouble for finding in examine_signal(counts(signal), RATE, **settings).findings}  # type: ignore[arg-type]


def test_a_sound_signal_has_no_findings_and_its_numbers_are_right() -> None:
    health = examine_signal(counts(rig_signal()), RATE, nominal_period_s=PERIOD_S, ramp_up_s=RAMP_S, sync_channel=1)
    assert health.findings == ()
    assert health.error is None
    assert (health.sync_channel, health.sync_inverted) == (1, False)
    # Rises fall on whole samples.
    assert health.sweep_period_s == pytest.approx(PERIOD_S, abs=1 / RATE)
    assert health.beat_offset == pytest.approx(np.mean(rig_signal()[:, 0]), abs=1e-4)
    assert health.beat_clipped == 0
    # Side lobes of the sweeps' lines: -92 dB of 0.2 of full scale.
    assert health.hum < 1e-5


def test_levels_are_peak_and_rms() -> None:
    n = np.arange(4800)
    sine = (16_384 * np.sin(2 * np.pi * n / 48)).astype(np.int16)
    level = level_of(np.stack([sine, sine // 2], axis=1))
    # A sine of half scale: peak 1/2, rms 1/(2 sqrt 2).
    assert level.peak[0] == pytest.approx(0.5, abs=1e-4)
    assert level.rms == pytest.approx((0.35355, 0.17678), abs=1e-4)


def test_every_sample_type_is_a_fraction_of_its_full_scale() -> None:
    halves = {np.int16: 2**14, np.int32: 2**30, np.float32: 0.5}
    for kind, half in halves.items():
        assert fractions(np.array([[half, -half]], dtype=kind)).tolist() == [[0.5, -0.5]]


def test_dead_channels_are_named() -> None:
    good = rig_signal()
    constant = np.full(len(good), -150 / 32_767)  # a constant offset is silence
    for pair, trouble, words in (
        ((constant, constant), Trouble.SILENT, "both channels are silent"),
        ((good[:, 0], constant), Trouble.DEAD_CHANNEL, "channel 1 is silent"),
        ((constant, good[:, 1]), Trouble.DEAD_CHANNEL, "channel 0 is silent"),
        ((good[:, 1], 0.5 * good[:, 1]), Trouble.IDENTICAL, "same signal"),
    ):
        health = examine_signal(counts(np.stack(pair, axis=1)), RATE)
        assert health.error is not None
        assert (health.error.trouble, health.error.severity) == (trouble, Severity.ERROR)
        assert words in health.error.sentence
        assert health.error.advice
        assert health.sync_channel is None


def test_noise_and_sines_are_no_sync() -> None:
    rng = np.random.default_rng(5)
    t = np.arange(2 * RATE) / RATE
    sine, noise = 0.5 * np.sin(2 * np.pi * 25 * t), 0.1 * rng.standard_normal(len(t))
    assert troubles(np.stack([noise, sine], axis=1)) == {Trouble.NO_SYNC}
    assert troubles(np.stack([noise, np.roll(noise, 7)], axis=1)) == {Trouble.NO_SYNC}


def test_swapped_channels_and_an_inverted_sync_are_notes() -> None:
    good = rig_signal()
    assert troubles(good[:, ::-1]) == {Trouble.SWAPPED}
    assert troubles(good * (1, -1)) == {Trouble.INVERTED}
    health = examine_signal(counts(good * (1, -1)), RATE, ramp_up_s=RAMP_S)
    assert health.sync_inverted is True
    assert health.error is None
    # Up and down equally long: a recording does not tell which is which.
    even = examine_signal(counts(rig_signal(up=0.5)), RATE, ramp_up_s=PERIOD_S / 2)
    assert even.sync_inverted is None


@given(st.floats(-0.35, 0.35))
def test_the_period_is_told_from_two_per_cent_on(deviation: float) -> None:
    signal = rig_signal(1.0, period_s=PERIOD_S * (1 + deviation))
    found = troubles(signal, ramp_up_s=0.7 * PERIOD_S * (1 + deviation)) - {Trouble.HUM}
    # A sample of 1982 is 0.05 %.
    if abs(deviation) < 0.0195:
        assert found == set()
    elif abs(deviation) > 0.0205:
        assert found == {Trouble.PERIOD_OFF}


def test_a_rhythm_that_is_not_the_sweeps_is_an_error() -> None:
    assert troubles(rig_signal(), nominal_period_s=PERIOD_S * 1.7) >= {Trouble.WRONG_PERIOD}


def test_only_the_beat_can_be_clipped() -> None:
    good = rig_signal()
    assert troubles(good * (1, 10)) == set(), "a clipped sync is normal"
    health = examine_signal(counts(good * (20, 1)), RATE)
    assert [finding.trouble for finding in health.findings] == [Trouble.CLIPPED]
    # A sine of 4 times full scale is clipped for 1 - 2/pi asin(1/4) = 84 % of a period; the ramps hold about that.
    assert health.beat_clipped == pytest.approx(0.84, abs=0.03)


def test_a_weak_beat_and_an_offset_are_warned_of() -> None:
    good = rig_signal()
    assert troubles(good * (1e-3, 1)) == {Trouble.WEAK}
    assert troubles(np.add(good, (0.1, 0))) == {Trouble.OFFSET}
    assert troubles(np.add(good, (-150 / 32_768, 0))) == set(), "as the coffee-can recordings have it"


@pytest.mark.parametrize("hz", [50, 60, 100, 120])
@pytest.mark.parametrize("rate", [44_100, 192_000])
def test_mains_hum_is_measured_in_the_beat(hz: int, rate: int) -> None:
    # 0.0437 s: sweep lines at multiples of 22.88 Hz, all of them 4 Hz (two main lobes of 2 s) from these lines.
    signal = rig_signal(2.0, rate, period_s=0.0437)
    t = np.arange(len(signal)) / rate
    signal[:, 0] += 0.02 * np.sin(2 * np.pi * hz * t + 1)
    health = examine_signal(counts(signal), rate)
    assert [finding.trouble for finding in health.findings] == [Trouble.HUM]
    assert health.hum_hz == hz
    # Sidelobes of the sweeps' lines: -92 dB; the means over groups droop by sinc(120/2000): 0.6 %.
    assert health.hum == pytest.approx(0.02, rel=0.02)
    signal[:, 0] -= 0.019 * np.sin(2 * np.pi * hz * t + 1)
    assert examine_signal(counts(signal), rate).findings == ()


def test_hum_that_cannot_be_told_from_the_sweeps_is_unknown() -> None:
    # In a tenth of a second a line is 80 Hz wide.
    assert math.isnan(examine_signal(counts(rig_signal(0.1)), RATE).hum)


def test_a_sync_measured_elsewhere_is_believed() -> None:
    # One sweep and a half hold one rise only, which is too little to find a rhythm.
    short = counts(rig_signal(1.5 * PERIOD_S) * (1e-3, 1))
    assert examine_signal(short, RATE).error is not None
    health = examine_signal(short, RATE, nominal_period_s=PERIOD_S, sync=SyncMeasure(1, PERIOD_S, 0.7))
    assert [finding.trouble for finding in health.findings] == [Trouble.WEAK]


@given(st.integers(0, 2**32), st.integers(1, 4000), st.sampled_from(["int16", "int32", "float32"]))
def test_any_signal_is_answered(seed: int, frames: int, kind: str) -> None:
    noise = np.random.default_rng(seed).standard_normal((frames, 2)) * 10.0 ** np.arange(-5, -3)
    samples = noise.astype(kind) if kind == "float32" else (noise * 32_767).astype(kind)
    health = examine_signal(samples, RATE, nominal_period_s=PERIOD_S)
    assert all(finding.what and finding.advice for finding in health.findings)


def test_what_is_not_stereo_is_refused() -> None:
    for shape in ((100,), (100, 1), (0, 2)):
        with pytest.raises(ValueError, match="allowed"):
            examine_signal(np.zeros(shape, dtype=np.int16), RATE)


@pytest.mark.parametrize(
    ("name", "period_ms"),
    # Periods as the recordings' notes give them: 37.8 to 41.4 ms.
    [
        ("01-Chapa_Hand-09-06-22.wav", 40.7),
        ("23-05-20mph-Away-02-14-23-R.wav", 41.2),
        ("23-12-Big_Truck-30mph-03-28-23-R.wav", 40.9),
        ("43-4522-Big_Can-1-R.wav", 37.8),
    ],
)
def test_real_recordings_are_sound(name: str, period_ms: float) -> None:
    rate, samples = wavfile.read(real_data(f"coffee_can/{name}"))
    health = examine_signal(samples[: 2 * rate], rate, nominal_period_s=0.040, ramp_up_s=0.020, sync_channel=1)
    assert health.error is None
    assert health.sync_channel == 1
    assert health.sweep_period_s * 1e3 == pytest.approx(period_ms, abs=0.1)
    assert health.level.peak[1] > 0.999, "the sync is clipped by design"
    # "beat DC about -150 counts"
    assert health.beat_offset * 32_768 == pytest.approx(-150, abs=20)
    assert {finding.trouble for finding in health.findings} <= {Trouble.PERIOD_OFF}


@pytest.mark.parametrize(
    ("name", "trouble"),
    [("bad_no_sync.wav", Trouble.NO_SYNC), ("bad_silent_or_identical.wav", Trouble.IDENTICAL)],
)
def test_bad_recordings_are_errors(name: str, trouble: Trouble) -> None:
    rate, samples = wavfile.read(real_data(f"coffee_can/{name}"))
    error = examine_signal(samples, rate, nominal_period_s=0.040).error
    assert error is not None
    assert error.trouble is trouble
