"""Each widget as a user sees and uses it."""

from __future__ import annotations

import threading

import numpy as np
import pytest
import shiboken6
from PySide6.QtCore import QObject, QPointF, Qt
from PySide6.QtGui import QGuiApplication, QImage
from PySide6.QtWidgets import QApplication, QVBoxLayout, QWidget

from gui import maps, theme
from gui.models import background
from gui.models.cursor import LinkedCursor
from gui.models.words import duration, size
from gui.saving import save_view
from gui.widgets.device_card import DeviceCard
from gui.widgets.error_bar import ErrorBar
from gui.widgets.level_meter import LevelMeter
from gui.widgets.picture_view import PictureView, Quantity, demo_image
from gui.widgets.profile_view import ProfileView, demo_profile
from gui.widgets.progress_grid import ProgressGrid
from gui.widgets.prompt_bar import PromptBar
from gui.widgets.status_strip import StatusStrip, demo_status
from gui.widgets.waterfall_view import WaterfallView
from polfuse_lab.errors import PolfuseError


def pixels(widget: QWidget) -> np.ndarray:
    image = widget.grab().toImage().convertToFormat(QImage.Format.Format_RGB888)
    rows = np.frombuffer(image.constBits(), np.uint8).reshape(image.height(), image.bytesPerLine())
    return rows[:, : image.width() * 3].reshape(image.height(), image.width(), 3).copy()


def shown(qtbot, widget: QWidget, width: int = 600, height: int = 400) -> QWidget:
    qtbot.addWidget(widget)
    widget.resize(width, height)
    widget.show()
    qtbot.waitExposed(widget)
    return widget


def luminance(colour: str) -> float:
    """Relative luminance of WCAG 2.1."""
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("name", list(theme.ThemeName))
def test_letters_can_be_read_on_every_ground(name: theme.ThemeName) -> None:
    # WCAG 2.1: 7 : 1 for text (AAA), 4.5 : 1 for what explains (AA), 3 : 1 for signs and lines.
    shown = theme.THEMES[name]

    def contrast(a: str, b: str) -> float:
        high, low = sorted((luminance(a), luminance(b)), reverse=True)
        return (high + 0.05) / (low + 0.05)

    for ground in (shown.window, shown.panel, shown.raised):
        assert contrast(shown.text, ground) >= 7
    for ground in (shown.window, shown.panel):
        assert contrast(shown.dim, ground) >= 4.5
        for colour in (shown.ok, shown.warning, shown.bad, shown.accent, *shown.curves):
            assert contrast(colour, ground) >= 3
    assert contrast(shown.on_accent, shown.accent) >= 4.5


def test_a_meter_tells_its_level_and_remembers_clipping(qtbot) -> None:
    meter = shown(qtbot, LevelMeter("beat"), 400, 60)
    assert meter.text() == "nothing"
    meter.show_level(0.1, 0.05)
    assert meter.text() == "-20.0 dBFS"  # 20 log10(0.1)
    assert not meter.clipped
    meter.show_level(1.0, 0.5)
    meter.show_level(0.1, 0.05)
    assert meter.clipped
    lamp = pixels(meter)[:, -8:].reshape(-1, 3)
    red = tuple(int(theme.current().bad[i : i + 2], 16) for i in (1, 3, 5))
    assert (np.abs(lamp.astype(int) - red).max(axis=1) < 8).any()


def test_an_error_is_told_copied_and_put_away(qtbot) -> None:
    bar = shown(qtbot, ErrorBar(), 700, 70)
    bar.tell("the trolley does not answer", "Traceback: …")
    assert bar.isVisible()
    assert bar.text == "the trolley does not answer"
    qtbot.mouseClick(bar.copy_button, Qt.MouseButton.LeftButton)
    assert QGuiApplication.clipboard().text() == "Traceback: …"
    with qtbot.waitSignal(bar.dismissed):
        qtbot.mouseClick(bar.close_button, Qt.MouseButton.LeftButton)
    assert not bar.isVisible()


def test_a_bad_device_says_how_to_mend_it_and_can_be_tried_again(qtbot) -> None:
    card = shown(qtbot, DeviceCard("trolley", "Trolley"), 500, 120)
    card.show_state("ok", "GRBL 1.1h")
    assert not card.retry_button.isVisible()
    card.show_state("bad", "nobody answers", "check its cable")
    assert card.words == "nobody answers check its cable"
    with qtbot.waitSignal(card.retry) as told:
        qtbot.mouseClick(card.retry_button, Qt.MouseButton.LeftButton)
    assert told.args == ["trolley"]


@pytest.mark.parametrize("key", [Qt.Key.Key_Return, Qt.Key.Key_PageDown])
def test_a_prompt_is_confirmed_once_by_keyboard_or_clicker(qtbot, key: Qt.Key) -> None:
    window = QWidget()
    bar = PromptBar()
    QVBoxLayout(window).addWidget(bar)
    answers: list[int] = []
    bar.confirmed.connect(answers.append)
    bar.show_prompts([(7, "Push the trolley"), (8, "and then")])
    with qtbot.waitActive(window):
        shown(qtbot, window, 800, 120)
        window.activateWindow()
    qtbot.keyClick(window, key)
    qtbot.keyClick(window, key)  # the answer is on its way: not given twice
    assert answers == [7]
    bar.show_prompts([(8, "and then")])
    assert bar.text == "and then"
    qtbot.keyClick(window, key)
    assert answers == [7, 8]
    bar.show_prompts([])
    qtbot.keyClick(window, key)
    assert answers == [7, 8]
    assert not bar.isVisible()


def test_the_strip_tells_loss_and_a_full_disk(qtbot) -> None:
    strip = shown(qtbot, StatusStrip(), 900, 40)
    strip.show_status(demo_status())
    assert strip.text("loss") == "nothing lost"
    assert strip.text("disk") == "81.2 GB free"
    assert strip.text("position") == "position 19 of 61"
    strip.show_status(demo_status(samples_lost=480, disk_free_bytes=100_000_000))
    assert strip.text("loss") == "lost: 480 samples, 0 frames"
    strip.show_idle()
    assert strip.text("state") == "No collect is running"


def test_the_grid_shows_what_is_recorded(qtbot) -> None:
    grid = shown(qtbot, ProgressGrid(), 600, 100)
    grid.begin(5, ("HH", "HV"))
    grid.mark(0, "HH", "now")
    grid.mark(0, "HV", "now")
    assert (grid.state(0, "HH"), grid.state(0, "HV"), grid.state(1, "HH")) == ("done", "now", "open")
    grid.mark(0, "HV", "flagged")
    grid.finish()
    assert grid.state(0, "HV") == "flagged"


def test_a_profile_reads_out_range_and_level(qtbot) -> None:
    view = shown(qtbot, ProfileView())
    profile = demo_profile(1)
    view.show_profile("HH", 0.47, profile)
    # 7.05 m is the fifteenth bin.
    assert view.describe(7.05, -30) == f"range 7.05 m   HH {profile[15]:.1f} dBFS"
    assert view.describe(1e4, -30) == "range 10000.00 m"


def test_a_picture_shows_each_value_at_its_place_and_grey_where_there_is_none(qtbot) -> None:
    view = shown(qtbot, PictureView(Quantity("level", "dB", low=-45.0, high=0.0)), 620, 620)
    values, x, y = demo_image()
    view.show_values(values, x, y, sd=np.full(values.shape, 0.3, np.float32))
    row, column = 67, 67  # x = -1.98 m, y = 8.03 m
    words = view.describe(float(x[column]), float(y[row]))
    assert words == f"x {x[column]:.2f} m, y {y[row]:.2f} m   level {values[row, column]:.1f} ± 0.3 dB"
    assert "undefined" in view.describe(5.9, 2.1)
    # The pixel on the screen has the map's colour for that value.
    place = view.item.vb.mapViewToScene(QPointF(float(x[column]), float(y[row])))
    on_screen = pixels(view)[round(place.y()), round(place.x())]
    entry = maps.lookup(maps.SEQUENTIAL)[int(np.clip((values[row, column] + 45) / 45, 0, 1) * 255)]
    assert np.abs(on_screen.astype(int) - entry).max() <= 6
    hole = view.item.vb.mapViewToScene(QPointF(5.5, 2.5))
    assert tuple(pixels(view)[round(hole.y()), round(hole.x())]) == (0x8A, 0x8A, 0x8A)


def test_saturated_pixels_are_red(qtbot) -> None:
    view = shown(qtbot, PictureView(Quantity("S0", "counts", "gray"), ground=False), 620, 620)
    image = np.full((60, 80), 1000.0, np.float32)
    marked = np.zeros(image.shape, bool)
    marked[10:20, 30:40] = True
    view.show_values(image, limits=(0.0, 4095.0), marked=marked)
    at = view.item.vb.mapViewToScene(QPointF(35, 15))
    assert tuple(pixels(view)[round(at.y()), round(at.x())]) == (255, 40, 40)
    view.show_values(image, limits=(0.0, 4095.0))
    assert tuple(pixels(view)[round(at.y()), round(at.x())]) != (255, 40, 40)


def test_a_cursor_is_shared(qtbot) -> None:
    cursor = LinkedCursor()
    views = [shown(qtbot, PictureView(Quantity("level", "dB")), 300, 300) for _ in range(2)]
    for view in views:
        view.show_values(*demo_image())
        view.follow(cursor)
    views[0].pointed.emit((-2.0, 8.0))
    assert cursor.place == (-2.0, 8.0)
    assert views[0].readout.text() == views[1].readout.text() != " "
    views[1].pointed.emit(None)
    assert views[0].readout.text() == " "


def test_what_is_frozen_stays(qtbot) -> None:
    view = shown(qtbot, PictureView(Quantity("level", "dB", low=0.0, high=1.0)), 300, 300)
    view.show_values(np.zeros((4, 4), np.float32))
    view.freeze(True)
    view.show_values(np.ones((4, 4), np.float32))
    assert "level 0.0" in view.describe(1, 1)


def test_the_waterfall_has_the_newest_line_on_top(qtbot) -> None:
    view = shown(qtbot, WaterfallView(lines=50))
    for level in (-80.0, -20.0):
        view.add(0.5, np.full(64, level, np.float32))
    view.refresh()
    assert view.describe(3.0, 0.5).endswith("-20.0 dBFS")
    assert view.describe(3.0, 1.5).endswith("-80.0 dBFS")
    assert view.describe(3.0, 2.5).endswith("profiles ago")
    view.add(0.25, np.full(64, -50.0, np.float32))  # another rig: begins anew
    view.refresh()
    assert view.describe(3.0, 1.5).endswith("profiles ago")


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (np.full((3, 3), np.nan), (0.0, 1.0)),
        (np.full((3, 3), 2.0), (1.5, 2.5)),
        (np.linspace(0, 1000, 1001), (50.0, 997.0)),  # 5 % and 99.7 % of a line
    ],
)
def test_limits_by_percentile(values: np.ndarray, expected: tuple[float, float]) -> None:
    assert maps.percentile_levels(values) == pytest.approx(expected)


@pytest.mark.parametrize("suffix", ["png", "pdf"])
def test_a_view_is_saved_with_its_provenance(qtbot, tmp_path, suffix: str) -> None:
    view = shown(qtbot, PictureView(Quantity("level", "dB")), 300, 300)
    view.show_values(*demo_image())
    path = tmp_path / f"view.{suffix}"
    save_view(view, path, {"session": "field-3.h5"})
    if suffix == "png":
        image = QImage(str(path))
        assert '"session": "field-3.h5"' in image.text("Provenance")
        assert (image.width(), image.height()) == (300, 300)
    else:
        assert path.read_bytes().startswith(b"%PDF-")
    with pytest.raises(OSError, match="pictures are"):
        save_view(view, tmp_path / "view.gif", {})


def test_work_is_done_beside_the_window_and_its_outcome_comes_back_into_it(qtbot, qapp: QApplication) -> None:
    threads: list[threading.Thread] = []
    found: list[object] = []

    def work() -> int:
        threads.append(threading.current_thread())
        return 42

    def done(value: object) -> None:
        threads.append(threading.current_thread())
        found.append(value)

    background.run(qapp, work, done, lambda *_: None)
    qtbot.waitUntil(lambda: bool(found))
    assert found == [42]
    assert threads[0] is not threading.main_thread()
    assert threads[1] is threading.main_thread()


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (PolfuseError("is not there", where="rig.toml", advice="look for it"), "rig.toml: is not there; look for it"),
        (KeyError("x"), "KeyError: 'x'; this is a defect of the program: report it"),
    ],
)
def test_a_failure_comes_back_as_one_sentence(qtbot, qapp: QApplication, error: Exception, sentence: str) -> None:
    told: list[tuple[str, str]] = []

    def work() -> None:
        raise error

    background.run(qapp, work, lambda _: None, lambda *words: told.append(words))
    qtbot.waitUntil(lambda: bool(told))
    assert told[0][0] == sentence
    assert "Traceback" in told[0][1]


@pytest.mark.parametrize("fails", [False, True])
def test_work_for_a_page_that_has_gone_tells_nobody(qtbot, fails: bool) -> None:
    asker, gone = QObject(), threading.Event()
    told: list[object] = []

    def work() -> int:
        gone.wait(10)
        if fails:
            raise PolfuseError("is not there", where="rig.toml", advice="look for it")
        return 42

    task = background.run(asker, work, told.append, lambda *words: told.append(words))
    shiboken6.delete(asker)
    with qtbot.waitSignal(task.destroyed, timeout=10_000):
        gone.set()
    assert told == []


def test_numbers_as_people_read_them() -> None:
    assert [duration(s) for s in (None, 0, 65, 3725, float("inf"))] == ["–", "0:00", "1:05", "1:02:05", "–"]
    assert [size(b) for b in (None, 999, 1500, 2.5e9, 7e12)] == ["–", "999 B", "2 kB", "2.5 GB", "7.0 TB"]
