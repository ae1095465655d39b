"""The engine: one process that owns devices, scheduler and live view; and its clients.

::

    outcome = collect("rig.toml", "plan.toml", "session.h5", on_status=lambda status: print(status.reason))

A window instead starts an engine (or attaches to a running one), polls it, and may leave at any time::

    client = EngineClient.start("rig.toml", "plan.toml", "session.h5")
    event = client.poll(0.0)        # a StatusEvent, Finished, or None
    client.pause(); client.resume(); client.abort()
"""

from polfuse_lab.engine.client import EngineClient, ReplayClient, collect, engines, running_engines
from polfuse_lab.engine.directory import EngineInfo
from polfuse_lab.engine.protocol import Finished, PreviewData, Prompt, StatusEvent

__all__ = [
    "EngineClient",
    "EngineInfo",
    "Finished",
    "PreviewData",
    "Prompt",
    "ReplayClient",
    "StatusEvent",
    "collect",
    "engines",
    "running_engines",
]
