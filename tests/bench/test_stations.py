"""Each device by itself in set-up mode: what fails is said and mended, the others go on; nothing goes too far."""

from __future__ import annotations

import math
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import DeviceLost, DeviceRefused, DeviceTimeout
from drivers.records import (
    AudioBlock,
    Channel,
    Frame,
    Identity,
    Level,
    PolarizerFix,
    SwitchState,
    TrolleyFix,
)
from polfuse_lab.bench import engine as bench_engine
from polfuse_lab.bench import station as stations_module
from polfuse_lab.bench.engine import GONE_S, QUIET_S, BenchServer, _secure, _watch
from polfuse_lab.bench.protocol import (
    BenchStatus,
    Jog,
    MoveTo,
    RunCamera,
    Select,
    SetExposure,
    Stop,
    Turn,
    decode_client,
    decode_engine,
)
from polfuse_lab.bench.station import Bench
from polfuse_lab.bench.stations import RadarStation, SwitchStation, TrolleyStation, TurnStation
from polfuse_lab.bench.viewing import CameraStation
from polfuse_lab.engine import protocol
from polfuse_lab.records import Exposure, FrameFlag
from polfuse_lab.rig import Rig, parse_model
from polfuse_lab.scheduler.devices import Device
from polfuse_lab.scheduler.lane import Lane

pytestmark = pytest.mark.realtime

RIG = parse_model(
    """
[waveform]
centre_hz = 2.4e9
bandwidth_hz = 80e6
ramp_up_s = 0.02
sweep_period_s = 0.04
[geometry]
antenna_height_m = 1.069
[radar]
driver = "scene"
[switches]
driver = "dowkey_ms"
[trolley]
driver = "grbl"
length_m = 3.2
[camera]
driver = "scene"
width_px = 16
height_px = 12
exposure_s = 0.001
focal_length_m = 0.008
pixel_pitch_m = 8e-6
saturation_counts = 4095
[polarizer]
driver = "ell14"
""",
    Rig,
    "rig.toml",
)


class Fake:
    """What all fake devices do; ``fails`` is raised by the next call of that name, ``calls`` are remembered."""

    kind = "switches"

    def __init__(self):
        self.fails: dict[str, Exception] = {}
        self.calls: list[str] = []

    def did(self, name):
        self.calls.append(name)
        if name in self.fails:
            raise self.fails.pop(name)

    def open(self):
        self.did("open")
        return Identity(self.kind, "fake", f"fake {self.kind}")

    def make_safe(self):
        self.did("make_safe")

    def close(self):
        self.did("close")


class Switches(Fake):
    route = "HH"

    def state(self):
        self.did("state")
        return SwitchState(self.route[0], self.route[1], True, 1)

    def select(self, channel: Channel):
        self.did("select")
        self.route = channel.name
        return self.state()


class Trolley(Fake):
    kind = "trolley"
    limits_m = (-1.6, 1.6)
    x_m = target_m = 0.0
    step_m = 0.05

    def start_move(self, x_m, speed_m_s=None):
        self.did(f"start_move {x_m:.3f}")
        self.target_m = x_m

    def poll(self):
        self.did("poll")
        away = self.target_m - self.x_m
        self.x_m += math.copysign(min(abs(away), self.step_m), away)
        return TrolleyFix(self.x_m, 0.001, self.x_m != self.target_m, time.monotonic_ns())

    def stop(self):
        self.did("stop")
        self.target_m = self.x_m


class Polarizer(Fake):
    kind = "polarizer"
    angle_rad = 0.0

    def start_turn(self, angle_rad):
        self.did("start_turn")
        self.angle_rad = angle_rad

    def poll(self):
        self.did("poll")
        return PolarizerFix(self.angle_rad, 0.001, False, 1)

    def stop(self):
        self.did("stop")


class Camera(Fake):
    kind = "camera"
    shape = (12, 16)
    lost_frames = 0
    brightness = 5000.0
    exposure_s = 0.001
    asked = False

    def trigger(self):
        self.did("trigger")
        self.asked = True

    def poll(self):
        if not self.asked:
            return None
        self.asked = False
        counts = min(round(1e6 * self.exposure_s * self.brightness / 5000.0), 4095)
        return Frame(np.full(self.shape, counts, np.uint16), 1, self.exposure_s, 0.0, 0.0, time.monotonic_ns())

    def clock(self):
        return None

    def exposure_limits(self):
        return 1e-5, 0.1

    def set_exposure(self, seconds):
        self.did("set_exposure")
        self.exposure_s = seconds
        return seconds


class Radar(Fake):
    """Cannot be overheard: what it is asked for is delivered at once."""

    kind = "radar"
    sample_rate_hz = 48_000.0
    lost_frames = 0
    silent = False
    frames = 0

    def begin(self, frames):
        self.did("begin")
        self.frames = frames

    def poll(self):
        t = np.arange(self.frames) / 48_000.0
        samples = np.zeros((self.frames, 2))
        samples[:, 0] = 0.1 * np.sin(2 * np.pi * 1000 * t)
        samples[:, 1] = np.where(t % 0.04 < 0.02, 0.5, -0.5)
        samples *= not self.silent
        return AudioBlock(np.round(samples * 32767).astype(np.int16), 48_000.0, 0, 0.0, 1)

    def cancel(self):
        pass

    def level(self):
        return Level()

    def clock(self):
        return None


class Feed:
    """Takes what the live view would get."""

    def __init__(self):
        self.records = []
        self.heard: list[object] = []
        self.warnings: tuple[str, ...] = ()

    def offer(self, record):
        self.records.append(record)

    def overhear(self, radar):
        self.heard.append(radar)


@pytest.fixture
def shared(monkeypatch):
    """Stations whose devices are fakes: ``shared.fakes[kind]``."""
    made = Bench(RIG, Path("rig.toml"), Feed(), lambda: None)
    made.fakes = {
        "switches": Switches(), "trolley": Trolley(), "polarizer": Polarizer(), "camera": Camera(), "radar": Radar(),
    }  # fmt: skip

    def make(rig, kind, path, operator):
        return Device(kind, "fake", made.fakes[kind], Lane(kind), False)

    monkeypatch.setattr(stations_module, "make_device", make)
    made.stations = []
    yield made
    _secure(made.stations)
    assert not [t for t in threading.enumerate() if t.name.startswith(("bench ", "device "))]


def begin(shared, station_class, kind):
    station = station_class(shared, kind)
    shared.stations.append(station)
    station.start()
    return station


def until(condition, seconds=20.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


def test_a_device_that_fails_is_bad_in_words_and_good_after_a_retry(shared):
    shared.fakes["switches"].fails["open"] = DeviceLost("nobody answers", where="switches", advice="plug it in")
    switches, trolley = begin(shared, SwitchStation, "switches"), begin(shared, TrolleyStation, "trolley")
    until(lambda: switches.light.light == "bad" and trolley.light.light == "ok")
    assert switches.light.what == "nobody answers"
    assert switches.light.mend == "plug it in"
    assert switches.view is None
    switches.retry()
    until(lambda: switches.light.light == "ok")
    until(lambda: switches.view is not None)
    assert switches.light.identity == "fake switches"
    assert switches.view.channel == "HH"


def test_a_driver_with_a_defect_is_bad_and_the_others_go_on(shared):
    shared.fakes["switches"].fails["open"] = RuntimeError("surprise")
    switches, trolley = begin(shared, SwitchStation, "switches"), begin(shared, TrolleyStation, "trolley")
    until(lambda: switches.light.light == "bad" and trolley.light.light == "ok")
    assert "surprise" in switches.light.what


def test_a_device_that_goes_away_turns_bad_and_is_closed(shared):
    trolley = begin(shared, TrolleyStation, "trolley")
    until(lambda: trolley.view is not None)
    shared.fakes["trolley"].fails["poll"] = DeviceLost("unplugged", where="trolley", advice="plug it in again")
    until(lambda: trolley.light.light == "bad")
    assert trolley.light.mend == "plug it in again"
    until(lambda: trolley.view is None and "close" in shared.fakes["trolley"].calls)
    trolley.move_to(0.1)
    until(lambda: trolley._commands.empty())
    until(lambda: (told := shared.refused()) and "not open" in told[0])
    trolley.retry()
    until(lambda: trolley.light.light == "ok" and trolley.view is not None)


def test_one_question_that_fails_is_not_the_end(shared):
    trolley = begin(shared, TrolleyStation, "trolley")
    until(lambda: trolley.view is not None)
    shared.fakes["trolley"].fails["poll"] = DeviceTimeout("did not answer", where="trolley", advice="wait")
    until(lambda: trolley.light.light == "bad")
    until(lambda: trolley.light.light == "ok")
    assert "close" not in shared.fakes["trolley"].calls


def test_the_trolley_stays_on_its_rail(shared):
    trolley = begin(shared, TrolleyStation, "trolley")
    until(lambda: trolley.view is not None)
    for beyond in (1.7, -1.7, math.nan, math.inf):
        trolley.move_to(beyond)
    refused: list[str] = []
    until(lambda: refused.extend(shared.refused()) or len(refused) == 4)
    assert all("beyond the rail (-1.6 to 1.6 m)" in told for told in refused)
    assert not [call for call in shared.fakes["trolley"].calls if call.startswith("start_move")]
    # A jog ends at the rail's end.
    trolley.jog(50.0)
    until(lambda: "start_move 1.600" in shared.fakes["trolley"].calls)
    until(lambda: trolley.view.x_m == pytest.approx(1.6) and not trolley.moving)
    trolley.jog(-0.2)
    until(lambda: trolley.view.x_m == pytest.approx(1.4) and not trolley.moving)


def test_jogs_add_up_and_stop_forgets_them(shared):
    shared.fakes["trolley"].step_m = 0.001
    trolley = begin(shared, TrolleyStation, "trolley")
    until(lambda: trolley.view is not None)
    trolley.jog(0.5)
    until(lambda: trolley.moving)
    trolley.jog(0.25)  # from where it is going to
    until(lambda: "start_move 0.750" in shared.fakes["trolley"].calls)
    begun = time.monotonic()
    for _ in range(5):
        trolley.jog(0.1)
    trolley.stop()
    until(lambda: not trolley.moving)
    until(lambda: shared.fakes["trolley"].target_m == shared.fakes["trolley"].x_m)
    assert time.monotonic() - begun < 5.0
    assert shared.fakes["trolley"].x_m < 0.5


def test_channels_and_angles_are_set_and_told_to_the_live_view(shared):
    switches, polarizer = begin(shared, SwitchStation, "switches"), begin(shared, TurnStation, "polarizer")
    until(lambda: switches.view is not None and polarizer.view is not None)
    switches.select("VH")
    polarizer.turn(45.0)
    until(lambda: switches.view.channel == "VH")
    until(lambda: polarizer.view.angle_deg == pytest.approx(45.0))
    assert switches.route() is Channel.VH
    assert polarizer.angle()[0] == pytest.approx(math.pi / 4)
    routes = [record for record in shared.feed.records if isinstance(record, SwitchState)]
    assert routes[-1].transmit + routes[-1].receive == "VH"
    polarizer.turn(math.nan)
    until(lambda: (told := shared.refused()) and "no angle" in told[0])


def test_the_camera_runs_and_its_exposure_is_bounded_and_found(shared):
    shared.camera_angle = lambda: (0.5, 0.01, False)
    camera = begin(shared, CameraStation, "camera")
    until(lambda: camera.view is not None and camera.view.frames > 3)
    frames = [record for record in shared.feed.records if isinstance(record, Exposure)]
    assert frames[-1].angle_rad == 0.5
    assert frames[-1].flags is FrameFlag.NONE
    camera.expose(0.05)
    until(lambda: camera.view.exposure_s == 0.05)
    until(lambda: camera.view.saturated_fraction == 1.0)
    camera.expose(5.0)
    until(lambda: (told := shared.refused()) and "outside" in told[0])
    camera.find_exposure()
    until(lambda: camera.view.exposure_s < 0.05 and not camera.view.searching)
    # 1e6 counts a second, 4095 at most: three quarters of that (see drivers.camera.auto_exposure).
    until(lambda: camera.view.saturated_fraction == 0.0)
    assert camera.view.exposure_s == pytest.approx(0.75 * 4095e-6, rel=0.25)
    camera.run(False)
    until(lambda: not camera.view.running)
    time.sleep(0.15)
    count = camera.view.frames
    time.sleep(0.15)
    assert camera.view.frames == count


def test_frames_while_the_polarizer_turns_are_marked(shared):
    shared.camera_angle = lambda: (0.5, 0.01, True)
    begin(shared, CameraStation, "camera")
    until(lambda: [record for record in shared.feed.records if isinstance(record, Exposure)])
    assert shared.feed.records[-1].flags is FrameFlag.MOVED


def test_the_radar_is_judged_by_the_doctor(shared):
    radar = begin(shared, RadarStation, "radar")
    until(lambda: "sync found" in radar.light.what)
    assert radar.light.light == "ok"
    shared.fakes["radar"].silent = True
    until(lambda: radar.light.light == "bad")
    assert "silent" in radar.light.what
    assert "cable" in radar.light.mend
    shared.fakes["radar"].silent = False
    until(lambda: radar.light.light == "ok")
    assert shared.feed.heard  # the live view was offered the radar


def test_all_is_made_safe_and_closed_at_the_end(shared):
    kinds = {"switches": SwitchStation, "trolley": TrolleyStation, "camera": CameraStation}
    begun = [begin(shared, station, kind) for kind, station in kinds.items()]
    until(lambda: all(station.light.light == "ok" for station in begun))
    assert _secure(begun) == []
    shared.stations.clear()
    for kind in kinds:
        calls = shared.fakes[kind].calls
        assert "make_safe" in calls
        assert calls[-1] == "close"
        assert calls.index("make_safe") < calls.index("close")


class Server:
    """The clients of :func:`_watch`."""

    closing = None
    met = True

    def __init__(self, silences):
        self.silences = iter(silences)
        self.stops = 0

    @property
    def silence_s(self):
        return next(self.silences)

    def stop_all(self):
        self.stops += 1


class Moving:
    moving = True


@pytest.mark.parametrize(
    ("silences", "reason", "stops"),
    [
        ([0.1, None], "the last client has gone", 0),
        ([0.1, QUIET_S + 0.1, QUIET_S + 0.2, 0.1, QUIET_S + 1, GONE_S + 0.1], "the last client has gone", 2),
        ([GONE_S + 1], "the last client has gone", 0),
    ],
)
def test_what_moves_is_stopped_before_set_up_mode_ends(monkeypatch, silences, reason, stops):
    monkeypatch.setattr(bench_engine, "TICK_S", 0.0)
    server = Server(silences)
    assert _watch(server, {"trolley": Moving()}, threading.Event()) == reason
    assert server.stops == stops


def test_messages_cross_the_wire_and_rubbish_is_refused():
    messages = [Jog(0.1), MoveTo(1.0), Stop(), Select("HV"), Turn(30.0), SetExposure(0.1), RunCamera(False)]
    for message in messages:
        assert decode_client(protocol.encode(message)) == message
    status = BenchStatus(devices=[])
    assert decode_engine(protocol.encode(status)) == status
    import msgspec

    for rubbish in (b"", b"\xc1", b"\x81", protocol.encode({"type": "Jog"}), protocol.encode(protocol.Pause())):
        with pytest.raises(msgspec.MsgspecError):
            decode_client(rubbish)


def test_what_the_rig_has_not_is_refused(shared, tmp_path):
    request = protocol.Request("r", "", "", "", "", "token", "ipc", mode="bench")
    server = BenchServer(tmp_path, request, shared, {})
    try:
        assert server._obey(Turn(10.0, "source_polarizer")) == "the rig has no source polarizer"
        assert server._obey(MoveTo(0.0)) == "the rig has no trolley"
        assert server._obey(Stop()) is None
    finally:
        server._socket.close()
        server._context.term()


def test_refusals_are_told_once(shared):
    shared.refuse("one")
    shared.refuse("two")
    assert shared.refused() == ["one", "two"]
    assert shared.refused() == []
    with pytest.raises(DeviceRefused):
        SwitchStation(shared, "switches").call(print)
