"""All stands on which faults are tried."""

from __future__ import annotations

import contextlib
import importlib.util
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from benchmarks.stand import Stand
from benchmarks.stands_camera import CameraStand, GigeStand
from benchmarks.stands_radar import RadarStand, portaudio_stand
from benchmarks.stands_serial import (
    EncoderStand,
    PolarizerStand,
    TrolleyStand,
    dowkey_stand,
    numato_stand,
    rc_stand,
)
from drivers.camera.producers import aravis_producer
from hw_mocks.sound_card import available_paths

STANDS: dict[str, Callable[..., Stand]] = {
    "switches: Dow-Key MS": dowkey_stand,
    "switches: Numato relays": numato_stand,
    "switches: Mini-Circuits RC": rc_stand,
    "trolley: GRBL": TrolleyStand,
    "trolley: encoder": EncoderStand,
    "polarizer: ELL14": PolarizerStand,
    "radar: loopback": RadarStand,
    "radar: PortAudio": portaudio_stand,
    "camera: its process": CameraStand,
    "camera: GigE Vision": GigeStand,
}
"""Every stand by its name; called with a folder and, where it is to be quick, the driver's time-out."""


def missing(name: str) -> str:
    """Why a stand cannot be set up on this machine; empty when it can."""
    if name == "radar: PortAudio" and "pulse" not in available_paths():
        return "needs libportaudio2, libasound2-plugins and pulseaudio (Debian packages)"
    if name == "camera: GigE Vision":
        if aravis_producer() is None:
            return "needs the GenTL producer (make gentl)"
        if importlib.util.find_spec("harvesters") is None:
            return "needs harvesters (pip install 'polfuse-lab[camera]')"
    return ""


@contextlib.contextmanager
def standing(name: str, timeout_s: float | None = None) -> Iterator[Stand]:
    """A stand with its driver open, in a folder of its own."""
    with tempfile.TemporaryDirectory(prefix="polfuse-faults-") as folder:
        stand = STANDS[name](Path(folder)) if timeout_s is None else STANDS[name](Path(folder), timeout_s)
        try:
            stand.driver.open()
            yield stand
        finally:
            stand.close()
