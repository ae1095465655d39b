"""Times of records on one clock, for each device and for pairs of them."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from session_records import clock, config, exposure, sweeps

from drivers.records import ClockFix, TrolleyFix
from polfuse_lab.errors import PolfuseError
from polfuse_lab.session import SessionWriter, info, open_session

START_NS = 5_000_000_000
DRIFT = {"radar": 40e-6, "camera": -120e-6}
BEGAN_S = {"radar": 3.0, "camera": 900.0}


def reading(device: str, t_s: float) -> float:
    """The device's clock ``t_s`` after the start."""
    return BEGAN_S[device] + t_s * (1 + DRIFT[device])


def host_ns(t_s: float) -> int:
    return START_NS + round(t_s * 1e9)


def session_with_clocks(path, *, late_s=0.03, camera_jump_at=None):
    """A record of each device every half second for 60 s; stamps of frames are ``late_s`` late, but for some jitter."""
    random = np.random.default_rng(1)

    def camera(t):
        return reading("camera", t) + (0.05 if camera_jump_at is not None and t > camera_jump_at else 0.0)

    with SessionWriter.create(path, config()) as writer:
        for number in range(120):
            t = 0.5 * number
            sweep = sweeps(number)
            block = dataclasses.replace(sweep.block, t_device_s=reading("radar", t), t_host_ns=host_ns(t) + 7_000_000)
            writer.write(dataclasses.replace(sweep, block=block))
            shot = exposure(number)
            stamped = host_ns(t + 0.1 + late_s + random.exponential(0.002))
            frame = dataclasses.replace(shot.frame, t_device_s=camera(t + 0.1), t_host_ns=stamped)
            writer.write(dataclasses.replace(shot, frame=frame))
            writer.write(TrolleyFix(0.0, 0.001, False, host_ns(t), "Idle"))
            if number % 10 == 0:
                for device, at in (("radar", reading("radar", t + 0.2)), ("camera", camera(t + 0.2))):
                    writer.write(ClockFix(device, at, host_ns(t + 0.2), 100_000))
    return path


def test_times_come_from_the_clocks_not_from_late_stamps(path):
    with open_session(session_with_clocks(path)) as session:
        truth = np.array([host_ns(0.5 * number) for number in range(120)])
        radar, camera = session.sync.device("radar"), session.sync.device("camera")
        # The pairs are exact; what is stated is the round trip of 100 us: half of it, uniform, is 29 us.
        assert np.abs(radar.host_ns - truth).max() < 2_000
        assert np.abs(camera.host_ns - truth - 100_000_000).max() < 2_000
        assert 25e-6 < radar.rms_s < 60e-6
        assert radar.clock is not None
        # Host seconds for a second of the device: 1 / (1 + 40e-6).
        assert radar.clock.drift_ppm == pytest.approx(-40, abs=0.1)
        pair = session.sync.pair("radar", "camera")
        assert pair.nearest(7) == 7
        seconds, sd = pair.between(7, 7)
        assert seconds == pytest.approx(0.1, abs=2e-6)
        assert sd == pytest.approx(np.hypot(radar.sd_s[7], camera.sd_s[7]))
        assert pair.rms_s == pytest.approx(np.hypot(radar.rms_s, camera.rms_s))
        # The trolley is stamped by the host; what its answer took is in its own uncertainty.
        assert session.sync.pair("radar", "trolley").rms_s == pytest.approx(radar.rms_s)
        assert session.sync.devices == ("radar", "camera", "trolley")


def test_a_jump_of_the_cameras_clock_parts_its_frames_rightly(path):
    # Stamps are 30 ms late, more than half of the jump: only their usual lateness tells on which side a frame lies.
    with open_session(session_with_clocks(path, camera_jump_at=27.3)) as session:
        camera = session.sync.device("camera")
        assert camera.clock is not None
        assert camera.clock.jumps_s == pytest.approx((0.05,), abs=1e-5)
        truth = np.array([host_ns(0.5 * number + 0.1) for number in range(120)])
        assert np.abs(camera.host_ns - truth).max() < 5_000
        assert camera.rms_s < 1e-4


def test_stamps_of_another_clock_are_not_believed(path):
    # Records whose own stamps have nothing to do with the pairs keep the host's; how good that is, is not known.
    with SessionWriter.create(path, config()) as writer:
        writer.write(sweeps(3))
        for number in range(6):
            writer.write(ClockFix("radar", 1000.0 + number, 10**9 * number, 1000))
    with open_session(path) as session:
        radar = session.sync.device("radar")
        assert radar.host_ns.tolist() == session.sweeps["t_host_ns"].tolist()
        assert np.isnan(radar.sd_s).all()
        assert radar.rms_s is None


def test_without_clocks_times_are_the_stamps(path):
    with SessionWriter.create(path, config()) as writer:
        for number in range(3):
            writer.write(sweeps(number))
    with open_session(path) as session:
        radar = session.sync.device("radar")
        assert radar.clock is None
        assert radar.rms_s is None
        assert radar.host_ns.tolist() == [0, 100_000_000, 200_000_000]
        assert session.sync.pair("radar", "camera").rms_s is None
        with pytest.raises(IndexError, match="no record"):
            session.sync.pair("radar", "camera").nearest(0)
        with pytest.raises(PolfuseError, match="there is no device 'laser'"):
            session.sync.device("laser")
        with pytest.raises(PolfuseError, match="are the same device"):
            session.sync.pair("radar", "radar")


def test_info_tells_devices_and_pairs(path):
    found = info(session_with_clocks(path, camera_jump_at=27.3))
    json.dumps(found)
    assert set(found["sync"]["devices"]) == {"radar", "camera", "trolley"}
    assert found["sync"]["devices"]["camera"]["jumps_s"] == pytest.approx([0.05], abs=1e-5)
    assert found["sync"]["devices"]["radar"]["pairs"] == 12
    assert set(found["sync"]["pairs"]) == {"radar-camera", "radar-trolley", "camera-trolley"}
    assert found["clock_drift_ppm"]["camera"] == pytest.approx(120, abs=0.2)
    # A clock that was set in the middle is worth a sentence.
    assert any("camera's clock jumped by +50.0 ms" in problem for problem in found["problems"])


def test_refresh_fits_again(path):
    writer = SessionWriter.create(path, config())
    writer.write(sweeps(0))
    writer.write(clock(0))
    writer.flush()
    with open_session(writer.partial) as session:
        assert session.sync.clocks["radar"].pairs == 1
        for number in range(1, 5):
            writer.write(clock(number))
        writer.flush()
        session.refresh()
        assert session.sync.clocks["radar"].pairs == 5
    writer.close()
