"""What a GRBL 1.1 controller says: status reports, errors and alarms, turned into records and words."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from drivers.errors import DeviceBadAnswer

AXES = "XYZ"

#: The meaning of ``error:N`` (GRBL 1.1 interface description).
ERRORS = {
    1: "a G-code letter was missing",
    2: "a number was missing or not a number",
    3: "the '$' command is not known",
    4: "a value that must be positive was negative",
    5: "homing is not enabled ($22=0)",
    6: "the step pulse is shorter than 3 us",
    7: "its settings memory could not be read, defaults are in force",
    8: "'$' commands are taken only while it is idle",
    9: "G-code is locked while it is in alarm or jogging",
    10: "soft limits need homing to be enabled",
    11: "the line was too long",
    12: "a setting exceeds the greatest step rate",
    13: "the safety door is open",
    14: "a stored line is too long",
    15: "the jog target is beyond the machine's travel",
    16: "the jog command was malformed",
    17: "laser mode needs PWM",
    20: "a G-code command is not supported",
    21: "two commands of one modal group were in one line",
    22: "no feed rate was set",
    23: "a G-code command needs a whole number",
    24: "two commands in one line both need axis words",
    25: "a G-code word was repeated",
    26: "axis words are missing",
    27: "the line number is out of range",
    28: "a G-code command lacks a value",
    30: "G53 was used without G0 or G1",
    31: "unused axis words were in the line",
    33: "the target is invalid",
}

#: The meaning of ``ALARM:N``.
ALARMS = {
    1: "a limit switch was hit, the position is probably lost",
    2: "the target is beyond the soft limits",
    3: "it was reset while moving, the position is probably lost",
    4: "the probe was not in its initial state",
    5: "the probe found nothing",
    6: "it was reset while homing",
    7: "the safety door was opened while homing",
    8: "homing could not leave the limit switch",
    9: "homing did not find the limit switch",
}

_REPORT = re.compile(r"<([A-Z][a-z]+)(?::(\d+))?((?:\|[A-Za-z]+:[^|>]*)*)>")


@dataclass(frozen=True)
class Report:
    """One status report: ``<Run|MPos:2.260,0.000,0.000|FS:432,0>``.

    ``machine_mm`` is None where the report gives a work position and no offset has been reported yet.
    """

    state: str
    substate: int | None
    machine_mm: tuple[float, ...] | None
    work_offset_mm: tuple[float, ...] | None

    @property
    def name(self) -> str:
        """State as the controller writes it, such as ``Run`` or ``Hold:0``."""
        return self.state if self.substate is None else f"{self.state}:{self.substate}"


def parse_report(line: str, work_offset_mm: tuple[float, ...] | None, where: str) -> Report:
    """Read a status report.

    Args:
        line: the report, with its angle brackets.
        work_offset_mm: last offset that was reported (WCO comes only in some reports), or None.
        where: the device, for messages.

    Raises:
        DeviceBadAnswer: it is no status report, or its position is missing or no number.
    """
    match = _REPORT.fullmatch(line)
    if match is None:
        raise _bad(line, where)
    fields = dict(field.split(":", 1) for field in match[3].split("|") if field)
    if "WCO" in fields:
        work_offset_mm = _numbers(fields["WCO"], line, where)
    if "MPos" in fields:
        machine_mm: tuple[float, ...] | None = _numbers(fields["MPos"], line, where)
    elif "WPos" in fields:
        work_mm = _numbers(fields["WPos"], line, where)
        if work_offset_mm is None:
            machine_mm = None
        elif len(work_offset_mm) == len(work_mm):
            machine_mm = tuple(w + o for w, o in zip(work_mm, work_offset_mm, strict=True))
        else:
            raise _bad(line, where)
    else:
        raise _bad(line, where)
    return Report(match[1], int(match[2]) if match[2] else None, machine_mm, work_offset_mm)


def explain(line: str) -> str:
    """Words for ``error:N`` or ``ALARM:N``; anything else is returned as it is."""
    kind, _, number = (part.strip() for part in line.partition(":"))
    table = {"error": ERRORS, "alarm": ALARMS}.get(kind.lower())
    if table is None or not number.isdecimal():
        return line
    return f"{line} ({table.get(int(number), 'a code that GRBL 1.1 does not list')})"


def parse_setting(line: str) -> tuple[int, float] | None:
    """Number and value of a ``$100=250.000`` line, else None."""
    match = re.fullmatch(r"\$(\d{1,3})=(-?\d+(?:\.\d*)?).*", line)
    return (int(match[1]), float(match[2])) if match else None


def _numbers(text: str, line: str, where: str) -> tuple[float, ...]:
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        raise _bad(line, where) from None
    if not 1 <= len(numbers) <= 6 or not all(math.isfinite(number) for number in numbers):
        raise _bad(line, where)
    return numbers


def _bad(line: str, where: str) -> DeviceBadAnswer:
    return DeviceBadAnswer(
        f"sent {line[:80]!r}, which is no GRBL 1.1 status report",
        where=where,
        advice="check the baud rate and that the controller runs GRBL 1.1",
    )
