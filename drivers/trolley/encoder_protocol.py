"""What a microcontroller with a quadrature encoder says: about a hundred lines a second, each whole by itself.

``$ENC,<sequence>,<microseconds>,<count>,<index>*<checksum>`` and CR LF, where

- ``sequence`` counts lines, 0 to 255 and over again, so that lost lines are noticed;
- ``microseconds`` is the controller's clock when it read the counter, 32 bits without sign (wraps after 71.6 minutes);
- ``count`` is the counter, as many bits as it has, without sign (wraps);
- ``index`` is the counter's value at the last pass of the index mark, empty before the first;
- ``checksum`` is the exclusive or of all characters between ``$`` and ``*``, two hexadecimal digits (as in NMEA 0183).

The documentation of the drivers has a sketch for an Arduino that says so.
"""

from __future__ import annotations

import functools
import operator
import re
from dataclasses import dataclass

TIME_BITS = 32
SEQUENCE_BITS = 8

_LINE = re.compile(r"\$(ENC,(\d{1,3}),(\d{1,10}),(\d{1,10}),(\d{0,10}))\*([0-9A-F]{2})")


@dataclass(frozen=True)
class EncoderLine:
    """One line; all numbers as sent (wrapping)."""

    sequence: int
    micros: int
    count: int
    index: int | None


def parse_line(text: str) -> EncoderLine | None:
    """Read a line (without its ending); None when it is another one, or damaged."""
    match = _LINE.fullmatch(text)
    if match is None or int(match[6], 16) != checksum(match[1]):
        return None
    line = EncoderLine(int(match[2]), int(match[3]), int(match[4]), int(match[5]) if match[5] else None)
    return line if line.sequence < 1 << SEQUENCE_BITS and line.micros < 1 << TIME_BITS else None


def format_line(line: EncoderLine) -> str:
    """The line as it is sent, without its ending."""
    index = "" if line.index is None else str(line.index)
    body = f"ENC,{line.sequence},{line.micros},{line.count},{index}"
    return f"${body}*{checksum(body):02X}"


def checksum(body: str) -> int:
    """Exclusive or of all characters."""
    return functools.reduce(operator.xor, body.encode("ascii"), 0)


def unwrap(last: int, value: int, bits: int) -> int:
    """The number nearest to ``last`` that a counter of ``bits`` bits shows as ``value``."""
    half = 1 << (bits - 1)
    return last + (value - last + half) % (1 << bits) - half
