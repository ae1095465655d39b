"""The audio port's driver through PortAudio: a paced PulseAudio source and an exact ALSA file."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from audio_rig import Rig, finish, need, position_in_cycle, take
from scipy.stats import theilslopes

from drivers.contracts import Radar
from drivers.errors import DeviceLost, DeviceRefused, DeviceTimeout
from drivers.radar import portaudio
from drivers.radar.devices import find_device
from drivers.radar.sound_port import SoundPort
from drivers.registry import driver_class
from hw_mocks.rig import PULSE_GUARD_S
from hw_mocks.sound_card import AlsaFile, PulseSource
from polfuse_lab.errors import PolfuseError

pytestmark = pytest.mark.audio


def options_for(rig: Rig, **changes: object) -> SoundPort.Options:
    assert rig.pulse is not None
    settings = {
        "latency_s": 0.02,
        "guard_s": PULSE_GUARD_S,
        "device": rig.pulse.device,
        "environment": rig.pulse.environment,
    }
    return SoundPort.Options(**{**settings, **changes})


@pytest.fixture
def port(make_rig: Callable[..., Rig]) -> Iterator[tuple[Rig, SoundPort]]:
    need("pulse")
    rig = make_rig(pulse=True)
    radar = SoundPort(options_for(rig))
    identity = radar.open()
    assert identity.name == "polfuse_radar"
    yield rig, radar
    radar.close()


def test_it_is_the_registered_radar() -> None:
    assert driver_class("radar", "sounddevice") is SoundPort
    assert isinstance(SoundPort(SoundPort.Options()), Radar)


def test_pulse_records_are_exact_paced_whole_and_quick(port: tuple[Rig, SoundPort]) -> None:
    rig, radar = port
    cycle = rig.synthesizer.block(0, 3841, time.monotonic_ns())
    durations = []
    previous = 0
    for _ in range(5):
        before_ns = time.monotonic_ns()
        block = take(radar, 4073)  # two sweeps of 40 ms and 6 %, as a record of one cycle needs
        durations.append((time.monotonic_ns() - before_ns) * 1e-9)
        assert position_in_cycle(block.samples, cycle) >= 0, "not the simulated samples, bit for bit"
        # The first frame at or after the guard; a sample is 21 us, the envelope may still improve by a millisecond.
        assert block.t_host_ns - before_ns == pytest.approx(PULSE_GUARD_S * 1e9, abs=3e6)
        assert block.lost_frames == 0
        assert block.first_frame > previous
        previous = block.first_frame
    # Guard 30 ms and 85 ms of samples; the rest is delivery.
    assert min(durations) < 0.20
    assert radar.lost_frames == 0
    assert radar.level().peak[1] == pytest.approx(0.7, abs=0.005)
    radar.check_signal()


def test_no_record_holds_samples_from_before_it_was_asked_for(port: tuple[Rig, SoundPort]) -> None:
    # A switch turns, a record is asked for at once: every sample shows the new route.
    rig, radar = port
    for number in range(8):
        rig.world.receive.set("VH"[number % 2])
        block = take(radar, 2400)
        assert position_in_cycle(block.samples, rig.synthesizer.block(0, 3841, time.monotonic_ns())) >= 0


def test_the_delay_of_the_path_is_well_below_the_guard(port: tuple[Rig, SoundPort]) -> None:
    # The instant of a change as the record tells it, against when it was made.
    rig, radar = port
    delays_ms = []
    for number in range(6):
        radar.begin(7200)
        time.sleep(0.06)
        changed_ns = time.monotonic_ns()
        rig.world.receive.set("?H"[number % 2])
        block = finish(radar)
        quiet = np.abs(block.samples[:, 0].astype(int)) < 0.07 * 32_767  # echo 0.3 of full scale, noise 0.01
        # Where a window of 2 ms changes between echo (mostly loud) and noise (never).
        loud = np.convolve(~quiet, np.ones(96), "same") > 10
        edge = np.flatnonzero(np.diff(loud.astype(int)))
        assert len(edge) == 1
        delays_ms.append((block.t_host_ns - changed_ns) * 1e-6 + edge[0] / 48)
    # The simulator hands on blocks of 10 ms, so the least delay lies between 0 and 10 ms; the window blurs by 1 ms and
    # scheduling adds some. It must stay well below the simulated rig's guard.
    assert min(delays_ms) > -3
    assert max(delays_ms) < 13
    assert PULSE_GUARD_S > 2 * 0.013


def test_silently_lost_samples_are_counted(port: tuple[Rig, SoundPort]) -> None:
    rig, radar = port
    radar.begin(48_000)
    time.sleep(0.3)
    rig.card.skip(4800)
    block = finish(radar)
    assert not block.overflow, "PulseAudio says nothing"
    # The envelope's uncertainty: a few milliseconds of 100 ms.
    assert block.lost_frames == pytest.approx(4800, abs=250)
    assert radar.lost_frames == block.lost_frames
    later = take(radar, 4800)
    assert later.lost_frames == 0
    assert later.first_frame >= block.first_frame + 48_000 + block.lost_frames


def test_a_pause_of_the_server_that_is_caught_up_loses_nothing(port: tuple[Rig, SoundPort]) -> None:
    rig, radar = port
    assert rig.pulse is not None
    radar.begin(24_000)
    time.sleep(0.15)
    os.kill(rig.pulse.pid, signal.SIGSTOP)
    time.sleep(0.25)
    os.kill(rig.pulse.pid, signal.SIGCONT)
    block = finish(radar)
    assert block.lost_frames == 0
    assert position_in_cycle(block.samples, rig.synthesizer.block(0, 3841, time.monotonic_ns())) >= 0


def test_a_stalled_port_is_a_timeout_and_an_ended_server_a_loss(make_rig: Callable[..., Rig]) -> None:
    need("pulse")
    rig = make_rig(pulse=True)
    assert rig.pulse is not None
    radar = SoundPort(options_for(rig, stall_timeout_s=0.4))
    radar.open()
    rig.card.skip(24_000)
    radar.begin(9600)
    with pytest.raises(DeviceTimeout, match="no sample"):
        finish(radar)
    radar.cancel()
    time.sleep(0.3)
    radar.begin(480_000)
    rig.pulse.kill()
    before = time.monotonic()
    with pytest.raises(DeviceLost, match="unplugged"):
        finish(radar)
    assert time.monotonic() - before < 2
    radar.close()
    with pytest.raises(DeviceLost, match="not open"):
        radar.poll() or radar.begin(1)


def test_another_rate_is_carried_too_and_a_port_reopens(make_rig: Callable[..., Rig]) -> None:
    need("pulse")
    rig = make_rig(pulse=True, sample_rate_hz=96_000.0, sweep_period_samples=3841.0, noise_cycle=1)
    radar = SoundPort(options_for(rig, sample_rate_hz=96_000.0, block_frames=960))
    for _ in range(2):
        radar.open()
        block = take(radar, 9600)
        cycle = rig.synthesizer.block(0, 3841, time.monotonic_ns())
        assert position_in_cycle(block.samples, cycle) >= 0
        radar.close()
        radar.close()


def test_clock_drift_of_the_card_shows_in_the_clock_fixes(make_rig: Callable[..., Rig]) -> None:
    need("pulse")
    rig = make_rig(pulse=True, clock_drift_ppm=1000.0)
    radar = SoundPort(options_for(rig))
    radar.open()
    # The first second holds the filling of the server's buffers, which come in a burst and not at the card's pace.
    time.sleep(1.5)
    fixes = []
    end = time.monotonic() + 5
    while time.monotonic() < end:
        fix = radar.clock()
        assert fix is not None
        fixes.append((fix.t_host_ns * 1e-9, fix.t_device_s))
        time.sleep(0.05)
    radar.close()
    host, device = np.asarray(fixes).T
    # Theil-Sen's median of slopes: a busy machine delays single arrivals by 10 ms and more, but not most of them.
    slope = theilslopes(device - host, host - host[0]).slope
    # 1000 ppm over some 5 s is 5 ms; a fix's own uncertainty is about 1 ms, and their median's much less.
    assert slope == pytest.approx(1e-3, abs=0.5e-3)
    assert radar.lost_frames == 0


def test_misuse_is_answered_in_words(port: tuple[Rig, SoundPort]) -> None:
    rig, radar = port
    with pytest.raises(DeviceRefused, match="open already"):
        radar.open()
    with pytest.raises(DeviceRefused, match="-1 frames"):
        radar.begin(-1)
    with pytest.raises(DeviceRefused, match="memory"):
        radar.begin(10**15)
    radar.begin(10**6)
    with pytest.raises(DeviceRefused, match="under way"):
        radar.begin(10)
    radar.make_safe()
    assert radar.poll() is None
    other = SoundPort(options_for(rig, environment={"PULSE_SERVER": "unix:/nowhere"}))
    with pytest.raises(DeviceRefused, match="different environment"):
        other.open()
    missing = SoundPort(options_for(rig, device="no such card"))
    with pytest.raises(DeviceRefused, match="polfuse_radar"):
        missing.open()
    assert len(take(radar, 100).samples) == 100, "the open port is not disturbed"


def test_an_alsa_file_is_read_bit_for_bit() -> None:
    need("alsa_file")
    frames = 1_000_000
    counter = np.arange(frames)
    samples = np.stack([counter & 0x7FFF, counter >> 15], axis=1).astype(np.int16)
    file = AlsaFile(samples)
    radar = SoundPort(SoundPort.Options(device=file.device, environment=file.environment, check_pace=False, ring_s=2.0))
    try:
        radar.open()
        # Records follow each other from the file's first frame on, also one that is longer than the ring.
        for first, count in ((0, 40_000), (40_000, 200_000), (240_000, 1)):
            block = take(radar, count)
            number = block.samples[:, 1].astype(int) * 32_768 + block.samples[:, 0]
            assert (block.lost_frames, block.first_frame) == (0, first)
            np.testing.assert_array_equal(number, first + np.arange(count))
    finally:
        radar.close()
        file.close()


def test_a_device_without_pace_is_refused_with_its_rate() -> None:
    need("alsa_file")
    file = AlsaFile(np.zeros((48_000, 2), dtype=np.int16))
    radar = SoundPort(SoundPort.Options(device=file.device, environment=file.environment))
    try:
        with pytest.raises(DeviceRefused, match=r"delivers \d+ samples a second, not 48000"):
            radar.open()
    finally:
        radar.close()
        file.close()


class FakeSounddevice:
    """The part of sounddevice that lists devices, with a laptop's typical list."""

    class default:  # noqa: N801 - the name is sounddevice's
        device = (1, 0)

    def query_hostapis(self) -> list[dict[str, str]]:
        return [{"name": "MME"}, {"name": "Windows WASAPI"}]

    def query_devices(self) -> list[dict[str, object]]:
        rows = [
            ("Line In (USB Audio)", 0, 2, 44_100),
            ("Microphone", 1, 1, 48_000),
            ("Line In (USB Audio)", 1, 2, 44_100),
        ]
        keys = ("name", "hostapi", "max_input_channels", "default_samplerate")
        return [dict(zip(keys, row, strict=True), index=i) for i, row in enumerate(rows)]


def test_devices_are_chosen_by_name_and_resampling_ones_refused() -> None:
    fake = FakeSounddevice()
    assert find_device(fake, "line in (usb audio), mme", 48_000, "w").index == 0
    assert "without saying so" in find_device(fake, "USB Audio), MME", 48_000, "w").detail
    with pytest.raises(DeviceRefused, match="2 sound inputs match"):
        find_device(fake, "Line In", 48_000, "w")
    with pytest.raises(DeviceRefused, match="mono"):
        find_device(fake, "", 48_000, "w")
    with pytest.raises(DeviceRefused, match="runs at 44100 Hz and would be resampled to 48000"):
        find_device(fake, "Line In (USB Audio), Windows WASAPI", 48_000, "w")
    assert find_device(fake, "Line In (USB Audio), Windows WASAPI", 44_100, "w").index == 2


def test_wrong_options_are_refused() -> None:
    with pytest.raises(DeviceRefused, match="LD_PRELOAD"):
        SoundPort(SoundPort.Options(environment={"LD_PRELOAD": "x"}))
    for wrong in (
        {"sample_rate_hz": float("nan")},
        {"guard_s": -1.0},
        {"sample_format": "int24"},
        {"block_frames": -1},
    ):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            SoundPort(SoundPort.Options(**wrong))  # type: ignore[arg-type]


def test_a_missing_portaudio_library_says_what_to_install() -> None:
    # In a process of its own: sounddevice looks for the library once, when it is imported.
    program = """
import ctypes.util, importlib.util
ctypes.util.find_library = lambda name: None
from drivers.radar.sound_port import SoundPort
from drivers.errors import DeviceError
try:
    SoundPort(SoundPort.Options()).open()
except DeviceError as error:
    print(error)
"""
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=30, check=False)
    assert "libportaudio2" in run.stdout, run.stdout + run.stderr


def test_a_call_that_hangs_is_given_up() -> None:
    release = threading.Event()
    with pytest.raises(DeviceTimeout, match="opening did not finish"):
        portaudio.bounded(release.wait, 0.05, "opening", "port")
    release.set()

    def fail() -> None:
        raise OSError("no")

    with pytest.raises(OSError, match="no"):
        portaudio.bounded(fail, 1, "opening", "port")


def test_nothing_is_left_behind(make_rig: Callable[..., Rig]) -> None:
    need("pulse")
    before, environment = set(threading.enumerate()), dict(os.environ)
    rig = make_rig(pulse=True)
    assert rig.pulse is not None
    pid, directory = rig.pulse.pid, os.path.dirname(rig.pulse.environment["PULSE_COOKIE"])
    radar = SoundPort(options_for(rig))
    radar.open()
    radar.close()
    rig.card.close()
    assert set(threading.enumerate()) <= before
    assert dict(os.environ) == environment
    assert not os.path.exists(directory)
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_a_killed_simulator_takes_its_sound_server_along() -> None:
    need("pulse")
    program = """
import time
from hw_mocks.sound_card import PulseSource
print(PulseSource(48_000.0).pid, flush=True)
time.sleep(60)
"""
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    pid = int(process.stdout.readline())
    process.kill()
    process.wait()
    process.stdout.close()
    deadline = time.monotonic() + 5
    while time.monotonic() < deadline:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return
        time.sleep(0.02)
    pytest.fail("the sound server outlived its simulator")


def test_a_sound_server_that_does_not_start_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    need("pulse")
    # A command that is not there stands for any server that ends at once.
    monkeypatch.setattr(PulseSource, "_command", lambda self: ["no-such-server"])
    with pytest.raises(PolfuseError, match="does not start"):
        PulseSource(48_000.0, timeout_s=0.5)
