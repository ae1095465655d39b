"""How often each switch has been actuated: these switches wear, so the count outlives the session.

One small JSON file per unit in the user's data folder, ``switch-cycles/NAME-xxxxxxxx.json``::

    {"unit": "MS-2T 4711", "cycles": {"1": 20154, "2": 20160}}

Each actuation replaces the file as a whole, so that a program killed at any moment leaves a whole file with at most the
actuation under way not counted. After a switch has been replaced, edit its number in the file.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import threading
import time
from collections.abc import Iterator
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows: its serial ports are exclusive anyway.
    fcntl = None  # type: ignore[assignment]

SUBFOLDER = "switch-cycles"
_LOCK_S = 0.2


class CycleCounter:
    """Counts the actuations of one unit's switches. Thread-safe; several processes may count the same unit.

    Trouble with the disk never stops a measurement: it is kept in :attr:`trouble`, and the counts of this session go on
    in memory until they can be written.

    Args:
        unit: the unit's identity, such as its serial number.
        folder: where the subfolder ``switch-cycles`` is (made when first needed).
    """

    def __init__(self, unit: str, folder: Path) -> None:
        slug = re.sub(r"[^A-Za-z0-9]+", "-", unit).strip("-")[:40] or "unit"
        digest = hashlib.sha256(unit.encode()).hexdigest()[:8]
        self.path = folder / SUBFOLDER / f"{slug}-{digest}.json"
        """The unit's file."""
        self.trouble: str | None = None
        """What went wrong last with the file, None when nothing did."""
        self._unit = unit
        self._unwritten: dict[str, int] = {}
        self._lock = threading.Lock()

    def count(self, switch: str) -> None:
        """Add one actuation of a switch. Never raises."""
        with self._lock:
            self._unwritten[switch] = self._unwritten.get(switch, 0) + 1
            try:
                with self._alone():
                    cycles = self._added(self._read())
                    self._replace(cycles, durable=False)
                self._unwritten.clear()
            except OSError as error:
                self.trouble = f"the cycle counter {self.path} cannot be written ({error.strerror or error})"

    def cycles(self) -> dict[str, int]:
        """Actuations of each switch that was ever actuated. Never raises."""
        with self._lock:
            return self._added(self._read())

    def close(self) -> None:
        """Bring the counts to the disk itself, so that they survive a loss of power. Never raises."""
        with self._lock, contextlib.suppress(OSError):
            if not self.path.exists() and not self._unwritten:
                return
            with self._alone():
                self._replace(self._added(self._read()), durable=True)
            self._unwritten.clear()

    @property
    def _backup(self) -> Path:
        return self.path.with_suffix(".bak")

    def _added(self, cycles: dict[str, int]) -> dict[str, int]:
        return cycles | {name: cycles.get(name, 0) + more for name, more in self._unwritten.items()}

    def _read(self) -> dict[str, int]:
        for path in (self.path, self._backup):
            try:
                found = json.loads(path.read_text(encoding="utf-8"))
                return {str(name): _whole(number) for name, number in found["cycles"].items()}
            except FileNotFoundError:
                continue
            except (OSError, ValueError, KeyError, TypeError, AttributeError):
                # After a loss of power the newest file may be empty: the one closed last is whole.
                self.trouble = f"the cycle counter {path} is damaged; mend or remove it"
        return {}

    def _replace(self, cycles: dict[str, int], *, durable: bool) -> None:
        text = json.dumps({"unit": self._unit, "cycles": dict(sorted(cycles.items()))}) + "\n"
        for path in (self.path, self._backup) if durable else (self.path,):
            unfinished = path.with_name(f"{path.name}.{os.getpid()}.new")
            with open(unfinished, "w", encoding="utf-8") as file:
                file.write(text)
                if durable:
                    file.flush()
                    os.fsync(file.fileno())
            unfinished.replace(path)

    @contextlib.contextmanager
    def _alone(self) -> Iterator[None]:
        """Keep other processes from counting between our reading and our writing."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with open(self.path.with_suffix(".lock"), "w") as lock:
            end_s = time.monotonic() + _LOCK_S
            while fcntl is not None:
                try:
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    break
                except BlockingIOError:
                    if time.monotonic() > end_s:
                        raise
                    time.sleep(0.001)
            yield


def _whole(number: object) -> int:
    if not isinstance(number, int) or number < 0:
        raise ValueError(number)
    return number
