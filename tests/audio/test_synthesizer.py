"""The simulated sound card's samples against the numerics, and its reproducibility."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw_mocks.sound_card import AudioSettings, Synthesizer
from hw_mocks.world import World
from polfuse_lab.rig import Geometry, Waveform
from processing.radar.antenna import boresight, one_way_gain
from processing.radar.beat import TriangleFm, beat_reference
from processing.scene.model import FrontEnd, Point, Scene

WAVEFORM = Waveform(centre_hz=2.4e9, bandwidth_hz=80e6, ramp_up_s=0.020, sweep_period_s=0.040)
GEOMETRY = Geometry(antenna_height_m=1.069)
S_POINT = np.array([[20 + 5j, 3j], [3j, -12 + 1j]])
POSITION = (1.0, 9.0, -1.0)


def scene(noise: float = 0.0, **front_end: object) -> Scene:
    return Scene("one point", points=(Point("p", POSITION, S_POINT),), front_end=FrontEnd(noise=noise, **front_end))


def synthesizer(world: World, *, seed: int = 1, noise: float = 0.0, audio: AudioSettings | None = None) -> Synthesizer:
    settings = audio or AudioSettings(sync_noise=0.001 if noise else 0.0)
    return Synthesizer(scene(noise), WAVEFORM, GEOMETRY, settings, world, seed)


def at(x_m: float, transmit: str = "H", receive: str = "H") -> World:
    world = World()
    world.trolley_x_m.hold(x_m, 1)
    world.transmit.set(transmit, 1)
    world.receive.set(receive, 1)
    return world


def test_samples_equal_the_per_sample_reference_in_every_channel() -> None:
    gain = one_way_gain(
        np.dot(np.subtract(POSITION, (0.5, 0, 0)), boresight(math.radians(17)))
        / np.linalg.norm(np.subtract(POSITION, (0.5, 0, 0))),
        math.radians(70),
    )
    sweep = TriangleFm(2.4e9, 80e6, 0.020, 1920.5 / 48_000)
    for transmit in "HV":
        for receive in "HV":
            samples = synthesizer(at(0.5, transmit, receive)).block(7000, 480, time.monotonic_ns())
            amplitude = gain * S_POINT["HV".index(receive), "HV".index(transmit)]
            expected = [
                beat_reference(sweep, math.fmod(n, 1920.5) / 48_000, (0.5, 0, 0), [POSITION], [amplitude])
                for n in range(7000, 7480)
            ]
            # Rounding to whole counts: half a count, and 1e-6 rad of the reference's own error.
            np.testing.assert_allclose(samples[:, 0] / 32_767, expected, atol=0.51 / 32_767)


def test_a_moving_trolley_follows_its_track_sample_by_sample() -> None:
    world = World()
    t0 = 10**12
    world.trolley_x_m.move(-0.1, 0.1, t0, t0 + 10**9)
    samples = synthesizer(world).block(0, 480, t0 + 5 * 10**8)
    sweep = TriangleFm(2.4e9, 80e6, 0.020, 1920.5 / 48_000)
    # 0.2 m/s; 480 samples of 1/48000 s after the middle of the move. The pattern is that of the block's middle: it
    # changes by less than 1e-4 over 2 mm.
    for n in (0, 100, 479):
        antenna = (0.2 * n / 48_000, 0.0, 0.0)
        sight = np.subtract(POSITION, antenna)
        gain = one_way_gain(sight @ boresight(math.radians(17)) / np.linalg.norm(sight), math.radians(70))
        expected = beat_reference(sweep, n / 48_000, antenna, [POSITION], [complex(gain * S_POINT[0, 0])])
        assert samples[n, 0] / 32_767 == pytest.approx(expected, abs=0.51 / 32_767 + 1e-4 * abs(S_POINT[0, 0]) / 82)


@given(st.integers(-1, 481), st.integers(0, 20_832))
def test_every_sample_after_a_move_is_that_of_the_standing_rig(samples: int, fraction_ns: int) -> None:
    # The move ends anywhere within a block; what follows must not depend on where the block began.
    world, t0 = World(), 10**12
    end_ns = t0 + round(samples / 48_000 * 1e9) + fraction_ns
    world.trolley_x_m.move(0.2, 0.25, end_ns - 10**8, end_ns)
    block = synthesizer(world, noise=0.02).block(960, 480, t0)
    standing = synthesizer(at(0.25), noise=0.02).block(960, 480, t0)
    after = t0 + np.rint(np.arange(480) / 48_000 * 1e9) >= end_ns
    np.testing.assert_array_equal(block[after], standing[after])


def test_a_switch_acts_at_its_own_sample_and_travelling_contacts_pass_nothing() -> None:
    world = at(0.0)
    t0 = 10**12
    world.receive.set("?", t0 + 2_000_000)
    world.receive.set("V", t0 + 5_000_000)
    samples = synthesizer(world).block(0, 480, t0)[:, 0]
    co, cross = synthesizer(at(0.0)).block(0, 480, t0)[:, 0], synthesizer(at(0.0, "H", "V")).block(0, 480, t0)[:, 0]
    # 2 ms and 5 ms at 48 kHz: samples 96 and 240.
    np.testing.assert_array_equal(samples[:96], co[:96])
    np.testing.assert_array_equal(samples[96:240], 0)
    np.testing.assert_array_equal(samples[240:], cross[240:])


@given(st.integers(0, 10**7), st.integers(1, 700))
def test_blocks_join_without_a_seam(first: int, frames: int) -> None:
    world = at(0.25)
    maker, t_ns = synthesizer(world, noise=0.02), 10**12
    whole = maker.block(first, frames + 100, t_ns)
    parts = np.concatenate([maker.block(first, frames, t_ns), maker.block(first + frames, 100, t_ns)])
    np.testing.assert_array_equal(whole, parts)


def test_any_contiguous_noise_cycle_of_sweeps_is_the_same_set_to_the_last_bit() -> None:
    audio = AudioSettings(sweep_period_samples=1920.25, noise_cycle=4, sync_noise=0.001)
    maker = synthesizer(at(-1.2192), noise=0.02, audio=audio)

    def sweeps(first_sweep: int) -> set[bytes]:
        found = set()
        for number in range(first_sweep, first_sweep + 4):
            start = math.ceil(number * 1920.25)
            found.add(maker.block(start, 1920, 10**12).tobytes())
        return found

    reference = sweeps(0)
    assert len(reference) == 4
    for first in (1, 2, 3, 17, 1_000_003):
        assert sweeps(first) == reference


def test_noise_depends_on_seed_place_and_channel_and_on_nothing_else() -> None:
    def noise_of(world: World, seed: int) -> np.ndarray:
        clean = synthesizer(world).block(0, 3841, 10**12)
        noisy = synthesizer(world, seed=seed, noise=0.02).block(0, 3841, 10**12)
        return (noisy.astype(float) - clean)[:, 0] / 32_767

    reference = noise_of(at(0.1), 1)
    # Standard deviation of an rms over 3841 samples is rms / sqrt(2 * 3841) = 1.1 %; five of those.
    assert np.std(reference) == pytest.approx(0.02, rel=0.06)
    # Rounded to 0.01 mm: 2 um make no difference.
    assert np.max(np.abs(noise_of(at(0.100002), 1) - reference)) < 2 / 32_767
    for other in (noise_of(at(0.1), 2), noise_of(at(0.1508), 1), noise_of(at(0.1, "V"), 1)):
        # Correlation of independent noise: 1/sqrt(3841) = 0.016; five of those.
        assert abs(np.corrcoef(reference, other)[0, 1]) < 0.08


def test_front_end_mixes_channels_as_receive_s_transmit() -> None:
    receive, transmit = np.array([[1, 0.1j], [0.2, 0.9]]), np.array([[1, 0.05], [0.3j, 1.1]])
    mixed = Scene("m", points=(Point("p", POSITION, S_POINT),), front_end=FrontEnd(receive, transmit))
    plain = Scene("m", points=(Point("p", POSITION, receive @ S_POINT @ transmit),))
    for route in ("HV", "VV"):
        blocks = [
            Synthesizer(s, WAVEFORM, GEOMETRY, AudioSettings(), at(0.0, *route), 1).block(0, 480, 10**12)
            for s in (mixed, plain)
        ]
        assert np.max(np.abs(blocks[0].astype(int) - blocks[1])) <= 1


def test_range_offset_delays_without_spreading() -> None:
    offset = Geometry(antenna_height_m=1.069, range_offset_m=2.0)
    samples = Synthesizer(scene(), WAVEFORM, offset, AudioSettings(), at(0.0), 1).block(0, 960, 10**12)[:, 0]
    plain = synthesizer(at(0.0)).block(0, 960, 10**12)[:, 0]
    # Same strength (peak amplitude within the samples seen), higher beat frequency: 2 B r / c cycles per ramp.
    assert np.max(np.abs(samples)) == pytest.approx(np.max(np.abs(plain)), rel=0.02)
    crossings = [np.count_nonzero(np.diff(np.signbit(s))) / 2 for s in (samples, plain)]
    assert crossings[0] - crossings[1] == pytest.approx(2 * 80e6 * 2.0 / 299_792_458, abs=1.0)


def test_audio_settings_need_a_whole_cycle() -> None:
    with pytest.raises(ValueError, match="whole number"):
        AudioSettings(sweep_period_samples=1920.3, noise_cycle=2)
