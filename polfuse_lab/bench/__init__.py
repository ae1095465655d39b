"""Set-up mode: every device of a rig by itself, without a plan; an engine holds them, a client looks and asks.

::

    with BenchClient.start("rig.toml") as bench:
        view = bench.live()                  # meters, camera, profiles: see polfuse_lab.live
        status = bench.poll(0.2)             # a light for each device, and how to mend it
        bench.jog(0.1); bench.select("HV"); bench.turn(45.0)
"""

from polfuse_lab.bench.client import BenchClient
from polfuse_lab.bench.protocol import BenchStatus, CameraView, DeviceLight, SwitchView, TrolleyView, TurnView

__all__ = ["BenchClient", "BenchStatus", "CameraView", "DeviceLight", "SwitchView", "TrolleyView", "TurnView"]
