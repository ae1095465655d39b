"""The engine of set-up mode: holds the devices as long as a client is there, and leaves them safe."""

from __future__ import annotations

import signal
import threading
import time
from pathlib import Path
from typing import Any

from polfuse_lab.bench import protocol as bench
from polfuse_lab.bench.protocol import BenchClosed, BenchStatus
from polfuse_lab.bench.station import Bench, Station
from polfuse_lab.bench.stations import RadarStation, SwitchStation, TrolleyStation, TurnStation
from polfuse_lab.bench.viewing import CameraStation
from polfuse_lab.engine.guard import Guard
from polfuse_lab.engine.protocol import Prompt, Request, Watch
from polfuse_lab.engine.runs import announce
from polfuse_lab.engine.serving import ClientServer
from polfuse_lab.live.feed import LiveFeed
from polfuse_lab.rig import Rig, parse_model
from polfuse_lab.scheduler.control import Control
from polfuse_lab.scheduler.devices import ORDER, DeviceSet

QUIET_S = 2.0
"""What moves is stopped when no client has been heard for so long, s."""
GONE_S = 5.0
"""Set-up mode ends when no client has been heard for so long, s."""
NOBODY_S = 30.0
"""Or when none has ever come, s."""
TICK_S = 0.05

STATIONS: dict[str, type[Station]] = {
    "radar": RadarStation,
    "switches": SwitchStation,
    "trolley": TrolleyStation,
    "camera": CameraStation,
    "polarizer": TurnStation,
    "source_polarizer": TurnStation,
}


class BenchServer(ClientServer):
    """Serves the clients of set-up mode.

    Args:
        directory: the engine's private directory.
        request: what the engine was started for.
        shared: what the stations share.
        stations: the devices by their kind.
    """

    def __init__(self, directory: Path, request: Request, shared: Bench, stations: dict[str, Station]) -> None:
        super().__init__(directory, request)
        self._shared, self._stations = shared, stations
        self.closing: str | None = None
        """Why set-up mode is to end, once a client has said so."""

    def _decode(self, content: bytes) -> bench.BenchMessage:
        return bench.decode_client(content)

    def _obey(self, message: bench.BenchMessage) -> str | None:
        match message:
            case bench.Close():
                self.closing = "ended by the user"
            case bench.Stop():
                self.stop_all()
            case bench.Reply(ticket):
                if not self._shared.prompts.answer(ticket):
                    return f"prompt {ticket} is not open"
            case Watch():
                return None  # set-up mode is watched from its beginning
            case _:
                return self._command(message)
        return None

    def _command(self, message: Any) -> str | None:
        kinds: dict[type[Any], str] = {
            bench.MoveTo: "trolley",
            bench.Jog: "trolley",
            bench.Select: "switches",
            bench.SetExposure: "camera",
            bench.FindExposure: "camera",
            bench.RunCamera: "camera",
        }
        kind = kinds.get(type(message)) or message.kind
        station = self._stations.get(kind)
        match message, station:
            case _, None:
                return f"the rig has no {kind.replace('_', ' ')}"
            case bench.Retry(), Station():
                station.retry()
            case bench.MoveTo(x_m), TrolleyStation():
                station.move_to(x_m)
            case bench.Jog(by_m), TrolleyStation():
                station.jog(by_m)
            case bench.Select(channel), SwitchStation():
                station.select(channel)
            case bench.Turn(angle_deg), TurnStation():
                station.turn(angle_deg)
            case bench.SetExposure(exposure_s), CameraStation():
                station.expose(exposure_s)
            case bench.FindExposure(), CameraStation():
                station.find_exposure()
            case bench.RunCamera(running), CameraStation():
                station.run(running)
        return None

    def stop_all(self) -> None:
        """Stop everything that moves."""
        for station in self._stations.values():
            station.stop()

    def _states(self) -> dict[bytes, Any]:
        if not self._clients:
            return {}
        views: dict[str, Any] = {kind: getattr(item, "view", None) for kind, item in self._stations.items()}
        views.pop("radar", None)
        status = BenchStatus(
            devices=[self._stations[kind].light for kind in ORDER if kind in self._stations],
            prompts=[Prompt(ticket, text) for ticket, text in self._shared.prompts.open()],
            refused=self._shared.refused(),
            warnings=list(self._shared.feed.warnings),
            **views,
        )
        return dict.fromkeys(list(self._clients), status)


def run_bench(directory: Path, request: Request) -> None:
    """Hold the devices until nobody is there any more, then leave them safe."""
    rig = parse_model(request.rig_toml, Rig, request.rig_path)
    guard = Guard(request.rig_toml, request.rig_path, directory)
    feed = LiveFeed(request.rig_toml, request.rig_path, directory)
    feed.start()
    shared = Bench(rig, Path(request.rig_path), feed, lambda: server.changed())
    stations = {kind: STATIONS[kind](shared, kind) for kind in ORDER if rig.section(kind) is not None}
    polarizer, switches = stations.get("polarizer"), stations["switches"]
    if isinstance(polarizer, TurnStation):
        shared.camera_angle = polarizer.angle
    assert isinstance(switches, SwitchStation)
    shared.route = switches.route
    server = BenchServer(directory, request, shared, stations)
    told = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: told.set())
    server.start()
    announce(directory, request, server, rig, None)
    for station in stations.values():
        station.start()
    reason = _watch(server, stations, told)
    for station in stations.values():
        station.stop()
    unsafe = _secure(list(stations.values()))
    if not unsafe:
        guard.dismiss()
    # Else no goodbye: when this process has ended, the guard tries.
    ending = threading.Thread(target=feed.close, name="live end", daemon=True)
    ending.start()
    server.end(BenchClosed(reason, unsafe))
    ending.join(4.0)


def _watch(server: BenchServer, stations: dict[str, Station], told: threading.Event) -> str:
    """Wait until set-up mode is to end; why it is."""
    begun = time.monotonic()
    stopped = False
    while not told.wait(TICK_S):
        if server.closing is not None:
            return server.closing
        silence_s = server.silence_s
        if not server.met:
            if time.monotonic() - begun > NOBODY_S:
                return "nobody came"
            continue
        if silence_s is None or silence_s > GONE_S:
            return "the last client has gone"
        if silence_s <= QUIET_S:
            stopped = False
        elif not stopped and any(station.moving for station in stations.values()):
            stopped = True
            server.stop_all()
    return "stopped by the system (SIGTERM)"


def _secure(stations: list[Station]) -> list[str]:
    """Make everything safe and close it, at once and in bounded time; what did not confirm it."""
    for station in stations:
        station.halt()
    made = {station.kind: station.made for station in stations if station.made is not None}
    devices = DeviceSet(Control(), made)
    troubles = devices.make_safe()
    devices.close_all()
    return troubles
