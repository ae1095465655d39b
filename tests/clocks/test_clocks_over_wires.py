"""Clocks of simulated devices over their wires, whose truth is known: a camera's latch, a card behind PulseAudio."""

from __future__ import annotations

import struct
import time
from collections.abc import Iterator

import numpy as np
import pytest
from audio.audio_rig import need, take
from audio.counter_source import CounterSource, numbers_of
from gige.gige_client import Client

from drivers.radar.sound_port import SoundPort
from drivers.records import ClockFix
from hw_mocks.faults import FaultKind, FaultScript
from hw_mocks.gige_camera import GigeCamera, Pattern, Settings
from hw_mocks.sound_card import PulseSource, SoundCard
from hw_mocks.world import World
from polfuse_lab.clocks import DeviceClock, fit_clock

pytestmark = pytest.mark.realtime

TICK_HZ = 125e6
CONTROL, TIMESTAMP_CONTROL, TIMESTAMP_HIGH, LATCH = 0x0A00, 0x0944, 0x0948, 2
"""Bootstrap registers of GigE Vision: who controls, the time stamp's control and value, and the bit that latches it."""


def fitted(fixes: list[ClockFix]) -> DeviceClock:
    clock = fit_clock(
        fixes[0].device,
        np.array([fix.t_device_s for fix in fixes]),
        np.array([fix.t_host_ns for fix in fixes]),
        np.array([fix.round_trip_ns for fix in fixes]),
    )
    assert clock is not None
    return clock


@pytest.fixture
def faults() -> FaultScript:
    return FaultScript()


@pytest.fixture
def camera(faults: FaultScript) -> Iterator[GigeCamera]:
    settings = Settings(frame_rate_hz=100.0, exposure_s=0.001, drift_ppm=200.0)
    with GigeCamera(Pattern(64, 96), World(), port=0, settings=settings, faults=faults) as made:
        yield made
        made.check()


def latch(client: Client) -> ClockFix:
    """One pair of readings, as the driver takes it: the latch between two looks at the host's clock."""
    before = time.monotonic_ns()
    assert client.write(TIMESTAMP_CONTROL, LATCH) == 0
    after = time.monotonic_ns()
    high, low = struct.unpack(">II", client.read_memory(TIMESTAMP_HIGH, 8))
    return ClockFix("camera", (high << 32 | low) / TICK_HZ, (before + after) // 2, after - before)


def test_the_cameras_latch_tells_its_time(camera: GigeCamera) -> None:
    with Client(camera) as client:
        assert client.write(CONTROL, 2) == 0  # without which nothing may be latched
        fixes = []
        for _ in range(30):
            fixes.append(latch(client))
            time.sleep(0.1)
    clock = fitted(fixes)
    # Truth: the mock's ticks at any host time; rounding to ticks of 8 ns.
    times = np.linspace(fixes[0].t_host_ns, fixes[-1].t_host_ns, 50).astype(np.int64)
    reading = np.array([camera.clock.ticks(int(t)) for t in times]) / TICK_HZ
    errors = (clock.host_ns(reading) - times) * 1e-9
    assert np.sqrt(np.mean(errors**2)) < 0.5e-3
    # All places on one line are one draw, so that four standard deviations are asked for; how many of many lines are
    # within two is what the benchmark of clocks counts.
    assert (np.abs(errors) <= 4 * clock.sd_s(reading) + 1e-8).all()
    # The camera runs 200 ppm fast: the host's seconds are shorter by as much.
    assert clock.drift_ppm == pytest.approx(-200, abs=max(4 * clock.drift_sd_ppm, 1))


def test_a_jump_of_the_cameras_clock_is_found(camera: GigeCamera, faults: FaultScript) -> None:
    with Client(camera) as client:
        assert client.write(CONTROL, 2) == 0
        fixes = []
        for number in range(24):
            if number == 12:
                faults.start(FaultKind.CLOCK_JUMP, amount=0.05)
            fixes.append(latch(client))
            time.sleep(0.05)
    clock = fitted(fixes)
    assert [piece.pairs for piece in clock.pieces] == [12, 12]
    assert clock.jumps_s == pytest.approx((0.05,), abs=0.5e-3)


class WatchedSource(CounterSource):
    """Remembers when which sample was taken."""

    def block(self, first: int, frames: int, t_ns: int):  # type: ignore[no-untyped-def]
        self.instants.append((first, t_ns))
        return super().block(first, frames, t_ns)

    instants: list[tuple[int, int]]


@pytest.mark.audio
def test_the_sound_cards_samples_are_placed_in_time() -> None:
    need("pulse")
    source = WatchedSource(48_000.0, clock_drift_ppm=200.0)
    source.instants = []
    pulse = PulseSource(48_000.0)
    card = SoundCard(source, [pulse])
    card.start()
    radar = SoundPort(
        SoundPort.Options(device=pulse.device, environment=pulse.environment, latency_s=0.02, guard_s=0.2)
    )
    try:
        radar.open()
        fixes, blocks = [], []
        for _ in range(7):
            blocks.append(take(radar, 24_000))
            time.sleep(0.5)
            fix = radar.clock()
            if fix is not None and (not fixes or fix != fixes[-1]):
                fixes.append(fix)
    finally:
        radar.close()
        card.close()
    clock = fitted(fixes[1:])  # the first one still belongs to the start
    device_s = np.array([block.t_device_s for block in blocks])
    told = clock.host_ns(device_s, near_ns=[block.t_host_ns for block in blocks])
    numbers = np.array([int(numbers_of(block.samples[:1])[0]) for block in blocks])
    first, t_ns = np.array(source.instants).T
    truth = t_ns[0] + np.round((numbers - first[0]) / source.audio.true_rate_hz * 1e9).astype(np.int64)
    late = (told - truth) * 1e-9
    # What the sound server delays no clock can tell, but it is always the same; the uncertainty has room for it.
    assert np.std(late) < 0.5e-3
    assert (np.abs(late) <= 2 * clock.sd_s(device_s)).all()
    assert clock.drift_ppm == pytest.approx(-200, abs=4 * clock.drift_sd_ppm)
