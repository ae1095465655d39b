"""The G-code that the simulated GRBL understands: straight moves of one axis, and jogs."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

_WORD = re.compile(r"([A-Z])([-+]?(?:\d+\.?\d*|\.\d+))")
_MODAL_G = {0.0, 1.0, 20.0, 21.0, 53.0, 90.0, 91.0, 94.0}
_JOG_G = {20.0, 21.0, 53.0, 90.0, 91.0}


@dataclass(frozen=True)
class Motion:
    """A move that a block asks for."""

    value_mm: float
    frame: Literal["machine", "work", "relative"]
    """What ``value_mm`` is: a machine position, a work position, or a distance from the last target."""
    feed_mm_min: float
    """Infinite for a rapid move."""
    jog: bool = False


class Parser:
    """Reads one block after the other and remembers the modes in force."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Back to the modes after a start: absolute, millimetres, rapid, no feed."""
        self._absolute, self._millimetres, self._rapid, self._feed_mm_min = True, True, True, 0.0

    def block(self, line: str) -> int | Motion | None:
        """One block: GRBL's error number, the move that it asks for, or None when it only changes modes."""
        words = _words(line)
        if isinstance(words, int):
            return words
        modal, values = words
        if not modal <= _MODAL_G:
            return 20
        if {0.0, 1.0} <= modal or {90.0, 91.0} <= modal or {20.0, 21.0} <= modal:
            return 21
        return self._apply(modal, values)

    def jog(self, line: str) -> int | Motion:
        """What follows ``$J=``: modes hold for this line only, and the feed must be given."""
        words = _words(line)
        if isinstance(words, int):
            return words
        modal, values = words
        if not modal <= _JOG_G:
            return 16
        if "X" not in values:
            return 26
        if values.get("F", 0.0) <= 0:
            return 22
        millimetres, absolute = self._modes(modal)
        scale = 1.0 if millimetres else 25.4
        frame: Literal["machine", "work", "relative"] = (
            "machine" if 53.0 in modal else "work" if absolute else "relative"
        )
        return Motion(values["X"] * scale, frame, values["F"] * scale, jog=True)

    def _modes(self, modal: set[float]) -> tuple[bool, bool]:
        millimetres = 21.0 in modal or (self._millimetres and 20.0 not in modal)
        absolute = 90.0 in modal or (self._absolute and 91.0 not in modal)
        return millimetres, absolute

    def _apply(self, modal: set[float], values: dict[str, float]) -> int | Motion | None:
        millimetres, absolute = self._modes(modal)
        rapid = 0.0 in modal or (self._rapid and 1.0 not in modal)
        scale = 1.0 if millimetres else 25.4
        feed = values["F"] * scale if "F" in values else self._feed_mm_min
        if feed < 0:
            return 4
        if "X" in values and not rapid and feed == 0:
            return 22
        self._millimetres, self._absolute, self._rapid, self._feed_mm_min = millimetres, absolute, rapid, feed
        if "X" not in values:
            return None
        frame: Literal["machine", "work", "relative"] = (
            "machine" if 53.0 in modal else "work" if absolute else "relative"
        )
        return Motion(values["X"] * scale, frame, float("inf") if rapid else feed)


def _words(line: str) -> int | tuple[set[float], dict[str, float]]:
    words = _WORD.findall(line)
    if "".join(letter + number for letter, number in words) != line:
        return 2 if line[:1].isalpha() else 1
    if any(letter not in "GFX" for letter, _ in words):
        return 20
    values = {letter: float(number) for letter, number in words if letter in "FX"}
    if len(values) < sum(letter in "FX" for letter, _ in words):
        return 25
    return {float(number) for letter, number in words if letter == "G"}, values
