"""Every sample that leaves the simulated sound card is recorded bit for bit, on each PortAudio path, rate and format.

The samples hold their own number, so that the expected record follows from the first one alone.
"""

from __future__ import annotations

import numpy as np
import pytest
from audio_rig import need, take
from counter_source import CounterSource, numbers_of

from drivers.radar.sound_port import SoundPort
from hw_mocks.sound_card import AlsaFile, JackCard, PulseSource, SoundCard
from hw_mocks.sound_card.sample_formats import SampleFormat

pytestmark = pytest.mark.audio


def expect_exact(radar: SoundPort, source: CounterSource, captured_as: str) -> None:
    """Two records, each of them whole and exact, their frame numbers as far apart as their contents."""
    blocks = [take(radar, round(0.3 * radar.sample_rate_hz)) for _ in range(2)]
    starts = []
    for block in blocks:
        assert block.samples.dtype == np.dtype(captured_as)
        assert (block.lost_frames, block.overflow) == (0, False)
        first = int(numbers_of(block.samples[:1])[0])
        np.testing.assert_array_equal(
            block.samples, source.expected(first + np.arange(len(block.samples)), captured_as)
        )
        starts.append(first)
    assert blocks[1].first_frame - blocks[0].first_frame == starts[1] - starts[0]
    assert radar.lost_frames == 0


@pytest.mark.parametrize(
    ("rate", "sample_format", "captured_as"),
    [
        (44_100, "int16", "int16"),
        (48_000, "int16", "int16"),
        (96_000, "int16", "int16"),
        (192_000, "int16", "int16"),
        (48_000, "int24", "int32"),
        (192_000, "int24", "int32"),
        (44_100, "int32", "int32"),
        (192_000, "int32", "int32"),
        (96_000, "float32", "float32"),
        (192_000, "float32", "float32"),
    ],
)
def test_pulseaudio(rate: int, sample_format: SampleFormat, captured_as: str) -> None:
    need("pulse")
    source = CounterSource(rate, sample_format)
    pulse = PulseSource(rate, sample_format=sample_format)
    card = SoundCard(source, [pulse])
    radar = SoundPort(
        SoundPort.Options(
            device=pulse.device,
            environment=pulse.environment,
            sample_rate_hz=rate,
            sample_format=captured_as,  # type: ignore[arg-type]
            block_frames=rate // 100,
            latency_s=0.02,
            guard_s=0.03,
        )
    )
    try:
        card.start()
        radar.open()
        expect_exact(radar, source, captured_as)
    finally:
        radar.close()
        card.close()
    assert card.failure is None


@pytest.mark.parametrize("rate", [44_100, 48_000, 96_000, 192_000])
def test_jack(rate: int) -> None:
    need("jack")
    source = CounterSource(rate)
    card = JackCard(source)
    radar = SoundPort(
        SoundPort.Options(
            device=card.device, environment=card.environment, sample_rate_hz=rate, sample_format="float32"
        )
    )
    try:
        assert "JACK" in radar.open().detail
        expect_exact(radar, source, "float32")
    finally:
        radar.close()
        card.close()
    assert card.failure is None


@pytest.mark.parametrize("rate", [8_000, 44_100, 48_000, 96_000, 192_000, 384_000])
def test_an_alsa_file(rate: int) -> None:
    need("alsa_file")
    source = CounterSource(rate)
    numbers = np.arange(200_000)
    file = AlsaFile(source.block(0, len(numbers), 0).astype(np.int16))
    radar = SoundPort(
        SoundPort.Options(device=file.device, environment=file.environment, check_pace=False, sample_rate_hz=rate)
    )
    try:
        radar.open()
        block = take(radar, 150_000)
        np.testing.assert_array_equal(block.samples, source.expected(numbers[:150_000], "int16"))
    finally:
        radar.close()
        file.close()
