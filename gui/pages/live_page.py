"""What the devices see right now: ranges, speeds, the picture that forms, the camera, and both together."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from PySide6.QtWidgets import (
    QComboBox,
    QFileDialog,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QTabWidget,
    QVBoxLayout,
    QWidget,
)

from gui import maps
from gui.models.cursor import LinkedCursor
from gui.models.live_link import LiveLink
from gui.models.words import age
from gui.saving import save_view
from gui.widgets.colour_bar import ColourBar
from gui.widgets.layout import button, title
from gui.widgets.level_meter import LevelMeter
from gui.widgets.picture_view import PictureView, Quantity
from gui.widgets.plots import Plot
from gui.widgets.profile_view import CHANNELS, ProfileView
from gui.widgets.replay_bar import ReplayBar
from gui.widgets.turns import TURNS
from gui.widgets.waterfall_view import WaterfallView
from gui.workbench import Workbench
from polfuse_lab.engine.protocol import StatusEvent
from polfuse_lab.live import Shown

LEVEL = Quantity("level", "dB")
S0 = Quantity("S0", "counts", "gray", low=0.0, digits=0)
DOLP = Quantity("DOLP", "1", maps.FRACTION, 0.0, 1.0, digits=3)
AOP = Quantity("AOP", "°", maps.CYCLIC, -90.0, 90.0)
NEWS_S = 10.0
"""After so long without anything new, that is said."""
PIXELS_A_TICK = 250_000
"""Pictures of more pixels together are drawn in several ticks, so that they do not hold the window up."""


class LivePage(QWidget):
    """Tabs of linked views on a running engine."""

    def __init__(self, bench: Workbench, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._bench = bench
        self.link = bench.live
        self._frozen = False
        self._soon: dict[Plot, tuple[int, Callable[[], None]]] = {}
        """What is to be drawn: how many pixels, and how; of one plot the newest."""
        self._profiles: dict[str, Shown] = {}
        self._sar_limits: tuple[float, float] | None = None
        self._draw: dict[str, Callable[[], None]] = {}
        self.tabs = QTabWidget()
        for name, text, view, draw in (
            ("ranges", self.tr("Ranges"), self._ranges_tab(), self._draw_ranges),
            ("speeds", self.tr("Speeds"), self._speeds_tab(), self._draw_speeds),
            ("sar", self.tr("SAR picture"), self._sar_tab(), self._draw_sar),
            ("camera", self.tr("Camera"), self._camera_tab(), self._draw_camera),
            ("fused", self.tr("Fused"), self._fused_tab(), self._draw_fused),
        ):
            self.tabs.addTab(view, text)
            self._draw[name] = draw
        self._tab_names = tuple(self._draw)
        self.state = QLabel(self.tr("Nothing is running: start a collect, a set-up or a replay"))
        self.state.setProperty("role", "dim")
        self.freeze_button = button(self.tr("Freeze"), self._freeze, self.tr("Keep what is shown; recording goes on"),
                                    key="F9")  # fmt: skip
        self.freeze_button.setCheckable(True)
        top = QHBoxLayout()
        top.addWidget(title(self.tr("Live")))
        top.addWidget(self.state, 1)
        top.addWidget(self.freeze_button)
        top.addWidget(button(self.tr("Save view…"), self._save, self.tr("As PNG or PDF, with where it comes from")))
        column = QVBoxLayout(self)
        column.setContentsMargins(24, 20, 24, 16)
        column.addLayout(top)
        column.addWidget(self.tabs, 1)
        self.replay = ReplayBar()
        self.replay.speed_wanted.connect(bench.set_replay_speed)
        self.replay.seek_wanted.connect(bench.seek)
        self.replay.pause_wanted.connect(lambda paused: bench.engine.pause() if paused else bench.engine.resume())
        self.replay.stop_wanted.connect(bench.engine.abort)
        column.addWidget(self.replay)
        bench.engine.attached.connect(self._attached)
        bench.engine.status.connect(self._status)
        bench.engine.finished.connect(lambda _: self.replay.hide())
        bench.engine.failed.connect(lambda *_: self.replay.hide())
        self.tabs.currentChanged.connect(lambda _: self._anew())
        self.link.tick.connect(self._tick)
        bench.engine.finished.connect(lambda _: self._over())
        self.link.opened.connect(self._waiting)
        self._ended = False
        self._here = False

    def shown(self) -> None:
        """The page has come to the front."""
        self._here = True
        self._anew()

    def hidden(self) -> None:
        """Another page is in front: nothing is drawn."""
        self._here = False

    def show_tab(self, name: str) -> None:
        """Turn to a tab."""
        self.tabs.setCurrentIndex(self._tab_names.index(name))

    # -- tabs ---------------------------------------------------------------------------------------------------------

    def _ranges_tab(self) -> QWidget:
        self.profile = ProfileView()
        self.waterfall = WaterfallView()
        self.waterfall_channel = _channels()
        self.waterfall_channel.currentIndexChanged.connect(lambda _: self._fall_anew())
        self.beat, self.sync = LevelMeter("beat"), LevelMeter("sync", loud=True)
        # One cursor for both: the same range.
        cursor = LinkedCursor(self)
        self.profile.pointed.connect(cursor.move)
        self.waterfall.pointed.connect(cursor.move)
        cursor.moved.connect(self.profile.show_range)
        cursor.moved.connect(self.waterfall.show_range)
        tab = QWidget()
        grid = QGridLayout(tab)
        meters = QHBoxLayout()
        meters.addWidget(self.beat)
        meters.addWidget(self.sync)
        choose = QHBoxLayout()
        choose.addWidget(QLabel(self.tr("Waterfall of")))
        choose.addWidget(self.waterfall_channel)
        choose.addStretch(1)
        grid.addLayout(meters, 0, 0)
        grid.addLayout(choose, 0, 1)
        grid.addWidget(self.profile, 1, 0)
        grid.addWidget(self.waterfall, 1, 1)
        grid.setColumnStretch(0, 1)
        grid.setColumnStretch(1, 1)
        grid.setRowStretch(1, 1)
        return tab

    def _speeds_tab(self) -> QWidget:
        self.doppler_channel = _channels()
        self.doppler_channel.currentIndexChanged.connect(lambda _: self.link.forget())
        self.doppler = PictureView(LEVEL, axes=("range", "m", "speed, receding", "m/s"), square=False)
        self.doppler.say_empty(
            self.tr("nothing to show yet: speeds need many sweeps of one channel in a row, as in set-up")
        )
        tab = QWidget()
        column = QVBoxLayout(tab)
        choose = QHBoxLayout()
        choose.addWidget(QLabel(self.tr("Speeds in")))
        choose.addWidget(self.doppler_channel)
        choose.addStretch(1)
        column.addLayout(choose)
        column.addWidget(self.doppler, 1)
        return tab

    def _sar_tab(self) -> QWidget:
        self.linked = LinkedCursor(self)
        self.sar = {channel: PictureView(LEVEL, bar=False) for channel in CHANNELS}
        self.sar_bar = ColourBar(LEVEL, list(self.sar.values()))
        self.pauli = PictureView(LEVEL, bar=False)
        tab = QWidget()
        grid = QGridLayout(tab)
        for number, (channel, view) in enumerate(self.sar.items()):
            view.item.setTitle(channel)
            view.follow(self.linked)
            grid.addWidget(view, number // 2, number % 2)
        self.pauli.item.setTitle(self.tr("Pauli: red HH−VV, green HV, blue HH+VV"))
        self.pauli.follow(self.linked)
        grid.addWidget(self.sar_bar, 0, 2, 2, 1)
        grid.addWidget(self.pauli, 0, 3, 2, 1)
        for column, share in enumerate((2, 2, 0, 3)):
            grid.setColumnStretch(column, share)
        return tab

    def _camera_tab(self) -> QWidget:
        cursor = LinkedCursor(self)
        self.frame = PictureView(S0, ground=False)
        self.optics = {name: PictureView(quantity, ground=False) for name, quantity in
                       (("s0", S0), ("dolp", DOLP), ("aop_rad", AOP))}  # fmt: skip
        self.frame.item.setTitle(self.tr("newest frame"))
        tab = QWidget()
        grid = QGridLayout(tab)
        for number, (name, view) in enumerate((("frame", self.frame), *self.optics.items())):
            if name != "frame":
                view.item.setTitle(view.quantity.name)
            view.follow(cursor)
            grid.addWidget(view, number // 2, number % 2)
        return tab

    def _fused_tab(self) -> QWidget:
        self.fused = PictureView(LEVEL, bar=False)
        self.fused_words = QLabel(self.tr("The camera in grey under the radar in colour, once both have been seen"))
        self.fused_words.setProperty("role", "dim")
        tab = QWidget()
        column = QVBoxLayout(tab)
        column.addWidget(self.fused_words)
        column.addWidget(self.fused, 1)
        return tab

    def _attached(self, _: object) -> None:
        self.replay.setVisible(self._bench.engine.replaying)
        if self._bench.engine.replaying:
            self.replay.begin(self._bench.replay_speed)

    def _status(self, status: StatusEvent) -> None:
        if self._bench.engine.replaying:
            self.replay.show_status(status)

    # -- drawing ------------------------------------------------------------------------------------------------------

    def _tick(self) -> None:
        if not self._here or self._frozen or TURNS.busy:
            return
        self._draw[self._tab_names[self.tabs.currentIndex()]]()
        self._draw_some()
        old = self.link.age_s()
        if self._bench.engine.replaying and not self._ended:
            # Its samples are as old as the recording.
            self._tell(self.tr("a recording is played"))
        elif old is not None and not self._ended:
            self._tell((self.tr("{0} old") if old < NEWS_S else self.tr("no news for {0}")).format(age(old)))

    def _draw_some(self) -> None:
        """Draw what there is room for in one tick, first what has waited longest."""
        room = PIXELS_A_TICK
        for plot, (pixels, draw) in list(self._soon.items()):
            if pixels > room and room < PIXELS_A_TICK:
                return
            first = not plot.shows
            del self._soon[plot]
            draw()
            room -= pixels
            if first:
                return  # axes, numbers and colours are made as well: enough for one tick

    def _anew(self) -> None:
        """Something else has come to the front: all of it is drawn."""
        self._soon.clear()
        self.link.forget()

    def _fall_anew(self) -> None:
        self.waterfall.clear()
        self.link.tell_again(f"waterfall.{self.waterfall_channel.currentText()}")

    def _waiting(self) -> None:
        self._ended = False
        self._fall_anew()
        self._tell(self.tr("waiting for the first data…"))

    def _over(self) -> None:
        self._ended = True
        self._tell(self.tr("the run has ended; these are its last pictures"))

    def _tell(self, words: str) -> None:
        if words != self.state.text():
            self.state.setText(words)

    def _draw_ranges(self) -> None:
        for channel in CHANNELS:
            found = self.link.newest(f"profile.{channel}")
            if found is not None:
                self._profiles[channel] = found
                self._soon[self.profile] = 0, self._draw_profiles
        lines = self.link.since(f"waterfall.{self.waterfall_channel.currentText()}", self.waterfall.most)
        for line in lines:
            self.waterfall.add(float(line.values["range_step_m"]), line.arrays["level_db"])
        if lines:
            self._soon[self.waterfall] = self.waterfall.pixels, self.waterfall.refresh
        levels = self.link.newest("levels")
        if levels is not None:
            self.beat.show_level(levels.values["beat_peak"], levels.values["beat_rms"])
            self.sync.show_level(levels.values["sync_peak"], levels.values["sync_rms"])

    def _draw_profiles(self) -> None:
        for channel, found in self._profiles.items():
            range_m = found.arrays["range_m"]
            self.profile.show_profile(channel, float(range_m[1] - range_m[0]), found.arrays["level_db"])
        self._profiles.clear()

    def _draw_speeds(self) -> None:
        found = self.link.newest(f"doppler.{self.doppler_channel.currentText()}")
        if found is not None:
            arrays = found.arrays
            level_db = arrays["level_db"]
            limits = maps.level_limits(level_db)
            self.doppler.show_values(level_db, arrays["range_m"], arrays["speed_m_s"], limits=limits)

    def _draw_sar(self) -> None:
        found = self.link.newest("sar")
        if found is not None:
            limits = float(found.values["low_db"]), float(found.values["high_db"])
            limits = self._sar_limits = maps.settled(limits, self._sar_limits)
            self.sar_bar.show_limits(limits)
            axes = found.arrays["x_m"], found.arrays["y_m"]
            for channel, level_db in zip(found.values["channels"], found.arrays["level_db"], strict=True):
                view = self.sar[channel]
                self._soon[view] = level_db.size, partial(view.show_values, level_db, *axes, limits=limits)
        colours = self.link.newest("pauli")
        if colours is not None:
            rgb = colours.arrays["rgb"]
            draw = partial(self.pauli.show_colours, rgb, colours.arrays["x_m"], colours.arrays["y_m"])
            self._soon[self.pauli] = rgb[..., 0].size, draw

    def _draw_camera(self) -> None:
        newest: Shown | None = None
        for stream in self.link.streams():
            if stream.startswith("camera."):
                found = self.link.newest(stream)
                if found is not None and (newest is None or found.t_sample_ns > newest.t_sample_ns):
                    newest = found
        if newest is not None:
            self._soon[self.frame] = newest.arrays["image"].size, partial(self._draw_frame, newest)
        found = self.link.newest("optics")
        if found is not None:
            for name, view in self.optics.items():
                self._soon[view] = found.arrays[name].size, partial(self._draw_light, name, found)

    def _draw_frame(self, newest: Shown) -> None:
        image = newest.arrays["image"].astype(np.float32)
        self.frame.show_values(image, marked=newest.arrays["saturated"] > 0)
        share = float(newest.values["saturated_fraction"])
        words = self.tr("newest frame, {0:g}°").format(newest.values["angle_deg"])
        if share > 0:
            words += self.tr(": {0:.2g} % saturated").format(100 * share)
        self.frame.entitle(words)

    def _draw_light(self, name: str, found: Shown) -> None:
        scale, sd = {"s0": (1.0, None), "dolp": (1.0, "dolp_sd"), "aop_rad": (180 / math.pi, "aop_sd_rad")}[name]
        spread = None if sd is None else found.arrays[sd] * np.float32(scale)
        self.optics[name].show_values(found.arrays[name] * np.float32(scale), sd=spread)

    def _draw_fused(self) -> None:
        found = self.link.newest("fusion")
        if found is not None:
            self.fused.show_colours(found.arrays["rgb"], found.arrays["x_m"], found.arrays["y_m"])
            error = found.values.get("registration_error_px")
            if error is not None:
                self.fused_words.setText(self.tr("registration good to about {0:.0f} pixels").format(float(error)))

    def _freeze(self) -> None:
        self._frozen = self.freeze_button.isChecked()
        self.freeze_button.setText(self.tr("Go on") if self._frozen else self.tr("Freeze"))
        if not self._frozen:
            self._anew()

    def _save(self) -> None:
        name, _ = QFileDialog.getSaveFileName(self, self.tr("Save this view"), "view.png", "PNG (*.png);;PDF (*.pdf)")
        if name:
            try:
                save_view(self.tabs.currentWidget(), Path(name), self._bench.provenance())
            except OSError as error:
                self._bench.error.emit(self.tr("{0} cannot be written ({1})").format(name, error), "")


def _channels() -> QComboBox:
    made = QComboBox()
    made.addItems(CHANNELS)
    return made


__all__ = ["LiveLink", "LivePage"]
