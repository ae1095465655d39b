"""Start set-up mode, or attach to it; look at the devices and ask things of them."""

from __future__ import annotations

import contextlib
import subprocess
import time
from pathlib import Path

import msgspec
import zmq

from polfuse_lab.bench import protocol as bench
from polfuse_lab.bench.protocol import BenchClosed, BenchStatus
from polfuse_lab.engine import EngineClient, engines
from polfuse_lab.engine import protocol as engine
from polfuse_lab.engine.claims import refuse_held
from polfuse_lab.engine.link import Link
from polfuse_lab.errors import PolfuseError
from polfuse_lab.plans import Plan
from polfuse_lab.rig import load_rig

SHUT_S = 20.0
"""Longest that the end of set-up mode is waited for, s: a camera may take long to close."""


class BenchClient(Link):
    """One client of set-up mode. Not thread-safe.

    Poll it at least once a second: a trolley that moves is stopped when its client has not been heard for two seconds,
    and five seconds after the last client has gone everything is made safe and closed.
    """

    PING_S = 0.5
    LOST_ADVICE = "its guard makes switches and trolley safe; start set-up mode again"

    def __init__(self, directory: Path, process: subprocess.Popen[bytes] | None = None) -> None:
        super().__init__(directory, process)
        self.status: BenchStatus | None = None
        """The newest status."""
        self.closed: BenchClosed | None = None
        """How it ended, once it has."""
        self.rig_path: Path | None = None
        self._refused: list[str] = []

    @classmethod
    def start(cls, rig_path: Path | str) -> BenchClient:
        """Start set-up mode with a rig and attach to it.

        Raises:
            PolfuseError: the rig file is wrong, another engine holds one of its devices, or the engine does not start.
        """
        rig_path = Path(rig_path).resolve()
        rig = load_rig(rig_path)
        refuse_held(rig)
        client = cls._launch(
            engine.Request(
                rig_path=str(rig_path),
                rig_toml=rig_path.read_text(encoding="utf-8"),
                plan_path="",
                plan_toml="",
                output="",
                token="",
                transport="",
                mode="bench",
            )
        )
        client.rig_path = rig_path
        return client

    def poll(self, timeout_s: float = 0.2) -> BenchStatus | BenchClosed | None:
        """Wait for the next word of set-up mode; the newest of several. None when there was none in time.

        Raises:
            PolfuseError: its process has ended without a word.
        """
        self._ping()
        newest: BenchStatus | BenchClosed | None = None
        wait = int(timeout_s * 1000)
        refused: list[str] = []
        while not isinstance(newest, BenchClosed):
            content = self._next(0 if newest is not None else wait)
            if content is None:
                break
            wait = 0
            message = bench.decode_engine(content)
            if isinstance(message, engine.Refused):
                self._refused.append(message.reason)
                continue
            newest = message
            if isinstance(message, BenchStatus):
                refused += message.refused
        if isinstance(newest, BenchStatus):
            # Of several statuses the newest counts, but no refusal is lost.
            told, self._refused = [*self._refused, *refused], []
            newest = self.status = _with_refused(newest, told)
        elif isinstance(newest, BenchClosed):
            self.closed, self._ended = newest, True
            with contextlib.suppress(zmq.ZMQError):
                self._send(engine.Detach())
        else:
            self._require_engine()
        return newest

    def retry(self, kind: str) -> None:
        """Close a device and open it again."""
        self._send(bench.Retry(kind))

    def move_to(self, x_m: float) -> None:
        """Move the trolley to a place, m; refused beyond its limits."""
        self._send(bench.MoveTo(x_m))

    def jog(self, by_m: float) -> None:
        """Move the trolley by some metres; it goes no further than its limits."""
        self._send(bench.Jog(by_m))

    def stop(self) -> None:
        """Stop trolley and polarizers, now."""
        self._send(bench.Stop())

    def select(self, channel: str) -> None:
        """Switch to ``"HH"``, ``"HV"``, ``"VH"`` or ``"VV"``."""
        if channel not in ("HH", "HV", "VH", "VV"):
            raise PolfuseError(f"there is no channel {channel!r}", where="switches", advice="choose HH, HV, VH or VV")
        self._send(bench.Select(channel))  # type: ignore[arg-type]

    def turn(self, angle_deg: float) -> None:
        """Turn the camera's polarizer, degrees from horizontal."""
        self._send(bench.Turn(angle_deg))

    def turn_source(self, angle_deg: float) -> None:
        """Turn the light source's polarizer, degrees from horizontal."""
        self._send(bench.Turn(angle_deg, "source_polarizer"))

    def expose(self, exposure_s: float) -> None:
        """Expose so long from the next frame on, s."""
        self._send(bench.SetExposure(exposure_s))

    def auto_expose(self) -> None:
        """Look for an exposure that does not saturate at the present angle."""
        self._send(bench.FindExposure())

    def camera(self, *, running: bool) -> None:
        """Take frame after frame (as at the beginning), or none."""
        self._send(bench.RunCamera(running))

    def answer(self, ticket: int) -> None:
        """Confirm a prompt."""
        self._send(bench.Reply(ticket))

    def close(self) -> None:
        """Leave; set-up mode ends when nobody is left, with everything safe and closed. Idempotent; does not wait."""
        super().close()

    def shut(self, timeout_s: float = SHUT_S) -> BenchClosed:
        """End set-up mode and wait until everything is safe and closed.

        Raises:
            PolfuseError: it does not end in time, or its process died.
        """
        self._send(bench.Close())
        end = time.monotonic() + timeout_s
        while self.closed is None:
            self.poll(0.05)
            if time.monotonic() > end:
                raise PolfuseError(
                    f"set-up mode has not ended within {timeout_s:g} s",
                    where=f"engine (process {self.pid})",
                    advice="see which device hangs; ending the process makes its guard take over",
                )
        # The devices are free when it says so; its directory goes with its process.
        while self.directory.exists() and time.monotonic() < end:
            time.sleep(0.01)
        self.close()
        return self.closed

    def hand_over(self, plan: Path | str | Plan, output: Path | str) -> EngineClient:
        """End set-up mode and begin a collect with the same rig file.

        Raises:
            PolfuseError: as :meth:`shut`, and as :meth:`polfuse_lab.engine.EngineClient.start`.
        """
        if self.rig_path is None:
            known = next((item for item in engines() if item.directory == self.directory), None)
            if known is None:
                raise PolfuseError("its rig file is not known", where="set-up mode", advice="start the collect by hand")
            self.rig_path = Path(known.rig_path)
        self.shut()
        return EngineClient.start(self.rig_path, plan, output)


def _with_refused(status: BenchStatus, refused: list[str]) -> BenchStatus:
    return msgspec.structs.replace(status, refused=refused)
