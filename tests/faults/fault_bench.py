"""A small simulated rig over real wires, a plan, and a scheduler with a real writer process: where faults are tried."""

from __future__ import annotations

import contextlib
from pathlib import Path
from types import TracebackType
from typing import Any

from drivers import registry
from hw_mocks.rig import SimulatedRig
from hw_mocks.wire import Wire
from hw_mocks.world import World
from polfuse_lab.engine.recorder import WriterProcess
from polfuse_lab.plans import load_plan
from polfuse_lab.rig import driver_options, load_rig
from polfuse_lab.scheduler import Scheduler

SCENE = """\
name = "bench"
seed = 3
[rail]
length_m = 1.0
speed_m_s = 2.0
[audio]
sample_rate_hz = 48000.0
[front_end]
noise = 0.01
[[point]]
name = "p"
position_m = [0.0, 9.0, -1.0]
rcs_dbsm = 20.0
[camera]
width_px = 32
height_px = 24
exposure_s = 0.002
[[surface]]
name = "wall"
corner_m = [-20.0, 20.0, -10.0]
edge_u_m = [40.0, 0.0, 0.0]
edge_v_m = [0.0, 0.0, 20.0]
s0 = 0.5
"""
PLAN = """\
aperture_m = {aperture}
step_m = {step}
sweeps_per_channel = {sweeps}
move_settle_s = 0.0
channels = ["HH", "HV"]
{limits}"""


class FaultBench:
    """The rig in a folder; ``with`` ends it."""

    def __init__(self, folder: Path) -> None:
        self.session = folder / "s.h5"
        self.plan = folder / "plan.toml"
        scene = folder / "bench.toml"
        scene.write_text(SCENE)
        self.simulated = SimulatedRig(scene, folder / "sim", audio="tcp")
        self.rig = self.simulated.write_rig(folder / "rig.toml")

    def __enter__(self) -> FaultBench:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.simulated.close()

    @property
    def world(self) -> World:
        return self.simulated.world

    def wire(self, kind: str) -> Wire:
        wire: Wire = getattr(self.simulated, kind)
        return wire

    def driver(self, kind: str, **changes: Any) -> Any:
        """The driver that the rig file names, with some options changed."""
        rig = load_rig(self.rig)
        section = rig.section(kind)
        assert section is not None
        section.options.update(changes)
        return registry.driver_class(kind, section.driver)(driver_options(rig, kind, self.rig))

    def write_plan(self, *, sweeps: int, aperture: float = 0.1, step: float = 0.05, **limits: float) -> None:
        words = "".join(f"{name} = {value}\n" for name, value in limits.items())
        self.plan.write_text(PLAN.format(sweeps=sweeps, aperture=aperture, step=step, limits=words))

    def scheduler(self) -> Scheduler:
        with contextlib.suppress(FileNotFoundError):
            self.session.unlink()
        return Scheduler(
            load_rig(self.rig),
            load_plan(self.plan),
            self.session,
            WriterProcess(self.session),
            rig_path=self.rig,
            rig_toml=self.rig.read_text(),
            plan_toml=self.plan.read_text(),
        )
