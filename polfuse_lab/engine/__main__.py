"""The engine's process: owns the devices, the scheduler and the live view; its children: writer, camera and guard.

Started by :class:`polfuse_lab.engine.client.EngineClient` with the engine's private directory as its argument.
"""

from __future__ import annotations

import faulthandler
import os
import signal
import sys
import traceback
from pathlib import Path

import msgspec

from polfuse_lab.engine import protocol
from polfuse_lab.engine.directory import ADDRESS, REQUEST, remove
from polfuse_lab.engine.guard import Guard
from polfuse_lab.engine.recorder import WriterProcess
from polfuse_lab.engine.server import Server
from polfuse_lab.live import LivePipeline
from polfuse_lab.plans import parse_plan
from polfuse_lab.plans.custom import recorded_plan
from polfuse_lab.plans.step_json import steps_from_json
from polfuse_lab.rig import Rig, parse_model
from polfuse_lab.scheduler import Scheduler
from polfuse_lab.session.layout import CONTINUES


def main(directory: Path) -> None:
    """Carry out the request in ``directory``."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    request = msgspec.msgpack.decode((directory / REQUEST).read_bytes(), type=protocol.Request)
    (directory / REQUEST).unlink()
    rig = parse_model(request.rig_toml, Rig, request.rig_path)
    plan = parse_plan(request.plan_toml, request.plan_path)
    guard = Guard(request.rig_toml, request.rig_path, directory)
    live = LivePipeline(rig)
    origin: dict[str, object] = {}
    if request.rest is not None:
        plan = recorded_plan(plan, steps_from_json(request.rest.steps_json))
        origin = {CONTINUES: request.rest.origin}
    recorder = WriterProcess(Path(request.output), origin)
    scheduler = Scheduler(
        rig,
        plan,
        Path(request.output),
        recorder,
        rig_path=Path(request.rig_path),
        rig_toml=request.rig_toml,
        plan_toml=request.plan_toml,
        viewer=live,
        on_change=lambda: server.changed(),
    )
    server = Server(directory, request, scheduler, live)
    signal.signal(signal.SIGTERM, lambda *_: scheduler.control.abort("stopped by the system (SIGTERM)"))
    server.start()
    address = protocol.Address(server.endpoint, os.getpid(), request.output)
    unfinished = directory / f"{ADDRESS}.new"
    unfinished.write_bytes(msgspec.json.encode(address))
    unfinished.replace(directory / ADDRESS)
    outcome = scheduler.run()
    if not scheduler.unsafe:
        guard.dismiss()
    # Else no goodbye: when this process, and with it every call that hangs in a driver, has ended, the guard tries.
    live.close()
    server.finish(outcome)


if __name__ == "__main__":
    private = Path(sys.argv[1])
    # A crash in native code (sound, camera, HDF5) leaves its stack in the engine's log, which the client quotes.
    faulthandler.enable()
    code = 1
    try:
        main(private)
        code = 0
        remove(private)
    except BaseException:
        # To the log, which the client quotes; it or the guard removes the directory then.
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        # A driver that hangs in native code must not keep the engine from ending.
        os._exit(code)
