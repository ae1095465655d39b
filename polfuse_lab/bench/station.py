"""One device in set-up mode: opened by itself, asked and looked at in a thread of its own, mended and tried again."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from drivers.errors import DeviceLost, DeviceRefused
from drivers.records import Channel
from polfuse_lab.bench.protocol import DeviceLight, Light
from polfuse_lab.doctor.devices import failed, who_answered
from polfuse_lab.doctor.findings import Finding
from polfuse_lab.live.feed import LiveFeed
from polfuse_lab.rig import Rig
from polfuse_lab.scheduler.control import Aborted, Control
from polfuse_lab.scheduler.devices import OPEN_S, Device, DeviceSet, make_device
from polfuse_lab.scheduler.prompts import Prompts

Result = TypeVar("Result")
AGAIN_S = 1.0
"""After a question that failed, the next one comes so much later, s."""


def light_of(finding: Finding) -> Light:
    """A finding's light: advice for what works is a warning."""
    return "bad" if not finding.ok else "warn" if finding.advice else "ok"


class Bench:
    """What all stations share.

    Args:
        rig: the rig.
        path: its file.
        feed: where records go for the live view.
        on_change: called when something is to be told.
    """

    def __init__(self, rig: Rig, path: Path, feed: LiveFeed, on_change: Callable[[], None]) -> None:
        self.rig, self.path, self.feed, self.on_change = rig, path, feed, on_change
        self.prompts = Prompts()
        self.camera_angle: Callable[[], tuple[float, float, bool]] = lambda: (0.0, 0.0, False)
        """Angle of the camera's polarizer, its standard deviation (rad), and whether it turns."""
        self.route: Callable[[], Channel] = lambda: Channel.HH
        """Where the switches stand, as far as is known."""
        self._refused: list[str] = []
        self._lock = threading.Lock()

    def refuse(self, why: str) -> None:
        """Something that was asked for is not done."""
        with self._lock:
            self._refused.append(why)
        self.on_change()

    def refused(self) -> list[str]:
        """What was refused since the last call."""
        with self._lock:
            told, self._refused = self._refused, []
            return told


class Station:
    """One device. :meth:`ask` and :meth:`retry` may be used from any thread; everything else goes on in its own."""

    LOOK_S = 0.5
    """How often the device is looked at, s."""

    def __init__(self, bench: Bench, kind: str) -> None:
        section = bench.rig.section(kind)
        assert section is not None
        self.bench, self.kind, self.driver = bench, kind, section.driver
        self.light = DeviceLight(kind, section.driver, "busy", "is being opened")
        self.made: Device | None = None
        """The device, while it is open (or being opened)."""
        self._commands: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._control = Control()
        self._thread = threading.Thread(target=self._work, name=f"bench {kind}", daemon=True)

    def start(self) -> None:
        """Open the device and begin to look at it; returns at once."""
        self._thread.start()

    def ask(self, command: Callable[[], None], *, first: bool = False) -> None:
        """Have something done in the station's thread; ``first``: at once, and nothing that was asked before it."""
        if first:
            while not self._commands.empty():
                self._commands.get()
        self._commands.put(command)

    def retry(self) -> None:
        """Close the device and open it again."""
        self.ask(self._reopen)

    def halt(self) -> None:
        """Ask nothing more of the device; whoever closes it comes next."""
        self._control.abort("set-up mode ends")
        self._thread.join(1.0)

    @property
    def moving(self) -> bool:
        """Whether something moves."""
        return False

    def stop(self) -> None:
        """Stop what moves. Any thread."""

    # -- for the kinds of devices -------------------------------------------------------------------------------------

    def opened(self) -> None:
        """The device has been opened. Raises :class:`DeviceError`."""

    def look(self) -> None:
        """Ask the device how it is. Raises :class:`DeviceError`."""

    def closed(self) -> None:
        """The device is no longer open. Never raises."""

    def call(self, function: Callable[..., Result], *args: Any, timeout_s: float = 3.0) -> Result:
        """Make one call of the device. Raises :class:`DeviceError`, :class:`Aborted`."""
        made = self.made
        if made is None or made.identity is None:
            raise DeviceRefused("is not open", where=f"{self.kind} ({self.driver})", advice="try it again first")
        return DeviceSet(self._control, {self.kind: made}).call(self.kind, function, *args, timeout_s=timeout_s)

    def tell(self, finding: Finding) -> None:
        """Set the light by a finding."""
        identity = "" if self.made is None or self.made.identity is None else self.made.identity.name
        by_hand = self.made is not None and self.made.by_hand
        light = DeviceLight(
            self.kind, self.driver, light_of(finding), finding.detail, finding.advice, identity, by_hand
        )  # fmt: skip
        if light != self.light:
            self.light = light
            self.bench.on_change()

    # -- the thread ---------------------------------------------------------------------------------------------------

    def _work(self) -> None:
        try:
            self._open()
            due = 0.0
            while True:
                try:
                    self._commands_until(due)
                    due = time.monotonic() + self.LOOK_S
                    if self.made is not None:
                        self.look()
                        if self.light.light == "bad" and self.kind != "radar":
                            self._well()
                except DeviceRefused as error:
                    self.bench.refuse(str(error))
                except Aborted:
                    return
                except Exception as error:  # also a defect of a driver: it can be tried again
                    self._trouble(error)
                    due = time.monotonic() + AGAIN_S
        except Aborted:
            return

    def _commands_until(self, due: float) -> None:
        """Do what is asked until it is time to look. Raises as the commands do."""
        while True:
            self._control.check()
            wait = due - time.monotonic()
            try:
                command = self._commands.get(timeout=min(max(wait, 0.001), 0.02))
            except queue.Empty:
                if wait <= 0:
                    return
                continue
            command()

    def _open(self) -> None:
        self.light = msgspec.structs.replace(self.light, light="busy", what="is being opened", mend="", identity="")
        self.bench.on_change()
        try:
            self.made = make_device(self.bench.rig, self.kind, self.bench.path, self.bench.prompts)
            opening = self.made.lane.submit(self.made.open)
            self._control.wait_for(opening, OPEN_S, "open", f"{self.kind} ({self.driver})")
            opening.result()
            self._well()
            self.opened()
        except Aborted:
            raise
        except Exception as error:
            self._trouble(error)
            self._shut()

    def _reopen(self) -> None:
        self._shut()
        self._open()

    def _shut(self) -> None:
        made, self.made = self.made, None
        if made is not None:
            self.closed()
            DeviceSet(Control(), {self.kind: made}).close_all()

    def _well(self) -> None:
        assert self.made is not None
        detail = "operated by hand" if self.made.by_hand else who_answered(self.made)
        self.tell(Finding(self.driver, self.kind, True, detail, ""))

    def _trouble(self, error: Exception) -> None:
        self.tell(failed(self.kind, self.driver, error))
        if isinstance(error, DeviceLost):
            self._shut()
            self.light = msgspec.structs.replace(self.light, identity="")
