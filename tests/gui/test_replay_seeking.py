"""The time line of a replay: forwards it hurries, backwards it begins anew and goes there fast."""

from __future__ import annotations

from pathlib import Path
from typing import Self

import pytest
from PySide6.QtCore import Qt

from gui import workbench
from gui.main_window import MainWindow
from gui.pages.live_page import LivePage
from gui.widgets.status_strip import demo_status
from polfuse_lab.engine import ReplayClient
from polfuse_lab.live import LiveView


class Played(ReplayClient):
    """A replay's client that notes what it is asked for; there is no engine behind it."""

    made: list[Played] = []  # noqa: RUF012 - emptied by each test

    def __init__(self, session: Path, speed: float) -> None:
        self.session, self.speed = session, speed
        self.asked: list[str] = []
        self.made.append(self)

    @classmethod
    def play(cls, session: Path | str, *, speed: float = 1.0) -> Self:
        return cls(Path(session), speed)

    @property
    def directory(self) -> Path:
        return self.session.parent / f"engine-{self.made.index(self)}"

    def live(self) -> LiveView:
        return LiveView(self.directory)

    def poll(self, timeout_s: float = 0.2) -> None:
        return None

    def seek(self, step: int) -> None:
        self.asked.append(f"seek {step}")

    def set_speed(self, speed: float) -> None:
        self.asked.append(f"speed {speed:g}")

    def abort(self, reason: str = "") -> None:
        self.asked.append("abort")

    def close(self) -> None:
        self.asked.append("close")


def test_an_earlier_moment_of_a_replay_is_played_anew(
    qtbot, window: MainWindow, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(workbench, "ReplayClient", Played)
    Played.made.clear()
    page = window.page("live")
    assert isinstance(page, LivePage)
    bench, line = window.bench, page.replay.line
    bench.play(tmp_path / "s.h5", 2.0)
    qtbot.waitUntil(lambda: bench.engine.client is not None)
    assert window.current == "live"
    assert page.replay.isVisible()
    bench.engine.status.emit(demo_status(step=300, steps=600, position=30))
    assert line.value() == 300
    page.replay.speed.setValue(7.5)
    line.setFocus()
    qtbot.keyClick(line, Qt.Key.Key_PageUp)  # a twentieth of the time line forwards
    (first,) = Played.made
    assert first.asked == ["speed 7.5", "seek 330"]
    # Backwards: the old replay is stopped and left, and the same session begins at the speed that was chosen since.
    line.setValue(120)
    assert first.asked[2:] == ["abort", "close"]
    qtbot.waitUntil(lambda: bench.engine.client is not None and bench.engine.client is not first)
    _, again = Played.made
    assert (again.session, again.speed, again.asked) == (first.session, 7.5, ["seek 120"])
    assert page.replay.isVisible()
    assert page.replay.speed.value() == 7.5
    assert line.value() == 0  # until it is told how far it is
    bench.engine.status.emit(demo_status(step=120, steps=600, position=12))
    assert line.value() == 120
    # To the very beginning there is nothing to hurry through.
    qtbot.keyClick(line, Qt.Key.Key_Home)
    qtbot.waitUntil(lambda: len(Played.made) == 3 and bench.engine.client is Played.made[2])
    assert again.asked[1:] == ["abort", "close"]
    assert Played.made[2].asked == []
