"""The simulated audio port over loopback TCP, against the samples that were made."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from audio_rig import Rig, finish, position_in_cycle, take

from drivers.contracts import Radar
from drivers.errors import DeviceBadAnswer, DeviceLost, DeviceRefused, DeviceTimeout
from drivers.registry import driver_class
from hw_mocks.loopback import Address
from hw_mocks.scene_radar import SceneRadar


@pytest.fixture
def port(make_rig: Callable[..., Rig]) -> Iterator[tuple[Rig, SceneRadar]]:
    rig = make_rig()
    radar = SceneRadar(SceneRadar.Options(url=rig.stream.url))
    assert radar.open().driver == "scene"
    yield rig, radar
    radar.close()


def test_it_is_the_registered_radar() -> None:
    assert driver_class("radar", "scene") is SceneRadar
    assert isinstance(SceneRadar(SceneRadar.Options(url="tcp://127.0.0.1:1?token=a")), Radar)


def test_records_are_the_simulated_samples_and_begin_after_begin(port: tuple[Rig, SceneRadar]) -> None:
    rig, radar = port
    cycle = rig.synthesizer.block(0, 3841, time.monotonic_ns())
    for _ in range(3):
        before_ns = time.monotonic_ns()
        block = take(radar, 5800)
        assert block.samples.dtype == np.int16
        assert position_in_cycle(block.samples, cycle) >= 0
        # One sample at 48 kHz is 20.8 us.
        assert before_ns <= block.t_host_ns < before_ns + 1_000_000
        assert block.lost_frames == 0
        assert block.t_device_s == pytest.approx(block.first_frame / 48_000)
    assert radar.level().peak[1] == pytest.approx(0.7, abs=0.005)
    fix = radar.clock()
    assert fix is not None
    assert abs(fix.t_host_ns - time.monotonic_ns()) < 10**9


def test_no_sample_of_a_record_is_older_than_the_change_before_it(port: tuple[Rig, SceneRadar]) -> None:
    rig, radar = port
    for number in range(6):
        route = "HV"[number % 2]
        rig.world.receive.set(route)
        block = take(radar, 4000)
        assert position_in_cycle(block.samples, rig.synthesizer.block(0, 3841, time.monotonic_ns())) >= 0


def test_gaps_are_counted(port: tuple[Rig, SceneRadar]) -> None:
    rig, radar = port
    radar.begin(24_000)
    time.sleep(0.1)
    rig.card.skip(1234)
    block = finish(radar)
    assert (block.lost_frames, radar.lost_frames, len(block.samples)) == (1234, 1234, 24_000)


def test_a_dead_simulator_is_noticed_at_once(port: tuple[Rig, SceneRadar]) -> None:
    rig, radar = port
    radar.begin(480_000)
    rig.card.close()
    before = time.monotonic()
    with pytest.raises(DeviceLost, match="gone"):
        finish(radar)
    assert time.monotonic() - before < 1


def test_a_silent_simulator_is_a_timeout(make_rig: Callable[..., Rig]) -> None:
    rig = make_rig()
    radar = SceneRadar(SceneRadar.Options(url=rig.stream.url, timeout_s=0.2))
    radar.open()
    radar.begin(48_000)
    rig.card.skip(10**9)
    with pytest.raises(DeviceTimeout, match="no sample"):
        finish(radar)
    radar.close()


def test_wrong_rate_token_host_and_server_are_refused(make_rig: Callable[..., Rig]) -> None:
    rig = make_rig()
    with pytest.raises(DeviceRefused, match="48000"):
        SceneRadar(SceneRadar.Options(url=rig.stream.url, sample_rate_hz=96_000.0)).open()
    wrong = Address(rig.stream.address.port, "0" * 32)
    with pytest.raises(DeviceLost, match="hung up"):
        SceneRadar(SceneRadar.Options(url=wrong.url)).open()
    for url in ("tcp://192.0.2.1:5?token=a", "http://127.0.0.1:5?token=a", "tcp://127.0.0.1?token=a", "tcp://[::1", ""):
        with pytest.raises(DeviceRefused, match="no address"):
            SceneRadar(SceneRadar.Options(url=url))
    with pytest.raises(ValueError, match="sample_rate_hz"):
        SceneRadar(SceneRadar.Options(url=rig.stream.url, sample_rate_hz=float("nan")))
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = Address(server.getsockname()[1], "a")

        def babble() -> None:
            connection, _ = server.accept()
            with connection:
                connection.sendall(b"220 hello\n")
                connection.recv(100)

        thread = threading.Thread(target=babble)
        thread.start()
        with pytest.raises(DeviceBadAnswer, match="something else"):
            SceneRadar(SceneRadar.Options(url=address.url)).open()
        thread.join()


def test_life_cycle_and_misuse(port: tuple[Rig, SceneRadar]) -> None:
    _, radar = port
    with pytest.raises(DeviceRefused, match="open already"):
        radar.open()
    with pytest.raises(DeviceRefused, match="0 frames"):
        radar.begin(0)
    radar.begin(10**7)
    with pytest.raises(DeviceRefused, match="under way"):
        radar.begin(1)
    radar.make_safe()
    assert radar.poll() is None
    assert len(take(radar, 100).samples) == 100
    radar.close()
    radar.close()
    with pytest.raises(DeviceLost, match="not open"):
        radar.begin(1)
    radar.open()
    assert len(take(radar, 100).samples) == 100
