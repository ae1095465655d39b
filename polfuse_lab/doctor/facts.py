"""Facts about the computer that matter to a rig. Gathering them never hangs: whatever takes too long stays unknown."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

Value = TypeVar("Value")

QUICK_S = 3.0
"""Longest for what the operating system is asked."""
PROBE_S = 12.0
"""Longest for what drivers of other people are asked; they are asked in a process of their own."""
GENTL_PATH = "GENICAM_GENTL64_PATH"
DEBIAN_PACKAGES = ("libportaudio2", "libasound2-plugins", "libaravis-0.8-0")


@dataclass(frozen=True)
class SerialPort:
    """A serial port of this computer."""

    device: str
    description: str = ""
    accessible: bool = True
    """Whether this user may read and write it."""
    group: str = ""
    """Group that owns it."""


@dataclass(frozen=True)
class Interface:
    """A network interface."""

    name: str
    mtu: int
    up: bool = True
    loopback: bool = False


@dataclass(frozen=True)
class Listing:
    """Things found, or why they could not be looked for."""

    found: tuple[str, ...] = ()
    trouble: str = ""


@dataclass(frozen=True)
class Facts:
    """What is known of the computer; None or empty where it is unknown."""

    platform: str = sys.platform
    user: str = ""
    groups: frozenset[str] = frozenset()
    """Groups of this process."""
    listed_groups: frozenset[str] = frozenset()
    """Groups that the user's next login will have."""
    serial_ports: tuple[SerialPort, ...] = ()
    sound_inputs: Listing = Listing()
    producers: tuple[str, ...] = ()
    """GenTL producers (.cti) in the folders of GENICAM_GENTL64_PATH."""
    producer_folders_missing: tuple[str, ...] = ()
    cameras: dict[str, Listing] = field(default_factory=dict)
    """Cameras by the producer that sees them."""
    packages: dict[str, bool] = field(default_factory=dict)
    """Debian packages and whether they are installed; empty on other systems."""
    interfaces: tuple[Interface, ...] = ()
    receive_buffer_bytes: int | None = None
    """net.core.rmem_max: the largest receive buffer that a program gets."""
    free_bytes: int | None = None
    """Space where the rig file is."""
    clock_synchronised: bool | None = None
    now_s: float = 0.0
    """The computer's clock, seconds since 1970."""
    programs: frozenset[str] = frozenset()
    """Names of running programs that are known to disturb."""


def gather(folder: Path, producers: tuple[str, ...] = ()) -> Facts:
    """Look at this computer.

    Args:
        folder: where recordings will go.
        producers: GenTL producers to ask for cameras, beside those in GENICAM_GENTL64_PATH.
    """
    installed, missing = _producers()
    asked = tuple(dict.fromkeys((*producers, *installed)))
    return Facts(
        user=_within(_user, ""),
        groups=_within(_groups, frozenset()),
        listed_groups=_within(_listed_groups, frozenset()),
        serial_ports=_within(_serial_ports, ()),
        sound_inputs=_probe("sound"),
        producers=installed,
        producer_folders_missing=missing,
        cameras={path: _probe("cameras", path) for path in asked},
        packages=_within(_packages, {}),
        interfaces=_within(_interfaces, ()),
        receive_buffer_bytes=_within(_receive_buffer, None),
        free_bytes=_within(lambda: shutil.disk_usage(folder).free, None),
        clock_synchronised=_within(_clock_synchronised, None),
        now_s=time.time(),
        programs=_within(_programs, frozenset()),
    )


def _within(look: Callable[[], Value], unknown: Value, seconds: float = QUICK_S) -> Value:
    """What ``look`` returns, or ``unknown`` when it fails or takes too long (its thread is then left behind)."""
    found: list[Value] = []

    def run() -> None:
        try:
            found.append(look())
        except Exception:
            return  # unknown is an answer; the doctor must not be what fails

    thread = threading.Thread(target=run, name="doctor", daemon=True)
    thread.start()
    thread.join(seconds)
    return found[0] if found else unknown


def _probe(*words: str, seconds: float = PROBE_S) -> Listing:
    """Ask in another process, which may crash or hang as it likes."""
    command = [sys.executable, "-m", "polfuse_lab.doctor.probe", *words]
    try:
        answer = subprocess.run(command, capture_output=True, timeout=seconds, check=False, text=True)
        said: dict[str, Any] = json.loads(answer.stdout.strip().splitlines()[-1])
        return Listing(tuple(map(str, said["found"])), str(said["trouble"]))
    except subprocess.TimeoutExpired:
        return Listing(trouble=f"did not answer within {seconds:g} s")
    except (OSError, ValueError, KeyError, IndexError):
        return Listing(trouble="could not be asked")


def _user() -> str:
    import getpass

    return getpass.getuser()


def _groups() -> frozenset[str]:
    import grp

    def names() -> Iterator[str]:
        for number in (*os.getgroups(), os.getegid()):
            try:
                yield grp.getgrgid(number).gr_name
            except KeyError:
                continue

    return frozenset(names())


def _listed_groups() -> frozenset[str]:
    import grp

    user = _user()
    return frozenset(group.gr_name for group in grp.getgrall() if user in group.gr_mem)


def _serial_ports() -> tuple[SerialPort, ...]:
    from serial.tools import list_ports

    ports = sorted(list_ports.comports(), key=lambda port: str(port.device))
    return tuple(serial_port(port.device, "" if port.description == "n/a" else port.description) for port in ports)


def serial_port(device: str, description: str = "") -> SerialPort:
    """A port and whether this user may use it."""
    group, accessible = "", True
    if os.name == "posix" and Path(device).exists():
        accessible = os.access(device, os.R_OK | os.W_OK)
        try:
            group = Path(device).group()
        except (KeyError, OSError):
            group = ""
    return SerialPort(device, description, accessible, group)


def _producers() -> tuple[tuple[str, ...], tuple[str, ...]]:
    folders = [Path(part) for part in os.environ.get(GENTL_PATH, "").split(os.pathsep) if part]
    found = [str(path) for folder in folders if folder.is_dir() for path in sorted(folder.glob("*.cti"))]
    return tuple(dict.fromkeys(found)), tuple(str(folder) for folder in folders if not folder.is_dir())


def _packages() -> dict[str, bool]:
    if shutil.which("dpkg-query") is None:
        return {}

    def installed(package: str) -> bool:
        command = ["dpkg-query", "-W", "-f", "${Status}", package]
        answer = subprocess.run(command, capture_output=True, timeout=QUICK_S, check=False, text=True)
        return "ok installed" in answer.stdout

    return {package: installed(package) for package in DEBIAN_PACKAGES}


def _interfaces() -> tuple[Interface, ...]:
    found = []
    for folder in sorted(Path("/sys/class/net").iterdir()):
        flags = int((folder / "flags").read_text(), 16)
        found.append(Interface(folder.name, int((folder / "mtu").read_text()), bool(flags & 1), bool(flags & 8)))
    return tuple(found)


def _receive_buffer() -> int:
    return int(Path("/proc/sys/net/core/rmem_max").read_text())


def _clock_synchronised() -> bool | None:
    if shutil.which("timedatectl") is None:
        return None
    command = ["timedatectl", "show", "-p", "NTPSynchronized", "--value"]
    answer = subprocess.run(command, capture_output=True, timeout=QUICK_S, check=False, text=True).stdout.strip()
    return {"yes": True, "no": False}.get(answer)


def _programs() -> frozenset[str]:
    names = set()
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            names.add((folder / "comm").read_text().strip())
        except OSError:
            continue
    return frozenset(names & {"ModemManager"})
