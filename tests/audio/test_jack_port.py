"""The audio port over JACK, the one host API that flags its overflows: losses are counted to the exact block."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest
from audio_rig import finish, need, take
from counter_source import CounterSource, numbers_of

from drivers.errors import DeviceBadAnswer, DeviceRefused
from drivers.radar.ring import SampleRing
from drivers.radar.sound_port import SoundPort
from hw_mocks.faults import FaultKind, FaultScript
from hw_mocks.sound_card import JackCard

pytestmark = pytest.mark.audio
RATE = 48_000


def options_for(card: JackCard, **changes: object) -> SoundPort.Options:
    settings = {"device": card.device, "environment": card.environment, "sample_format": "float32"}
    return SoundPort.Options(**{**settings, **changes})  # type: ignore[arg-type]


@pytest.fixture
def card() -> Iterator[JackCard]:
    need("jack")
    card = JackCard(CounterSource(RATE))
    yield card
    card.close()
    assert card.failure is None


@pytest.fixture
def radar(card: JackCard) -> Iterator[SoundPort]:
    radar = SoundPort(options_for(card))
    radar.open()
    yield radar
    radar.close()


def delay_next_callback(monkeypatch: pytest.MonkeyPatch, seconds: float) -> threading.Event:
    """The next callback keeps the audio thread for that long, as an overloaded computer does."""
    done, write = threading.Event(), SampleRing.write

    def late(ring: SampleRing, *arguments: object) -> None:
        if not done.is_set():
            done.set()
            time.sleep(seconds)
        write(ring, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(SampleRing, "write", late)
    return done


@pytest.mark.parametrize("stall_s", [0.05, 0.1])
def test_a_stall_is_detected_to_the_exact_block(
    card: JackCard, radar: SoundPort, monkeypatch: pytest.MonkeyPatch, stall_s: float
) -> None:
    before = take(radar, 4800)
    radar.begin(RATE)
    time.sleep(0.3)
    assert delay_next_callback(monkeypatch, stall_s).wait(1)
    block = finish(radar)
    after = take(radar, 4800)
    numbers = numbers_of(block.samples)
    steps = np.diff(numbers)
    gaps = steps[steps != 1] - 1
    # The samples tell what is missing: whole blocks; 50 ms against periods of 20 ms leave one of them out. (A loaded
    # computer may add an xrun of its own.)
    assert len(gaps) >= 1
    assert np.all(gaps % card.period_frames == 0)
    if stall_s == 0.05:
        assert gaps[0] == card.period_frames
    missing = int(np.sum(gaps))
    assert block.overflow
    assert block.lost_frames == radar.lost_frames == missing
    # Frame numbers of later records have the gap in them, to the frame.
    starts = [int(numbers_of(piece.samples[:1])[0]) for piece in (before, after)]
    assert after.first_frame - before.first_frame == starts[1] - starts[0]
    assert (after.lost_frames, after.overflow) == (0, False)


def test_another_rate_than_the_servers_is_refused(card: JackCard) -> None:
    with pytest.raises(DeviceRefused, match="runs at 48000 Hz and would be resampled to 44100 Hz"):
        SoundPort(options_for(card, sample_rate_hz=44_100.0)).open()


def test_instants_do_not_rest_on_portaudios_latency(radar: SoundPort) -> None:
    # PortAudio calls its latency over JACK 89478 s.
    before_ns = time.monotonic_ns()
    block = take(radar, 4800)
    # The guard is 60 ms; arrivals are known to a fraction of a block of 20 ms.
    assert block.t_host_ns - before_ns == pytest.approx(60e6, abs=10e6)


def test_the_servers_own_block_length_is_used(radar: SoundPort, card: JackCard) -> None:
    # 480 frames are the default of the options; JACK's period is 960.
    arrivals, _ = radar._ring.arrivals(0)
    assert {arrival.frames for arrival in arrivals} == {card.period_frames}


def test_an_ended_server_is_a_loss_and_what_to_do_is_said(card: JackCard) -> None:
    # In a process of its own: closing a stream of a JACK server that has ended hangs in PortAudio 19.6 for ever.
    program = """
import json, sys, time
from drivers.errors import DeviceError
from drivers.radar.sound_port import SoundPort
options = json.loads(sys.argv[1])
radar = SoundPort(SoundPort.Options(sample_format="float32", open_timeout_s=1.0, **options))
radar.open()
radar.begin(480_000)
print("open", flush=True)
sys.stdin.readline()
start = time.monotonic()
try:
    while radar.poll() is None:
        time.sleep(0.01)
except DeviceError as error:
    print(f"{type(error).__name__} {time.monotonic() - start < 2} {error}", flush=True)
radar.close()
sys.stdin.readline()
try:
    print("again", radar.open().name, flush=True)
    radar.close()
except DeviceError as error:
    print(error, flush=True)
"""
    options = json.dumps({"device": card.device, "environment": card.environment})
    process = subprocess.Popen(
        [sys.executable, "-c", program, options], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == "open\n"
        card.kill()
        process.stdin.write("\n")
        process.stdin.flush()
        said = process.stdout.readline()
        assert said.startswith("DeviceLost True")
        assert "unplugged" in said
        card.plug_in()
        process.stdin.write("\n")
        process.stdin.flush()
        # A later PortAudio may find back; this one says what helps, and the program ends by itself.
        answer = process.stdout.readline()
        assert "end this program and start it again" in answer or answer == "again polfuse_radar\n"
        assert process.wait(timeout=10) == 0
    finally:
        process.kill()
        process.wait()
        process.stdin.close()
        process.stdout.close()
    # Another process finds the card that is back.
    radar = SoundPort(options_for(card))
    radar.open()
    np.testing.assert_array_equal(np.diff(numbers_of(take(radar, 9600).samples)), 1)
    radar.close()


def test_dead_channels_and_garbage_are_told() -> None:
    need("jack")
    faults = FaultScript()
    card = JackCard(CounterSource(RATE), faults=faults)
    radar = SoundPort(options_for(card))
    try:
        radar.open()
        faults.start(FaultKind.SILENCE, amount=2)
        time.sleep(2.2)
        with pytest.raises(DeviceBadAnswer, match="both channels are silent"):
            radar.check_signal()
        faults.stop(FaultKind.SILENCE)
        faults.start(FaultKind.GARBAGE)
        time.sleep(2.2)
        with pytest.raises(DeviceBadAnswer, match="neither channel carries a sync"):
            radar.check_signal()
    finally:
        radar.close()
        card.close()
