"""Rows of a session as the records that they were made from."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from drivers.records import AudioBlock, Channel, ClockFix, Frame, PolarizerFix, SwitchState, TrolleyFix
from polfuse_lab.records import Event, Exposure, FrameFlag, Note, Observed, Record, SourceFix, SweepFlag, Sweeps
from polfuse_lab.session import Session
from polfuse_lab.session.layout import UNASKED


def audio_block(session: Session, number: int) -> AudioBlock:
    """The samples of an audio record as the driver reported them. Raises as :meth:`Session.audio`."""
    row = session.sweeps[number]
    return AudioBlock(
        session.audio(number),
        session.sample_rate_hz,
        int(row["device_frame"]),
        float(row["t_device_s"]),
        int(row["t_host_ns"]),
        int(row["lost"]),
        bool(row["flags"] & int(SweepFlag.OVERFLOW)),
    )


def sweeps(session: Session, number: int) -> Sweeps:
    """An audio record. Raises as :meth:`Session.audio`."""
    row = session.sweeps[number]
    return Sweeps(
        audio_block(session, number),
        Channel(int(row["channel"])),
        int(row["position"]),
        float(row["x_m"]),
        float(row["x_sd_m"]),
        int(row["sweeps_requested"]),
        SweepFlag(int(row["flags"])),
        int(row["attempt"]),
    )


def frame(session: Session, number: int) -> Frame:
    """A frame as the camera delivered it. Raises as :meth:`Session.frame`."""
    row = session.frames[number]
    return Frame(
        session.frame(number),
        int(row["frame_id"]),
        float(row["exposure_s"]),
        float(row["gain_db"]),
        float(row["t_device_s"]),
        int(row["t_host_ns"]),
        bool(row["incomplete"]),
        int(row["lost_before"]),
    )


def exposure(session: Session, number: int) -> Exposure:
    """A frame with the polarizer's angle. Raises as :meth:`Session.frame`."""
    row = session.frames[number]
    source, source_sd = float(row["source_angle_rad"]), float(row["source_angle_sd_rad"])
    lit = not math.isnan(source)
    return Exposure(
        frame(session, number),
        float(row["angle_rad"]),
        float(row["angle_sd_rad"]),
        bool(row["dark"]),
        int(row["attempt"]),
        source if lit else None,
        source_sd if lit else 0.0,
        FrameFlag(int(row["flags"])),
    )


def trolley_fix(session: Session, number: int) -> TrolleyFix:
    """A fix of the trolley."""
    row = session.trolley[number]
    state = bytes(row["state"]).decode()
    return TrolleyFix(float(row["x_m"]), float(row["sd_m"]), bool(row["moving"]), int(row["t_host_ns"]), state)


def switch_state(session: Session, number: int) -> SwitchState:
    """A state of the switches."""
    row = session.switches[number]
    transmit, receive = bytes(row["transmit"]).decode(), bytes(row["receive"]).decode()
    return SwitchState(transmit, receive, bool(row["verified"]), int(row["t_host_ns"]))


def polarizer_fix(session: Session, number: int) -> PolarizerFix:
    """A fix of the polarizer."""
    return _polarizer_fix(session.polarizer[number])


def source_fix(session: Session, number: int) -> SourceFix:
    """A fix of the light source's polarizer."""
    return SourceFix(_polarizer_fix(session.source_polarizer[number]))


def _polarizer_fix(row: np.void) -> PolarizerFix:
    return PolarizerFix(float(row["angle_rad"]), float(row["sd_rad"]), bool(row["moving"]), int(row["t_host_ns"]))


def clock_fix(session: Session, number: int) -> ClockFix:
    """A pair of clock readings."""
    row = session.clocks[number]
    device = bytes(row["device"]).decode()
    return ClockFix(device, float(row["t_device_s"]), int(row["t_host_ns"]), int(row["round_trip_ns"]))


def note(session: Session, number: int) -> Note:
    """A remark by the operator (a long one is several)."""
    row = session.notes[number]
    return Note(bytes(row["text"]).decode(), int(row["t_host_ns"]))


def event(session: Session, number: int) -> Event:
    """What the scheduler did or noticed."""
    row = session.events[number]
    return Event(bytes(row["kind"]).decode(), bytes(row["text"]).decode(), int(row["t_host_ns"]))


_PLAIN: dict[str, Callable[[Session, int], Record]] = {
    "trolley": trolley_fix,
    "switches": switch_state,
    "polarizer": polarizer_fix,
    "source_polarizer": source_fix,
    "clocks": clock_fix,
    "notes": note,
    "events": event,
}


def plain_record(session: Session, table: str, number: int) -> Record:
    """The record of a row of a table without samples or image."""
    record = _PLAIN[table](session, number)
    if isinstance(record, (TrolleyFix, SwitchState, PolarizerFix, SourceFix)):
        during = int(getattr(session, table)[number]["record"])
        return record if during == UNASKED else Observed(record, during)
    return record
