"""What an engine's process carries out: a collect, or a session that is played."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from polfuse_lab.engine import protocol
from polfuse_lab.engine.claims import claims
from polfuse_lab.engine.directory import ADDRESS
from polfuse_lab.engine.guard import Guard
from polfuse_lab.engine.recorder import WriterProcess
from polfuse_lab.engine.server import Server
from polfuse_lab.engine.serving import ClientServer
from polfuse_lab.live import LivePipeline
from polfuse_lab.live.feed import LiveFeed, Viewers
from polfuse_lab.plans import Plan, parse_plan
from polfuse_lab.plans.custom import recorded_plan
from polfuse_lab.plans.step_json import steps_from_json
from polfuse_lab.rig import Rig, parse_model
from polfuse_lab.scheduler import Control, Outcome, RunStatus, Scheduler
from polfuse_lab.scheduler.devices import DeviceSet, make_devices
from polfuse_lab.scheduler.prompts import Prompts
from polfuse_lab.session.layout import CONTINUES

REPLAY_DRAIN_S = 20.0
FEED_END_S = 4.0
"""Longest that the live process's end is waited for once the outcome has been told, s."""


def announce(directory: Path, request: protocol.Request, server: ClientServer, rig: Rig, plan: Plan | None) -> None:
    """Write where the engine listens, and what it does."""
    address = protocol.Address(
        server.endpoint,
        os.getpid(),
        request.output,
        mode=request.mode,
        rig_name=rig.name,
        rig_path=request.rig_path,
        plan_name="" if plan is None else plan.name,
        since_unix_s=time.time(),
        # A session that is played holds none.
        devices=[] if request.mode == "replay" else claims(rig),
    )
    unfinished = directory / f"{ADDRESS}.new"
    unfinished.write_bytes(msgspec.json.encode(address))
    unfinished.replace(directory / ADDRESS)


def run_collect(directory: Path, request: protocol.Request) -> None:
    """Carry out a plan."""
    rig = parse_model(request.rig_toml, Rig, request.rig_path)
    plan = parse_plan(request.plan_toml, request.plan_path)
    guard = Guard(request.rig_toml, request.rig_path, directory)
    live = LivePipeline(rig)
    feed = LiveFeed(request.rig_toml, request.rig_path, directory, request.plan_toml, request.plan_path)
    origin: dict[str, object] = {}
    if request.rest is not None:
        plan = recorded_plan(plan, steps_from_json(request.rest.steps_json))
        origin = {CONTINUES: request.rest.origin}
    recorder = WriterProcess(Path(request.output), origin)

    def overheard(rig: Rig, path: Path, operator: Prompts, control: Control, kinds: Sequence[str]) -> DeviceSet:
        made = make_devices(rig, path, operator, control, kinds)
        if "radar" in made:
            feed.overhear(made.radar)
        return made

    scheduler = Scheduler(
        rig,
        plan,
        Path(request.output),
        recorder,
        rig_path=Path(request.rig_path),
        rig_toml=request.rig_toml,
        plan_toml=request.plan_toml,
        viewer=Viewers(live, feed),
        on_change=lambda: server.changed(),
        devices=overheard,
    )
    server = Server(directory, request, scheduler, live, on_watch=feed.start)
    signal.signal(signal.SIGTERM, lambda *_: scheduler.control.abort("stopped by the system (SIGTERM)"))
    server.start()
    announce(directory, request, server, rig, plan)
    outcome = scheduler.run()
    if not scheduler.unsafe:
        guard.dismiss()
    # Else no goodbye: when this process, and with it every call that hangs in a driver, has ended, the guard tries.
    live.close()
    _end(server, feed, outcome)


def _end(server: Server, feed: LiveFeed, outcome: Outcome) -> None:
    """Tell the outcome; the live process shows its last pictures meanwhile."""
    ending = threading.Thread(target=feed.close, name="live end", daemon=True)
    ending.start()
    server.finish(outcome)
    ending.join(FEED_END_S)


class _Played:
    """A session that is played, as something that clients steer."""

    def __init__(self, player: Any) -> None:
        self._player = player
        self.control: Control = _PlayedControl(player)
        self.prompts = Prompts()  # the recording answers its own

    def status(self) -> RunStatus:
        """As in a collect."""
        status: RunStatus = self._player.status()
        return status

    def note(self, text: str) -> bool:
        """A recording takes no notes."""
        return False


class _PlayedControl(Control):
    """Pause and resume are the player's: the recording has pauses of its own."""

    def __init__(self, player: Any) -> None:
        super().__init__()
        self._player = player

    def abort(self, reason: str = "replay stopped by the user") -> None:
        """Stop playing."""
        self._player.clock.resume()
        self._player.abort(reason)

    def pause(self) -> None:
        """Stand still."""
        self._player.clock.pause()

    def resume(self) -> None:
        """Go on."""
        self._player.clock.resume()


def run_replay(directory: Path, request: protocol.Request) -> None:
    """Play a session, for whoever watches."""
    from polfuse_lab.replay.player import Player

    rig = parse_model(request.rig_toml, Rig, request.rig_path)
    plan = parse_plan(request.plan_toml, request.plan_path)
    live = LivePipeline(rig)
    told = (request.rig_toml, request.rig_path, directory, request.plan_toml, request.plan_path)
    feed = LiveFeed(*told, drain_s=REPLAY_DRAIN_S, gives_way=False)
    with Player(request.output, None, speed=request.speed, viewer=Viewers(live, feed)) as player:

        def faster(speed: float) -> None:
            player.clock.speed = speed

        played = _Played(player)
        server = Server(directory, request, played, live, on_watch=feed.start, on_speed=faster, on_seek=player.seek)
        signal.signal(signal.SIGTERM, lambda *_: played.control.abort("stopped by the system (SIGTERM)"))
        server.start()
        announce(directory, request, server, rig, plan)
        outcome = player.run()
        # Nothing waits for a replay's end: whoever watches sees its last pictures first, however fast it was played.
        feed.close()
        live.close()
        server.finish(outcome)
