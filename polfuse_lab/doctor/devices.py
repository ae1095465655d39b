"""Look at every device of a rig, say what is wrong and how to mend it. Never hangs, never changes a setting."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from drivers.errors import DeviceError
from drivers.radar.health import Severity
from polfuse_lab.doctor.findings import Finding
from polfuse_lab.errors import PolfuseError
from polfuse_lab.live import signal_health, sync_problem
from polfuse_lab.plans.dry_run import record_frames
from polfuse_lab.rig import Rig, read_model
from polfuse_lab.scheduler.control import Control
from polfuse_lab.scheduler.devices import OPEN_S, Device, DeviceSet, make_device, open_failure
from polfuse_lab.scheduler.prompts import Prompts

KINDS = ("radar", "switches", "trolley", "camera", "polarizer", "source_polarizer")
LISTEN_S = 2.0
"""Length of the piece that is judged, s: enough to tell mains hum from the sweeps."""
PATIENCE_S = 10.0
CHECK = "check the radar's power, its cable and the input level"


def examine(path: Path | str) -> list[Finding]:
    """Open each device of a rig in turn, ask who it is, and close it again; listen to the radar for its sync.

    Hand-operated devices are only made, since opening them may ask the operator for something.

    Raises:
        PolfuseError: the rig file itself cannot be read.
    """
    path = Path(path)
    rig = read_model(path, Rig)
    return [examine_device(rig, kind, path) for kind in KINDS if rig.section(kind) is not None]


def examine_device(rig: Rig, kind: str, path: Path) -> Finding:
    """Examine one device. Never raises for what is wrong with it."""
    section = rig.section(kind)
    assert section is not None
    control = Control()
    try:
        device = make_device(rig, kind, path, Prompts())
    except PolfuseError as error:
        return failed(kind, section.driver, error)
    devices = DeviceSet(control, {kind: device})
    try:
        if device.by_hand:
            return Finding(device.driver, kind, True, "operated by hand", "")
        return _examine_open(rig, device, devices)
    except Exception as error:
        return failed(kind, device.driver, error)
    finally:
        devices.make_safe()
        devices.close_all()


def _examine_open(rig: Rig, device: Device, devices: DeviceSet) -> Finding:
    opening = device.lane.submit(device.open)
    devices.control.wait_for(opening, OPEN_S, "open", f"{device.kind} ({device.driver})")
    opening.result()
    detail = who_answered(device)
    if device.kind == "radar":
        return _listen(rig, device, detail, devices)
    return Finding(device.driver, device.kind, True, detail, "")


def _listen(rig: Rig, device: Device, detail: str, devices: DeviceSet) -> Finding:
    """Record for :data:`LISTEN_S` and say what is wrong with the signal."""
    radar = devices.radar
    sweeps = max(3, math.ceil(LISTEN_S / rig.waveform.sweep_period_s))
    devices.call("radar", radar.begin, record_frames(rig, sweeps, radar.sample_rate_hz))
    end = time.monotonic() + PATIENCE_S
    while (block := devices.call("radar", radar.poll)) is None:
        if time.monotonic() > end:
            what = f"{detail}: no samples within {PATIENCE_S:g} s"
            return Finding(device.driver, device.kind, False, what, CHECK)
        devices.control.slice()
    return judged(rig, device.driver, detail, block.samples, block.sample_rate_hz)


def failed(kind: str, driver: str, error: Exception) -> Finding:
    """What is said of a device that cannot be used."""
    told = error if isinstance(error, DeviceError | PolfuseError) else open_failure(kind, driver, error)
    return Finding(driver, kind, False, told.what, told.advice)


def who_answered(device: Device) -> str:
    """Name and details of an open device."""
    assert device.identity is not None
    return " ".join(part for part in (device.identity.name, device.identity.detail) if part)


def judged(rig: Rig, driver: str, detail: str, samples: NDArray[Any], sample_rate_hz: float) -> Finding:
    """What is said of a radar by a piece of its signal.

    Args:
        rig: the rig, for its waveform.
        driver: name of the radar's driver.
        detail: who answered.
        samples: (frames, 2), about :data:`LISTEN_S` of them.
        sample_rate_hz: sample rate, Hz.
    """
    health = signal_health(rig, samples, sample_rate_hz)
    if health.error is not None:
        return Finding(driver, "radar", False, f"{detail}: {health.error.sentence}", health.error.advice)
    problem = sync_problem(rig, samples, sample_rate_hz)
    if problem is not None:
        return Finding(driver, "radar", False, f"{detail}: {problem}", problem.partition("; ")[2] or CHECK)
    detail += ", sync found"
    sentences = [finding.sentence for finding in health.findings]
    advice = [finding.advice for finding in health.findings if finding.severity >= Severity.WARNING]
    return Finding(driver, "radar", True, "; ".join([detail, *sentences]), "; ".join(advice))
