"""Every device and every fault that it can have: what is expected, the trial, and the table of what was measured."""

from __future__ import annotations

import enum
import re
import time
from collections.abc import Iterable
from dataclasses import dataclass, field

from benchmarks.stand import Hung, Noticed, Stand, Untruthful
from drivers.errors import DeviceBadAnswer, DeviceError, DeviceLost, DeviceRefused, DeviceTimeout
from hw_mocks.faults import FaultKind as K

LIMIT_S = 2.0
"""A fault is detected within this, or within the driver's own time-out where that is longer."""
SCHEDULING_S = 0.5
"""What a busy computer may add."""
WATCH_S = 1.0
"""How long a fault that changes nothing is watched."""


class After(enum.Enum):
    """What the driver does once the fault is over; the scheduler waits for it and opens it again in either case."""

    GOES_ON = "goes on"
    """The fault does no harm."""
    BY_ITSELF = "works again by itself"
    REOPENED = "works again when opened again"
    UNNOTICED = "cannot be noticed by the device"


@dataclass(frozen=True)
class Case:
    """One device with one fault."""

    device: str
    kind: K
    after: After
    raises: tuple[type[Exception], ...] = ()
    """One of these is how it is noticed; empty: nothing is."""
    amount: float = 0.0
    label: str = ""
    """The fault in words, where its kind alone does not say it."""
    note: str = ""
    at_opening: bool = False
    """The fault is there when the driver is opened, and it refuses."""

    @property
    def fault(self) -> str:
        """The fault in words."""
        return self.label or self.kind.value.replace("_", " ")

    @property
    def key(self) -> str:
        """Names the case in tests and tables."""
        return f"{self.device}, {self.fault}"


@dataclass
class Trial:
    """What came of a case."""

    case: Case
    detected_s: float | None = None
    kind: str = ""
    sentence: str = ""
    after: str = ""
    limit_s: float = LIMIT_S + SCHEDULING_S
    problems: list[str] = field(default_factory=list)

    @property
    def ok(self) -> bool:
        """Whether everything was as documented."""
        return not self.problems


_LOST, _SILENT, _BAD, _NO = (DeviceLost,), (DeviceTimeout,), (DeviceBadAnswer,), (DeviceRefused,)
_ANY = (DeviceBadAnswer, DeviceTimeout, DeviceRefused)


def _serial(device: str, *, slow_by_itself: bool = True) -> list[Case]:
    late = After.BY_ITSELF if slow_by_itself else After.REOPENED
    return [
        Case(device, K.SILENCE, After.BY_ITSELF, _SILENT),
        Case(
            device, K.GARBAGE, late, _ANY, note="random bytes may look like the end of a line, or like nothing at all"
        ),
        Case(device, K.PARTIAL_LINE, late, _ANY),
        Case(device, K.SLOW, After.GOES_ON, amount=0.1, label="answers 0.1 s late"),
        Case(device, K.SLOW, late, _SILENT, label="answers later than its time-out"),
        Case(device, K.DISCONNECT, After.REOPENED, _LOST),
    ]


CASES: tuple[Case, ...] = (
    *_serial("switches: Dow-Key MS"),
    Case("switches: Dow-Key MS", K.STUCK_SWITCH, After.BY_ITSELF, (DeviceTimeout, DeviceRefused), amount=2),
    *_serial("switches: Numato relays"),
    Case(
        "switches: Numato relays",
        K.STUCK_SWITCH,
        After.UNNOTICED,
        amount=2,
        note="the relays say how they stand, not the contacts behind them: records are flagged as not verified",
    ),
    *_serial("switches: Mini-Circuits RC"),
    Case("switches: Mini-Circuits RC", K.STUCK_SWITCH, After.BY_ITSELF, _NO, amount=2),
    Case("switches: Mini-Circuits RC", K.HEAT_ALARM, After.BY_ITSELF, _NO),
    *_serial("trolley: GRBL", slow_by_itself=False),
    Case("trolley: GRBL", K.STALL, After.REOPENED, _SILENT),
    Case(
        "trolley: GRBL",
        K.LOST_STEPS,
        After.UNNOTICED,
        amount=0.02,
        note="a stepper without an encoder: seen at the limit switch (ALARM:1), by homing, or by autofocus",
    ),
    Case("trolley: encoder", K.SILENCE, After.BY_ITSELF, _SILENT),
    Case("trolley: encoder", K.GARBAGE, After.BY_ITSELF, (DeviceBadAnswer, DeviceTimeout)),
    Case("trolley: encoder", K.PARTIAL_LINE, After.BY_ITSELF, (DeviceBadAnswer, DeviceTimeout)),
    Case("trolley: encoder", K.SLOW, After.GOES_ON, amount=0.1, label="lines 0.1 s late"),
    Case("trolley: encoder", K.DROP_PACKETS, After.GOES_ON, amount=0.3, label="30 % of the lines lost"),
    Case("trolley: encoder", K.DISCONNECT, After.REOPENED, _LOST),
    Case("trolley: encoder", K.CLOCK_JUMP, After.REOPENED, _LOST, amount=-0.5, label="its clock jumps back by 0.5 s"),
    Case(
        "trolley: encoder",
        K.STALL,
        After.UNNOTICED,
        note="a wheel that does not turn looks like a trolley that is not pushed",
    ),
    Case(
        "trolley: encoder",
        K.LOST_STEPS,
        After.UNNOTICED,
        amount=0.02,
        label="its wheel slips",
        note="corrected at the index mark, where there is one",
    ),
    *_serial("polarizer: ELL14", slow_by_itself=False),
    Case("polarizer: ELL14", K.LOST_STEPS, After.BY_ITSELF, _NO, amount=0.1, note="its encoder knows; three tries"),
    Case("polarizer: ELL14", K.STALL, After.BY_ITSELF, _NO, note="the mount says so after 1 s (GS02)"),
    Case("polarizer: ELL14", K.HEAT_ALARM, After.BY_ITSELF, _NO),
    *(
        case
        for device in ("radar: loopback", "radar: PortAudio")
        for case in (
            Case(device, K.SILENCE, After.BY_ITSELF, (Noticed,), amount=2, label="both channels dead"),
            Case(device, K.SILENCE, After.BY_ITSELF, (Noticed,), amount=1, label="sync channel dead"),
            Case(device, K.GARBAGE, After.BY_ITSELF, (Noticed,), label="random samples"),
            Case(device, K.STALL, After.BY_ITSELF, _SILENT),
            Case(device, K.OVERFLOW, After.BY_ITSELF, (Noticed,), amount=960, label="960 frames lost without a flag"),
            Case(device, K.DISCONNECT, After.REOPENED, (DeviceLost, DeviceTimeout)),
        )
    ),
    Case("radar: PortAudio", K.CLOCK_JUMP, After.REOPENED, (Noticed,), amount=0.5, label="its clock stops for 0.5 s"),
    Case(
        "radar: PortAudio",
        K.WRONG_FORMAT,
        After.REOPENED,
        _NO,
        amount=44_100,
        label="44.1 instead of 48 kHz when opened",
        at_opening=True,
    ),
    Case("camera: its process", K.DISCONNECT, After.REOPENED, _LOST, label="process killed"),
    Case("camera: its process", K.STALL, After.REOPENED, _LOST, label="process hangs"),
    Case("camera: GigE Vision", K.SILENCE, After.REOPENED, (DeviceLost, DeviceTimeout)),
    Case("camera: GigE Vision", K.GARBAGE, After.REOPENED, (Noticed, DeviceError)),
    Case("camera: GigE Vision", K.PARTIAL_LINE, After.REOPENED, (Noticed, DeviceError), label="answers break off"),
    Case("camera: GigE Vision", K.SLOW, After.GOES_ON, amount=0.05, label="answers 0.05 s late"),
    Case("camera: GigE Vision", K.DISCONNECT, After.REOPENED, (DeviceLost, DeviceTimeout)),
    Case("camera: GigE Vision", K.STALL, After.BY_ITSELF, _SILENT),
    Case("camera: GigE Vision", K.DROP_FRAMES, After.BY_ITSELF, _SILENT, label="all frames lost"),
    Case("camera: GigE Vision", K.DROP_PACKETS, After.GOES_ON, amount=0.02, label="2 % of the packets lost"),
    Case(
        "camera: GigE Vision",
        K.DROP_PACKETS,
        After.BY_ITSELF,
        (Noticed, DeviceTimeout),
        amount=1.0,
        label="all packets lost",
    ),
    Case("camera: GigE Vision", K.WRONG_FORMAT, After.BY_ITSELF, _ANY),
    Case("camera: GigE Vision", K.OVERFLOW, After.BY_ITSELF, (Noticed, DeviceTimeout)),
    Case("camera: GigE Vision", K.CLOCK_JUMP, After.GOES_ON, amount=5.0, label="its clock jumps by 5 s"),
    Case("camera: GigE Vision", K.HEAT_ALARM, After.BY_ITSELF, (DeviceTimeout, DeviceRefused)),
)
"""Everything that is tried."""


def attempt(case: Case, stand: Stand) -> Trial:
    """Try a case on a stand whose driver is open, and leave it open."""
    trial = Trial(case, limit_s=max(LIMIT_S, stand.timeout_s) + SCHEDULING_S)
    _make_ready(stand)
    if case.at_opening:
        trial.limit_s = max(LIMIT_S, stand.opening_s) + SCHEDULING_S
        stand.driver.close()
    began = time.monotonic()
    stand.begin(case.kind, case.amount)
    try:
        _watch(trial, stand, began)
    finally:
        stand.end(case.kind)
    _judge(trial)
    _recover(trial, stand)
    return trial


def _make_ready(stand: Stand) -> None:
    """What the case before has left behind is not this one's."""
    try:
        stand.round()
    except (DeviceError, Noticed, Untruthful, Hung):
        stand.driver.close()
        _reopen(stand)
        stand.round()


def _watch(trial: Trial, stand: Stand, began: float) -> None:
    watch_s = trial.limit_s if trial.case.raises else WATCH_S
    while time.monotonic() - began < watch_s:
        try:
            if trial.case.at_opening:
                stand.driver.open()
            stand.round()
        except (DeviceError, Noticed) as error:
            trial.detected_s = time.monotonic() - began
            trial.kind, trial.sentence = type(error).__name__, str(error)
            if not isinstance(error, trial.case.raises):
                trial.problems.append(f"raised {trial.kind}")
            return
        except Untruthful as error:
            trial.sentence = str(error)
            if trial.case.after is not After.UNNOTICED:
                trial.problems.append(f"untruthful: {error}")
            return
        except Hung as error:
            if trial.case.after is not After.UNNOTICED:
                trial.problems.append(f"hung: {error}")
            return


def _judge(trial: Trial) -> None:
    if not trial.case.raises:
        if trial.detected_s is not None:
            trial.problems.append("was noticed though it should do no harm")
        return
    if trial.detected_s is None:
        if not trial.problems:
            trial.problems.append("was not noticed")
        return
    if trial.detected_s > trial.limit_s:
        trial.problems.append(f"noticed only after {trial.detected_s:.1f} s")
    if "\n" in trial.sentence or len(trial.sentence) > 500:
        trial.problems.append("not one sentence")
    # What happened, where, and what to do: "where: what; advice".
    if not re.fullmatch(r"[^;]+: .+; .+", trial.sentence):
        trial.problems.append(f"not 'where: what; advice': {trial.sentence!r}")


def _recover(trial: Trial, stand: Stand) -> None:
    case = trial.case
    if case.after is After.UNNOTICED:
        trial.after = case.after.value
        return
    if case.after is After.REOPENED:
        stand.driver.close()
        _reopen(stand)
    # The first rounds may still meet what the fault has left on the line.
    end = time.monotonic() + trial.limit_s
    while True:
        try:
            stand.round()
            trial.after = case.after.value
            return
        except (DeviceError, Noticed, Untruthful, Hung) as error:
            if time.monotonic() > end:
                trial.problems.append(f"does not work afterwards: {error}")
                return
            time.sleep(0.05)


def _reopen(stand: Stand) -> None:
    stand.reset()
    end = time.monotonic() + 5
    while True:
        try:
            stand.driver.open()
            return
        except DeviceError:
            if time.monotonic() > end:
                raise


def table(trials: Iterable[Trial]) -> str:
    """The matrix as a Markdown page."""
    lines = [
        "# What happens when a device fails",
        "",
        "Measured by `python -m benchmarks reliability.faults`, which also writes this page. Each driver works against",
        "a simulated device over its real wire (pseudo-terminal, TCP, PortAudio, processes); then the fault begins.",
        "",
        f"Limit: {LIMIT_S:g} s, or the driver's own time-out where that is longer. In a collect, a device that is",
        "lost, silent or incomprehensible pauses the run, which waits for it (`reconnect_wait_s`), opens it again and",
        "goes on from its last checkpoint; a device that refuses ends the run with the sentence given here. Records",
        "taken before the fault are on the disk in either case. Serial devices report no time, so no clock can jump.",
        "",
        "| device | fault | noticed after | as | sentence | afterwards |",
        "|---|---|---|---|---|---|",
    ]
    for trial in trials:
        case = trial.case
        noticed = "–" if trial.detected_s is None else f"{trial.detected_s:.1f} s"
        after = case.after.value + (f" ({case.note})" if case.note else "")
        sentence = "" if case.after is After.UNNOTICED else _plain(trial.sentence)
        verdict = "" if trial.ok else f" **not as documented: {'; '.join(trial.problems)}**"
        lines.append(f"| {case.device} | {case.fault} | {noticed} | {trial.kind} | {sentence} | {after}{verdict} |")
    return "\n".join([*lines, ""])


def combinations(page: str) -> list[str]:
    """The cases that a page lists, as :attr:`Case.key`."""
    rows = [line.split("|") for line in page.splitlines() if line.startswith("| ") and "| device |" not in line]
    return [f"{row[1].strip()}, {row[2].strip()}" for row in rows]


def _plain(sentence: str) -> str:
    """A sentence without what differs from machine to machine and from run to run."""
    sentence = re.sub(r"/tmp/[^ :;,']+|/dev/pts/\d+", "PORT", sentence)
    sentence = re.sub(r"127\.0\.0\.1:\d+", "127.0.0.1:PORT", sentence)
    sentence = re.sub(r"b(['\"]).*?\1(?=[),])", "BYTES", sentence)
    return sentence.replace("|", "\\|")
