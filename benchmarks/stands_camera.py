"""Stands of cameras: one in process behind its own process, and a GigE Vision camera on the wire."""

from __future__ import annotations

import contextlib
import errno
import os
import signal
import time
from pathlib import Path

from benchmarks.stand import Noticed, within
from drivers.camera.genicam_setup import GenicamOptions
from drivers.camera.process import CameraProcess
from hw_mocks.faults import FaultKind
from hw_mocks.gige_camera import GigeCamera, Pattern, Settings
from hw_mocks.scene_camera import SceneCamera
from hw_mocks.world import World
from hw_mocks.world_link import WorldServer

SCENE = """\
[[surface]]
name = "wall"
corner_m = [-20.0, 20.0, -10.0]
edge_u_m = [40.0, 0.0, 0.0]
edge_v_m = [0.0, 0.0, 20.0]
s0 = 0.5
"""
GIGE_ADDRESSES = tuple(f"127.0.0.{host}" for host in range(9, 17))
"""Loopback addresses that simulated rigs do not take: clients look at one port only."""


class CameraStand:
    """A camera in a process of its own that sees a scene: one frame. The faults are those of the process."""

    name = "camera: its process"

    def __init__(self, folder: Path, timeout_s: float = 1.5) -> None:
        self.timeout_s = timeout_s
        self.opening_s = 10.0
        self._world = WorldServer(World())
        scene = folder / "wall.toml"
        scene.write_text(SCENE)
        options = SceneCamera.Options(scene_file=str(scene), world_url=self._world.url, width_px=32, height_px=24)
        self.driver = CameraProcess("scene", options, watchdog_s=timeout_s)

    def round(self) -> None:
        """One frame."""
        self.driver.trigger()
        for _ in within():
            if self.driver.poll() is not None:
                return

    def begin(self, kind: FaultKind, amount: float) -> None:
        """``DISCONNECT``: the process dies. ``STALL``: it hangs."""
        pid = self.driver.pid
        assert pid is not None
        os.kill(pid, signal.SIGKILL if kind is FaultKind.DISCONNECT else signal.SIGSTOP)

    def end(self, kind: FaultKind) -> None:
        """A process that hangs goes on."""
        if kind is FaultKind.STALL and self.driver.pid is not None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.driver.pid, signal.SIGCONT)

    def reset(self) -> None:
        """Nothing to do."""

    def close(self) -> None:
        """Close the driver and the simulated world."""
        self.driver.close()
        self._world.close()


class GigeStand:
    """A GigE Vision camera on loopback, through the GenTL producer and harvesters, in the camera process: one frame."""

    name = "camera: GigE Vision"

    def __init__(self, folder: Path, timeout_s: float = 1.5) -> None:
        self.timeout_s = max(timeout_s, 1.0)
        self.opening_s = 10.0
        settings = Settings(frame_rate_hz=100.0, exposure_s=0.001)
        self._camera = _free_camera(settings)
        options = GenicamOptions(
            cti="aravis",
            addresses=(self._camera.address,),
            exposure_s=0.001,
            timeout_s=self.timeout_s,
            pixel_format="Mono16",
        )
        self.driver = CameraProcess("harvesters", options)

    def round(self) -> None:
        """One frame; one that is incomplete is told as the scheduler tells it."""
        self.driver.trigger()
        for _ in within():
            frame = self.driver.poll()
            if frame is not None:
                if frame.incomplete:
                    raise Noticed("camera: an incomplete frame came; it is taken again")
                return

    def begin(self, kind: FaultKind, amount: float) -> None:
        """Begin a fault of the camera."""
        self._camera.faults.start(kind, amount=amount)

    def end(self, kind: FaultKind) -> None:
        """End it."""
        self._camera.faults.stop(kind)
        time.sleep(0.1)

    def reset(self) -> None:
        """Nothing to do."""

    def close(self) -> None:
        """Close the driver, then the camera."""
        self.driver.close()
        self._camera.close()


def _free_camera(settings: Settings) -> GigeCamera:
    """A camera at the first address that nobody else has."""
    for address in GIGE_ADDRESSES[:-1]:
        try:
            return GigeCamera(Pattern(64, 96), World(), address, settings=settings)
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise
    return GigeCamera(Pattern(64, 96), World(), GIGE_ADDRESSES[-1], settings=settings)
