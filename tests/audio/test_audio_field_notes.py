"""The measured traps of PortAudio's capture paths, and the test that shows that each is avoided.

================================================= =====================================================================
trap                                              test
================================================= =====================================================================
blocking read() drops samples silently            test_the_driver_never_reads_blocking
ALSA: a private configuration alone aborts        test_a_private_alsa_configuration_follows_the_systems_own
ALSA file: bit-exact, 8 to 384 kHz                test_sample_exactness::test_an_alsa_file
ALSA file: not paced, times mean nothing          test_sound_port::test_a_device_without_pace_is_refused_with_its_rate
ALSA file: stale samples after its end, no error  test_a_file_is_read_to_its_last_frame
Pulse: exact and paced at every rate and format   test_sample_exactness::test_pulseaudio
Pulse: never reports an overflow                  test_card_faults::test_pulseaudios_silent_loss_is_counted
Pulse: a rate mismatch resamples silently         test_card_faults::test_another_rate_than_the_cards_is_refused
Pulse: killing the server is an unplugging        test_card_faults::test_an_unplugged_card_and_its_return
JACK: float32 exact, 44.1 to 192 kHz              test_sample_exactness::test_jack
JACK: 50 ms stall: flag and a gap of one block    test_jack_port::test_a_stall_is_detected_to_the_exact_block[0.05]
JACK: 100 ms stall                                test_jack_port::test_a_stall_is_detected_to_the_exact_block[0.1]
JACK: terminate before the server stops           test_portaudio_is_terminated_with_the_last_port
JACK: stream.latency is nonsense                  test_jack_port::test_instants_do_not_rest_on_portaudios_latency
JACK: ADC times jitter                            test_stream_clock::test_wrong_adc_times_do_not_invent_losses
JACK: listing devices starts a server             test_listing_devices_starts_no_jack_server
JACK: an ended server hangs PortAudio             test_jack_port::test_an_ended_server_is_a_loss_and_what_to_do_is_said
recordings: sync clipped, DC, periods off nominal test_signal_health::test_real_recordings_are_sound
recordings: bad ones are refused                  test_signal_health::test_bad_recordings_are_errors
sync on the other channel, or inverted            test_swapped_and_inverted_cards_are_noted
sound cards drift                                 test_clock_drift_is_seen_to_five_parts_per_million
================================================= =====================================================================
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable

import numpy as np
import pytest
from audio_rig import Rig, need, take
from card_process import card_process
from counter_source import CounterSource, numbers_of

from drivers.radar import portaudio
from drivers.radar.health import Trouble
from drivers.radar.sound_port import SoundPort
from hw_mocks.rig import PULSE_GUARD_S
from hw_mocks.sound_card import AlsaFile
from polfuse_lab.clocks import fit_clock

pytestmark = pytest.mark.audio
QUIET_RMS_S = 50e-6
"""Scatter of clock fixes above which other programs, and not the sound card, are what is measured."""


def port_of(rig: Rig) -> SoundPort:
    assert rig.pulse is not None
    return SoundPort(
        SoundPort.Options(
            device=rig.pulse.device, environment=rig.pulse.environment, latency_s=0.02, guard_s=PULSE_GUARD_S
        )
    )


def test_the_driver_never_reads_blocking(make_rig: Callable[..., Rig], monkeypatch: pytest.MonkeyPatch) -> None:
    need("pulse")
    import sounddevice

    def forbidden(*_: object) -> None:
        raise AssertionError("a blocking read")

    monkeypatch.setattr(sounddevice.InputStream, "read", forbidden)
    radar = port_of(make_rig(pulse=True))
    radar.open()
    assert len(take(radar, 4800).samples) == 4800
    # The callback only copies: far less than its 10 ms, whatever else runs here (the longest includes preemption).
    assert 0 < radar.longest_callback_s < 0.2
    radar.close()


def test_a_private_alsa_configuration_follows_the_systems_own() -> None:
    need("alsa_file")
    file = AlsaFile(np.zeros((100, 2), dtype=np.int16))
    first, second = file.environment["ALSA_CONFIG_PATH"].split(":")
    assert first == "/usr/share/alsa/alsa.conf"
    assert os.path.exists(second)
    file.close()
    assert not os.path.exists(second)


def test_a_file_is_read_to_its_last_frame() -> None:
    need("alsa_file")
    numbers = np.arange(48_000)
    file = AlsaFile(CounterSource(48_000).whole(numbers).astype(np.int16))
    radar = SoundPort(SoundPort.Options(device=file.device, environment=file.environment, check_pace=False))
    try:
        radar.open()
        np.testing.assert_array_equal(numbers_of(take(radar, 48_000).samples), numbers)
    finally:
        radar.close()
        file.close()


def test_portaudio_is_terminated_with_the_last_port() -> None:
    need("alsa_file")
    import sounddevice

    file = AlsaFile(np.zeros((48_000, 2), dtype=np.int16))
    radar = SoundPort(SoundPort.Options(device=file.device, environment=file.environment, check_pace=False))
    radar.open()
    assert sounddevice._initialized == 1
    radar.close()
    assert sounddevice._initialized == 0
    file.close()


def test_listing_devices_starts_no_jack_server() -> None:
    need("alsa_file")
    file = AlsaFile(np.zeros((100, 2), dtype=np.int16))
    portaudio.acquire(file.environment)
    try:
        assert os.environ["JACK_NO_START_SERVER"] == "1"
    finally:
        portaudio.release()
        file.close()


def test_swapped_and_inverted_cards_are_noted(make_rig: Callable[..., Rig]) -> None:
    need("pulse")
    radar = port_of(make_rig(pulse=True, sync_channel=0, sync_inverted=True))
    radar.open()
    time.sleep(0.5)
    # The ramp up takes 20 ms of 40: the recording alone does not tell the polarity, a ramp of 28 ms would not fit.
    health = radar.health(0.040, 0.020)
    radar.close()
    assert health.error is None
    assert health.sync_channel == 0
    assert Trouble.DEAD_CHANNEL not in {finding.trouble for finding in health.findings}


@pytest.mark.slow
@pytest.mark.parametrize("ppm", [100.0, -40.0])
def test_clock_drift_is_seen_to_five_parts_per_million(ppm: float) -> None:
    need("pulse")
    with card_process(drift_ppm=ppm) as card:
        options = {"device": card["device"], "environment": card["environment"]}
        radar = SoundPort(SoundPort.Options(latency_s=0.02, guard_s=PULSE_GUARD_S, **options))  # type: ignore[arg-type]
        radar.open()
        fixes = []
        for _ in range(44):
            time.sleep(0.5)
            fix = radar.clock()
            if fix is not None and (not fixes or fix != fixes[-1]):
                fixes.append(fix)
        radar.close()
    # One fix a second; the first one still belongs to the start.
    fixes = fixes[1:]
    assert (fixes[-1].t_host_ns - fixes[0].t_host_ns) * 1e-9 == pytest.approx(20, abs=1.5)
    fit = fit_clock(
        "radar",
        np.array([fix.t_device_s for fix in fixes]),
        np.array([fix.t_host_ns for fix in fixes]),
        np.array([fix.round_trip_ns for fix in fixes]),
    )
    assert fit is not None
    if fit.residual_rms_s > QUIET_RMS_S:
        pytest.skip(f"this computer is too busy: arrivals scatter by {fit.residual_rms_s * 1e6:.0f} us")
    # Fixes scatter by some 30 us: over 20 of them in 20 s that is 1.2 ppm (30e-6 / 20 * sqrt(12 / 20)): a quarter of 5.
    assert -fit.drift_ppm == pytest.approx(ppm, abs=5)
