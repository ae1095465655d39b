"""PortAudio, loaded when it is needed and with the environment that the rig asks for.

PortAudio reads its environment and lists the devices once, when it is initialised. So it is initialised for the first
port that opens and terminated with the last one that closes; a device plugged in between is found.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import sys
import threading
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from drivers.errors import DeviceError, DeviceRefused, DeviceTimeout

Result = TypeVar("Result")

ALLOWED_PREFIXES = ("ALSA_", "PULSE_", "JACK_")
ALLOWED_NAMES = ("XDG_RUNTIME_DIR",)

_lock = threading.Lock()
_users = 0
_environment: dict[str, str] = {}
_replaced: dict[str, str | None] = {}
_hanging: list[threading.Thread] = []
_left_initialised = 0


def check_environment(environment: Mapping[str, str]) -> None:
    """Refuse variables that are not about sound.

    Raises:
        DeviceRefused: a name is not ``ALSA_*``, ``PULSE_*``, ``JACK_*`` or ``XDG_RUNTIME_DIR``.
    """
    for name in environment:
        if not name.startswith(ALLOWED_PREFIXES) and name not in ALLOWED_NAMES:
            raise DeviceRefused(
                f"the environment variable {name} is not one of ALSA_*, PULSE_*, JACK_*, XDG_RUNTIME_DIR",
                where="radar.options.environment",
                advice="remove it from the rig file",
            )


def acquire(environment: Mapping[str, str]) -> Any:
    """The initialised ``sounddevice`` module. Each call is matched by one of :func:`release`.

    Raises:
        DeviceError: PortAudio is not installed or does not start.
        DeviceRefused: another open port needs a different environment, or a call into PortAudio hangs.
    """
    global _users
    check_environment(environment)
    with _lock:
        _refuse_hanging()
        if _users and dict(environment) != _environment:
            raise DeviceRefused(
                "another audio port of this process is open with a different environment",
                where="radar.options.environment",
                advice="close that port first",
            )
        if not _users:
            _enter(environment)
        try:
            sounddevice = _initialised()
        except BaseException:
            if not _users:
                _leave()
            raise
        _users += 1
        return sounddevice


def release(*, stuck: bool = False) -> None:
    """Give PortAudio back; the last one out terminates it. ``stuck``: a call into it hangs, so leave it alone."""
    global _users, _left_initialised
    with _lock:
        _users = max(_users - 1, 0)
        sounddevice: Any = sys.modules["sounddevice"]
        if stuck:
            # Its exit handler would terminate PortAudio and so wait for the hanging call for ever.
            _left_initialised += sounddevice._initialized
            sounddevice._initialized = 0
        elif not _users:
            with contextlib.suppress(Exception):
                while sounddevice._initialized:
                    sounddevice._terminate()
        if not _users:
            _leave()


def _refuse_hanging() -> None:
    """Refuse while an earlier call hangs: PortAudio cannot be initialised anew, and knows only what was there then.

    Closing a stream of a JACK server that has ended hangs for ever.
    """
    global _left_initialised
    _hanging[:] = [thread for thread in _hanging if thread.is_alive()]
    if _hanging:
        raise DeviceRefused(
            "PortAudio hangs in this program since its sound server ended",
            where="radar audio port",
            advice="end this program and start it again",
        )
    if _left_initialised:
        sys.modules["sounddevice"]._initialized += _left_initialised  # type: ignore[attr-defined]
        _left_initialised = 0


def _enter(environment: Mapping[str, str]) -> None:
    _environment.clear()
    _environment.update(environment)
    # Merely listing the devices would otherwise start a JACK server of its own.
    wanted = {"JACK_NO_START_SERVER": "1", **environment}
    _replaced.clear()
    _replaced.update({name: os.environ.get(name) for name in wanted})
    os.environ.update(wanted)


def _leave() -> None:
    """Restore the environment: a later port, or a child process, must not find a sound server that has ended."""
    for name, value in _replaced.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value
    _replaced.clear()


def _initialised() -> Any:
    try:
        loaded = "sounddevice" in sys.modules
        sounddevice: Any = importlib.import_module("sounddevice")
        if loaded and not _users:
            # The present device list was made with another environment, or before the device was plugged in.
            while sounddevice._initialized:
                sounddevice._terminate()
        if not sounddevice._initialized:
            sounddevice._initialize()
    except ImportError as error:
        raise DeviceError(
            "the Python package sounddevice is missing",
            where="radar audio port",
            advice=f"install it with 'pip install sounddevice' ({error})",
        ) from error
    except OSError as error:
        raise DeviceError(
            f"the PortAudio library is missing ({error})",
            where="radar audio port",
            advice="install it: 'apt-get install libportaudio2' on Debian, 'brew install portaudio' on macOS",
        ) from error
    except Exception as error:
        raise DeviceError(
            f"PortAudio does not start ({error})",
            where="radar audio port",
            advice="check that the sound server runs and that no other program holds the sound card",
        ) from error
    return sounddevice


def bounded(call: Callable[[], Result], timeout_s: float, what: str, where: str) -> Result:
    """Result of ``call``, which may hang inside a sound server's library; its exceptions pass through.

    Raises:
        DeviceTimeout: it did not return in time (its thread is left behind: nothing can end it).
    """
    outcome: list[Result] = []
    failure: list[BaseException] = []

    def run() -> None:
        try:
            outcome.append(call())
        except BaseException as error:
            failure.append(error)

    thread = threading.Thread(target=run, name="portaudio-call", daemon=True)
    thread.start()
    thread.join(timeout_s)
    if thread.is_alive():
        _hanging.append(thread)
        raise DeviceTimeout(
            f"{what} did not finish in {timeout_s:g} s",
            where=where,
            advice="the sound server hangs: restart it, or unplug the sound card and plug it in again",
        )
    if failure:
        raise failure[0]
    return outcome[0]
