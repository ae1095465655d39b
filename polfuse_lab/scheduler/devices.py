"""The rig's devices: made from the rig file, opened together, brought to their safe state and closed together."""

from __future__ import annotations

import concurrent.futures
import inspect
import time
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar, cast

from drivers import contracts, registry
from drivers.errors import DeviceError, DeviceTimeout
from drivers.records import Identity
from polfuse_lab.errors import PolfuseError
from polfuse_lab.rig import Rig, driver_options
from polfuse_lab.scheduler.control import Control
from polfuse_lab.scheduler.lane import Lane

Result = TypeVar("Result")

ORDER = ("radar", "switches", "trolley", "camera", "polarizer", "source_polarizer")
OPEN_S = 30.0
"""Longest that a driver may take to open (its own time-out is shorter; a camera starts a process)."""
SAFE_S = 0.6
"""Longest that bringing the devices to their safe state may take, s: an abort is over within a second."""
CLOSE_S = 10.0
STUCK_S = 0.5
"""Longest that is waited for a device whose driver had not come back from an earlier call."""


@dataclass
class Device:
    """One device, its driver's name, and the thread that speaks to it."""

    kind: str
    driver: str
    device: contracts.Device
    lane: Lane
    by_hand: bool
    """Whether a person does what the driver asks; such a device has no time-out."""
    identity: Identity | None = None
    """Who answered; None while it is not open."""

    def open(self) -> None:
        """Open it and keep who answered (in the device's own thread: known even if nobody waits for it any more)."""
        self.identity = self.device.open()

    def secure(self) -> None:
        """Bring it to its safe state, if it is open."""
        if self.identity is not None:
            self.device.make_safe()


@dataclass
class DeviceSet:
    """All devices of one run."""

    control: Control
    by_kind: dict[str, Device] = field(default_factory=dict)
    failed: str | None = None
    """Kind of the device that failed last; whoever deals with the failure sets it back."""

    def __contains__(self, kind: str) -> bool:
        return kind in self.by_kind

    @property
    def radar(self) -> contracts.Radar:
        """The radar."""
        return cast(contracts.Radar, self.by_kind["radar"].device)

    @property
    def switches(self) -> contracts.Switches:
        """The transfer switches."""
        return cast(contracts.Switches, self.by_kind["switches"].device)

    @property
    def trolley(self) -> contracts.Trolley:
        """The trolley."""
        return cast(contracts.Trolley, self.by_kind["trolley"].device)

    @property
    def polarizer(self) -> contracts.Polarizer:
        """The polarizer."""
        return cast(contracts.Polarizer, self.by_kind["polarizer"].device)

    @property
    def source_polarizer(self) -> contracts.Polarizer:
        """The polarizer in front of the light source."""
        return cast(contracts.Polarizer, self.by_kind["source_polarizer"].device)

    @property
    def camera(self) -> contracts.Camera:
        """The camera."""
        return cast(contracts.Camera, self.by_kind["camera"].device)

    @property
    def identities(self) -> tuple[Identity, ...]:
        """Who answered, in the order of opening."""
        return tuple(device.identity for device in self.by_kind.values() if device.identity is not None)

    def call(self, kind: str, function: Callable[..., Result], *args: Any, timeout_s: float = 3.0) -> Result:
        """Make one call in the device's own thread, ready to be aborted.

        Raises:
            Aborted: the run was told to stop.
            DeviceError: the device failed, or did not return within ``timeout_s``.
        """
        device = self.by_kind[kind]
        future = device.lane.submit(function, *args)
        try:
            self.control.wait_for(future, timeout_s, function.__name__, f"{kind} ({device.driver})")
        except DeviceTimeout:
            # Unless another device failed in a tick meanwhile: then this one is innocent.
            self.failed = self.failed or kind
            raise
        return self.result(kind, future, function.__name__)

    def result(self, kind: str, future: Future[Result], name: str) -> Result:
        """Outcome of a call that is done. Raises :class:`DeviceError` as the device did, or for a driver's defect."""
        try:
            return future.result()
        except DeviceError:
            self.failed = kind
            raise
        except (OSError, RuntimeError, ValueError, TypeError, AttributeError, KeyError) as error:
            raise DeviceError(
                f"the driver failed in {name} ({type(error).__name__}: {error})",
                where=f"{kind} ({self.by_kind[kind].driver})",
                advice="this is a defect of the driver: report it",
            ) from error

    def open_all(self) -> None:
        """Open every device, all at once. Raises :class:`Aborted`, or the first failure with all others named."""
        futures = {kind: device.lane.submit(device.open) for kind, device in self.by_kind.items()}
        failures: list[Exception] = []
        for kind, future in futures.items():
            device = self.by_kind[kind]
            try:
                self.control.wait_for(future, OPEN_S, "open", f"{kind} ({device.driver})")
                future.result()
            except DeviceError as error:
                failures.append(error)
            except (OSError, RuntimeError, ValueError, TypeError, AttributeError, KeyError, ImportError) as error:
                failures.append(open_failure(kind, device.driver, error))
        if failures:
            raise _together(failures)

    def make_safe(self) -> list[str]:
        """Bring all devices to their safe state, at once and in bounded time; return what did not answer in time."""
        end = time.monotonic() + SAFE_S
        waiting: dict[str, Future[None]] = {}
        for kind, device in self.by_kind.items():
            # In the device's own thread, behind an opening that is under way.
            waiting[kind] = device.lane.submit(device.secure)
        done = concurrent.futures.wait(waiting.values(), timeout=SAFE_S / 2).done
        for kind in [kind for kind, future in waiting.items() if future not in done]:
            if not waiting[kind].running():
                # The device's thread is stuck in another call: safety does not queue behind it. It stays in the queue
                # all the same, since what that call does in the end is not safe either.
                lane = Lane(f"{kind} safe")
                waiting[kind] = lane.submit(self.by_kind[kind].secure)
                lane.end()
        concurrent.futures.wait(waiting.values(), timeout=max(end - time.monotonic(), 0.05))
        troubles = []
        for kind, future in waiting.items():
            if not future.done():
                troubles.append(f"the {kind} did not confirm its safe state")
            elif future.exception() is not None:
                troubles.append(f"the {kind} could not be brought to its safe state ({future.exception()})")
        return troubles

    def close_all(self) -> None:
        """Close all devices, at once and in bounded time. Never raises."""
        stuck = {kind for kind, device in self.by_kind.items() if device.lane.busy}
        futures = {kind: device.lane.submit(device.device.close) for kind, device in self.by_kind.items()}
        concurrent.futures.wait([future for kind, future in futures.items() if kind not in stuck], timeout=CLOSE_S)
        concurrent.futures.wait(futures.values(), timeout=STUCK_S)
        for device in self.by_kind.values():
            device.lane.end()
        for device in self.by_kind.values():
            if not device.lane.busy:
                device.lane.join(1.0)


def in_order(kinds: Collection[str]) -> tuple[str, ...]:
    """Kinds of devices in the order in which they are made and named."""
    return tuple(kind for kind in ORDER if kind in kinds)


def make_devices(
    rig: Rig, path: Path, operator: contracts.Operator, control: Control, kinds: Sequence[str]
) -> DeviceSet:
    """Make the drivers that the rig file names for ``kinds``: what a plan does not speak to need not be connected.

    Raises:
        FileMistake: an unknown driver, or a wrong option.
        PolfuseError: a driver's module cannot be loaded.
    """
    devices = DeviceSet(control)
    try:
        for kind in kinds:
            devices.by_kind[kind] = make_device(rig, kind, path, operator)
    except BaseException:
        for device in devices.by_kind.values():
            device.lane.end()
        raise
    return devices


def make_device(rig: Rig, kind: str, path: Path, operator: contracts.Operator) -> Device:
    """Make one driver. Raises as :func:`make_devices`."""
    section = rig.section(kind)
    assert section is not None
    name = section.driver
    by_hand = False
    try:
        options = driver_options(rig, kind, path)
        if kind == "camera":
            from drivers.camera.process import CameraProcess

            made: contracts.Device = CameraProcess(name, options)
        else:
            driver = registry.driver_class(registry.driver_kind(kind), name)
            by_hand = "operator" in inspect.signature(driver).parameters
            made = driver(options, operator) if by_hand else driver(options)
    except PolfuseError:
        raise
    except (ImportError, OSError, AttributeError, TypeError, ValueError) as error:
        raise open_failure(kind, name, error) from error
    return Device(kind, name, made, Lane(kind), by_hand)


def open_failure(kind: str, driver: str, error: Exception) -> PolfuseError:
    """What to tell of a driver that failed with something else than a :class:`DeviceError`."""
    text = str(error)
    lowered = text.lower()
    if "portaudio" in lowered:
        advice = "install PortAudio (Debian: apt install libportaudio2; else reinstall sounddevice)"
    elif "harvesters" in lowered or "genicam" in lowered:
        advice = "install the camera's packages: pip install 'polfuse-lab[camera]'"
    elif isinstance(error, ImportError):
        advice = f"install what the driver needs ({error.name or 'see the message'})"
    elif isinstance(error, PermissionError):
        advice = "give yourself access (Linux: sudo usermod -aG dialout,audio $USER, then log in again)"
    else:
        advice = "check the device's options in the rig file; if they are right, report it"
    return PolfuseError(f"the driver cannot be used ({type(error).__name__}: {text})", where=f"{kind} ({driver})",
                        advice=advice)  # fmt: skip


def _together(failures: list[Exception]) -> Exception:
    if len(failures) == 1:
        return failures[0]
    first = failures[0]
    others = "; also ".join(str(failure) for failure in failures[1:])
    if isinstance(first, (DeviceError, PolfuseError)):
        return type(first)(first.what, where=first.where, advice=f"{first.advice}; also {others}")
    return first
