"""All streams of one engine: the board that the live process writes, and the view that clients read."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from polfuse_lab.live.ring import Array, RingReader, RingWriter, Shown, generations, ring_path, supersede

FOLDER = "live"
"""Folder of the rings inside an engine's private directory."""


class Board:
    """The writing end of all streams. Each stream is used by one thread at a time.

    Args:
        directory: the engine's private directory.
    """

    def __init__(self, directory: Path) -> None:
        self._folder = directory / FOLDER
        self._folder.mkdir(mode=0o700, exist_ok=True)
        self._rings: dict[str, RingWriter] = {}

    def put(
        self,
        stream: str,
        arrays: Mapping[str, Array],
        *,
        t_sample_ns: int,
        units: Mapping[str, str] | None = None,
        values: Mapping[str, Any] | None = None,
        slots: int = 4,
    ) -> int:
        """Make an item readable for every client; a stream begins with its first item.

        Args:
            stream: name: letters, digits, ``.``, ``_`` and ``-``.
            arrays: by name, any dtype and shape.
            t_sample_ns: when the newest sample in it arrived (``time.monotonic_ns``).
            units: of arrays and values.
            values: single numbers and words.
            slots: items kept, as of the stream's first item.

        Returns:
            The item's number.

        Raises:
            OSError: no room for the stream's memory.
        """
        size = sum(-(-array.nbytes // 64) * 64 for array in arrays.values())
        ring = self._rings.get(stream)
        if ring is None or ring.payload_bytes < size:
            last = generations(self._folder, stream).get(stream, 0)
            before = ring_path(self._folder, stream, last)
            # The ring of a live process that has died is gone on with.
            first = (supersede(before) if ring is None else ring.number) + 1
            self._rings[stream] = RingWriter(ring_path(self._folder, stream, last + 1), size, slots, first)
            if ring is not None:
                ring.retire()
                ring.close()
            with contextlib.suppress(OSError):
                before.unlink()  # where readers do not keep it; else it goes with the engine's directory
        return self._rings[stream].put(arrays, units or {}, values or {}, t_sample_ns)

    def close(self) -> None:
        """Let go of all memory; the files stay until the engine's directory is removed. Idempotent."""
        for ring in self._rings.values():
            ring.retire()
            ring.close()
        self._rings.clear()


class LiveView:
    """What a client sees of a running engine: the newest items of every stream. Thread-safe; never blocks the engine.

    Streams come and go: one that is not there (yet) has no items. See ``docs/architecture.md`` for their names.

    Args:
        directory: the engine's private directory (:attr:`polfuse_lab.engine.EngineClient.directory`).
    """

    def __init__(self, directory: Path) -> None:
        self._folder = Path(directory) / FOLDER
        self._readers: dict[str, RingReader] = {}
        self._lock = threading.Lock()

    def streams(self) -> tuple[str, ...]:
        """Names of the streams that there are, sorted."""
        return tuple(sorted(generations(self._folder)))

    def newest(self, stream: str, *, after: int = 0) -> Shown | None:
        """The newest item; None where there is none with a number above ``after``. Cheap when nothing is new."""
        with self._lock:
            for _ in range(4):
                reader = self._reader(stream)
                if reader is None:
                    return None
                number = reader.newest_number
                if number <= after or number == 0:
                    return None
                item = reader.get(number)
                if item is not None:
                    return item
        return None

    def since(self, stream: str, after: int, *, most: int = 10_000) -> list[Shown]:
        """Items with numbers above ``after`` that are still kept, oldest first; ``most`` of them, the newest."""
        found = []
        with self._lock:
            reader = self._reader(stream)
            if reader is None:
                return []
            newest = reader.newest_number
            # The slot after the newest one is the next to be written.
            oldest = max(after + 1, newest - reader.slots + 2, newest - most + 1, 1)
            for number in range(oldest, newest + 1):
                item = reader.get(number)
                if item is not None:
                    found.append(item)
        return found

    def close(self) -> None:
        """Let go of all memory. Idempotent."""
        with self._lock:
            for reader in self._readers.values():
                reader.close()
            self._readers.clear()

    def __enter__(self) -> LiveView:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _reader(self, stream: str) -> RingReader | None:
        reader = self._readers.get(stream)
        if reader is None or reader.retired:
            # Where nothing has taken its place, the last items of an engine that has ended stay.
            with contextlib.suppress(OSError, ValueError, KeyError):
                generation = generations(self._folder, stream)[stream]
                fresh = RingReader(ring_path(self._folder, stream, generation))
                if reader is not None:
                    reader.close()
                reader = self._readers[stream] = fresh
        return reader
