"""Which ways out of the simulator this machine has."""

from __future__ import annotations

import ctypes.util
import importlib.util
import shutil
import sys
from pathlib import Path


def available_paths() -> tuple[str, ...]:
    """Names of the usable audio paths, best first: ``"pulse"``, ``"alsa_file"`` (not paced), ``"jack"``, ``"tcp"``.

    All but the last need Linux and PortAudio, the first two also ALSA; ``"pulse"`` the PulseAudio daemon and its ALSA
    plugin; ``"jack"`` the JACK server and the Python package JACK-Client.
    """
    paths = ["tcp"]
    if not sys.platform.startswith("linux") or not ctypes.util.find_library("portaudio"):
        return tuple(paths)
    if shutil.which("jackd") and shutil.which("sh") and importlib.util.find_spec("jack"):
        paths.insert(0, "jack")
    if system_alsa_conf().is_file():
        paths.insert(0, "alsa_file")
        if shutil.which("pulseaudio") and shutil.which("sh") and _plugin_installed():
            paths.insert(0, "pulse")
    return tuple(paths)


def system_alsa_conf() -> Path:
    """ALSA's own configuration, which a private one has to be added to."""
    return Path("/usr/share/alsa/alsa.conf")


def alsa_environment(conf: Path) -> dict[str, str]:
    """Environment that makes ALSA read a private configuration after its own."""
    return {"ALSA_CONFIG_PATH": f"{system_alsa_conf()}:{conf}"}


def _plugin_installed() -> bool:
    roots = (Path("/usr/lib"), Path("/usr/lib64"))
    name = "alsa-lib/libasound_module_pcm_pulse.so"
    return any(next(root.glob(pattern), None) for root in roots for pattern in (name, f"*/{name}"))
