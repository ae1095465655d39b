"""How a Mini-Circuits RC switch box is reached: one question, one short answer, over HTTP or Telnet.

Over HTTP the question is the path (``GET /SWPORT?``) and the answer the body; over Telnet both are lines that end
CR LF. No call takes longer than its time-out, however slowly the box talks.
"""

from __future__ import annotations

import contextlib
import http.client
import io
import re
import socket
import time
from collections.abc import Iterator
from typing import Any, Protocol

from drivers.errors import DeviceBadAnswer, DeviceLost, DeviceTimeout
from drivers.transport import SerialLine

_LONGEST_ANSWER = 200


class Link(Protocol):
    """A way to ask the box."""

    where: str
    """The box, for messages."""

    def open(self) -> None:
        """Connect. Raises DeviceLost."""

    def ask(self, question: str) -> str:
        """One exchange. Raises DeviceLost, DeviceTimeout, DeviceBadAnswer."""

    def close(self) -> None:
        """Hang up. Idempotent; never raises."""

    @property
    def is_open(self) -> bool:
        """Whether it has been opened."""


class TelnetLink:
    """A Telnet connection, held open; the box takes one at a time.

    Args:
        host: address of the box.
        port: 23 unless the box has been told otherwise.
        timeout_s: time for an answer, s.
    """

    def __init__(self, host: str, port: int, timeout_s: float) -> None:
        self._line = SerialLine(
            f"socket://{_bracketed(host)}:{port}", baud=9600, name="Mini-Circuits switches", timeout_s=timeout_s
        )
        self.where = self._line.where

    def open(self) -> None:
        """Connect, and forget the greeting."""
        self._line.open()
        time.sleep(0.05)
        self._line.drain()

    def ask(self, question: str) -> str:
        """One line there, one line back."""
        return self._line.ask(question.encode("ascii") + b"\r\n")

    def close(self) -> None:
        """Hang up."""
        self._line.close()

    @property
    def is_open(self) -> bool:
        """Whether the connection is held."""
        return self._line.is_open


class HttpLink:
    """A connection for each question, as the box's small web server wants it. Proxies are not used.

    Args:
        host: address of the box.
        port: 80 unless the box has been told otherwise.
        timeout_s: time for connecting and answering together, s.
    """

    def __init__(self, host: str, port: int, timeout_s: float) -> None:
        self.where = f"Mini-Circuits switches on http://{_bracketed(host)}:{port}"
        self.is_open = False
        self._address = (host, port)
        self._timeout_s = timeout_s

    def open(self) -> None:
        """Nothing is held open; the first question shows whether the box is there."""
        self.is_open = True

    def close(self) -> None:
        """Nothing is held open."""
        self.is_open = False

    def ask(self, question: str) -> str:
        """One GET. Raises DeviceLost also when closed."""
        if not self.is_open:
            raise DeviceLost("the box is not open", where=self.where, advice="open the device (again)")
        deadline_s = time.monotonic() + self._timeout_s
        with self._failures(), socket.create_connection(self._address, timeout=self._timeout_s) as connection:
            request = f"GET /{question} HTTP/1.0\r\nHost: {self._address[0]}\r\nConnection: close\r\n\r\n"
            connection.sendall(request.encode("ascii"))
            reader = io.BufferedReader(_Timed(connection, deadline_s))
            response = http.client.HTTPResponse(_Opened(reader))  # type: ignore[arg-type]
            response.begin()
            body = response.read(_LONGEST_ANSWER + 1)
            status = response.status
            # A process that another thread starts just now holds a copy: closing alone would not hang up, and the box
            # takes one connection at a time.
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
        if status != http.client.OK:
            raise self._bad(body, f"refused {question!r} with HTTP status {status}")
        answer = body.decode("ascii", "replace").strip()
        if len(body) > _LONGEST_ANSWER or not re.fullmatch(r"[ -~]+", answer):
            raise self._bad(body, f"answered {question!r} with something else than a line of text")
        return answer

    @contextlib.contextmanager
    def _failures(self) -> Iterator[None]:
        try:
            yield
        except TimeoutError as error:
            raise DeviceTimeout(
                f"no answer within {self._timeout_s:g} s",
                where=self.where,
                advice="check that the box is on, its address, and that both are in one network",
            ) from error
        except (http.client.HTTPException, ValueError) as error:
            raise DeviceBadAnswer(
                f"does not speak HTTP ({type(error).__name__})",
                where=self.where,
                advice="check the address, or choose connection = 'telnet'",
            ) from error
        except OSError as error:
            raise DeviceLost(
                f"cannot be reached ({error.strerror or error})",
                where=self.where,
                advice="check power, network cable and address of the box",
            ) from error

    def _bad(self, body: bytes, what: str) -> DeviceBadAnswer:
        return DeviceBadAnswer(
            f"{what} ({body[:40]!r})", where=self.where, advice="check that a Mini-Circuits RC box has this address"
        )


class _Timed(io.RawIOBase):
    """A socket's bytes until a deadline, however few come at a time."""

    def __init__(self, connection: socket.socket, deadline_s: float) -> None:
        self._connection = connection
        self._deadline_s = deadline_s

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        left_s = self._deadline_s - time.monotonic()
        if left_s <= 0:
            raise TimeoutError
        self._connection.settimeout(left_s)
        return self._connection.recv_into(buffer)


class _Opened:
    """What :class:`http.client.HTTPResponse` wants of a socket."""

    def __init__(self, reader: io.BufferedReader) -> None:
        self._reader = reader

    def makefile(self, mode: str) -> io.BufferedReader:
        return self._reader


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host
