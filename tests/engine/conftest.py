from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import fake_devices
import pytest

from polfuse_lab.engine import EngineClient, running_engines
from polfuse_lab.engine.recorder import WriterProcess
from polfuse_lab.live import LivePipeline
from polfuse_lab.plans import load_plan
from polfuse_lab.rig import load_rig
from polfuse_lab.scheduler import Outcome, Scheduler

RIG = """\
[waveform]
centre_hz = 2.4e9
bandwidth_hz = 80e6
ramp_up_s = 0.02
sweep_period_s = 0.04
[geometry]
antenna_height_m = 1.069
[radar]
driver = "fake"
options = {radar}
[switches]
driver = "fake"
settle_s = 0.0
options = {switches}
[trolley]
driver = "{trolley_driver}"
length_m = 3.2
options = {trolley}
"""
CAMERA = """\
[camera]
driver = "fake"
width_px = 8
height_px = 6
exposure_s = 0.01
focal_length_m = 0.008
pixel_pitch_m = 8e-6
options = {camera}
[polarizer]
driver = "fake"
options = {polarizer}
"""
PLAN = """\
aperture_m = {aperture}
step_m = 0.5
sweeps_per_channel = {sweeps}
move_settle_s = {settle}
channels = ["HH", "HV"]
"""


def _inline(options: dict[str, object]) -> str:
    return "{" + ", ".join(f"{key} = {json.dumps(value)}" for key, value in options.items()) + "}"


class Bench:
    """A folder with a rig of fake devices and a plan."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.log = folder / "devices.log"
        self.session = folder / "s.h5"
        self.rig = folder / "rig.toml"
        self.plan = folder / "plan.toml"
        self.live: LivePipeline | None = None

    def write(self, *, optics: bool = False, aperture: float = 1.0, sweeps: int = 1, settle: float = 0.0,
              trolley_driver: str = "fake", **options: dict[str, object]) -> None:  # fmt: skip
        log = {"log": str(self.log)}
        tables = {kind: _inline(log | options.get(kind, {})) for kind in ("radar", "switches", "trolley")}
        optical = {kind: _inline(log | options.get(kind, {})) for kind in ("camera", "polarizer")}
        rig = RIG.format(**tables, trolley_driver=trolley_driver)
        self.rig.write_text(rig + (CAMERA.format(**optical) if optics else ""))
        plan = PLAN.format(aperture=aperture, sweeps=sweeps, settle=settle)
        self.plan.write_text(plan + ("[optics]\nframes_per_angle = 2\nsettle_s = 0.0\n" if optics else ""))

    def start(self) -> EngineClient:
        return EngineClient.start(self.rig, self.plan, self.session)

    def scheduler(self) -> Scheduler:
        """A scheduler in this process (its writer is a process all the same)."""
        self.live = LivePipeline(load_rig(self.rig))
        return Scheduler(
            load_rig(self.rig),
            load_plan(self.plan),
            self.session,
            WriterProcess(self.session),
            rig_path=self.rig,
            rig_toml=self.rig.read_text(),
            plan_toml=self.plan.read_text(),
            viewer=self.live,
        )

    def run(self) -> Outcome:
        return self.scheduler().run()

    def events(self) -> list[tuple[int, str]]:
        if not self.log.exists():
            return []
        return [(int(line.split()[0]), line.split(maxsplit=1)[1]) for line in self.log.read_text().splitlines()]


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    """A bench whose fake drivers are found by this process and by the processes that it starts."""
    site = tmp_path / "site"
    site.mkdir()
    fake_devices.install(site)
    here = str(Path(fake_devices.__file__).parent)
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(site), here, os.environ.get("PYTHONPATH", "")]))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    (tmp_path / "run").mkdir(mode=0o700)
    made = Bench(tmp_path)
    yield made
    if made.live is not None:
        made.live.close()
    # Engines that a failed test left behind (their directory is in this test's own folder).
    if "platformdirs" in sys.modules:
        from polfuse_lab.engine import directory

        for engine in running_engines():
            address = directory.address(engine)
            if address is not None:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(address.pid, signal.SIGKILL)
