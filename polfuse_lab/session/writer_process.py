"""The writer's own process: records come in on stdin, answers go out on stdout.

When stdin ends without a ``close`` message, the engine has died: the file is closed cleanly, as "engine lost".
"""

from __future__ import annotations

import contextlib
import os
import queue
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from polfuse_lab.errors import PolfuseError
from polfuse_lab.session import wire
from polfuse_lab.session.writer import SessionWriter

READ_AHEAD = 8
"""Messages that may wait inside this process, besides those in the pipe."""


def main() -> None:
    """Serve one session, then end the process without running HDF5's exit handlers (they may crash on a full disk)."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    wire.widen_pipe(0)
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    # Whatever a library prints must not get between the answers.
    os.dup2(2, 1)

    def answer(kind: str, **values: Any) -> None:
        try:
            answers.write(b"".join(wire.encode({"kind": kind, **values})))
        except OSError:
            return  # The engine has died; the end of stdin tells the rest.

    code = 0
    try:
        serve(answer)
    except PolfuseError as error:
        answer("error", what=error.what, where=error.where, advice=error.advice)
        code = 1
    except Exception as error:
        answer("error", what=f"the writer failed ({type(error).__name__}: {error})", where="writer", advice="report it")
        code = 1
    finally:
        sys.stderr.flush()
        os._exit(code)


def serve(answer: Any) -> None:
    """Read messages from stdin until the session is closed. Raises :class:`PolfuseError` when writing fails."""
    writer: SessionWriter | None = None
    try:
        for header, payload in _ahead(sys.stdin.buffer.read):
            kind = header["kind"]
            if kind == "create":
                writer = SessionWriter.create(
                    Path(header["path"]), wire.config_from(header["config"]), expected_bytes=header["expected_bytes"]
                )
                answer("created")
                continue
            if writer is None:
                raise PolfuseError("a record came before the session was created", where="writer", advice="report it")
            if kind == "flush":
                free = writer.flush(durable=header["durable"])
                answer("flushed", ticket=header["ticket"], free_bytes=free)
            elif kind == "close":
                path = writer.close(header["state"], header["reason"])
                answer("closed", path=str(path))
                return
            else:
                writer.write(wire.record_from(header, payload), plain=header.get("plain", False))
        if writer is not None:
            writer.close("engine lost", "the engine ended without closing the session")
    except Exception as error:
        if writer is not None:
            # What is wrong is told by the first error; a session that it has closed already stays as it is.
            with contextlib.suppress(PolfuseError):
                writer.close("failed", f"the writer failed ({error})")
        raise


def _ahead(read: Callable[[int], bytes]) -> Iterator[wire.Message]:
    """Messages, read in a thread of its own: the next one crosses the pipe while this one is compressed."""
    messages: queue.Queue[wire.Message | BaseException | None] = queue.Queue(READ_AHEAD)

    def work() -> None:
        try:
            while (message := wire.read_message(read)) is not None:
                messages.put(message)
        except Exception as error:
            messages.put(error)
        else:
            messages.put(None)

    threading.Thread(target=work, name="writer input", daemon=True).start()
    while (message := messages.get()) is not None:
        if isinstance(message, BaseException):
            raise message
        yield message


if __name__ == "__main__":
    main()
