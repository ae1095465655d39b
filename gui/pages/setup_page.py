"""Every device with a light, what is wrong and how to mend it; levels and camera live; everything moved by hand."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QComboBox, QDoubleSpinBox, QHBoxLayout, QLabel, QVBoxLayout, QWidget

from gui.models.bench_link import BenchLink
from gui.pages.live_page import S0
from gui.widgets.device_card import DeviceCard
from gui.widgets.layout import button, card, dim, heading, show_place, title
from gui.widgets.level_meter import LevelMeter
from gui.widgets.picture_view import PictureView
from gui.widgets.prompt_bar import PromptBar
from gui.widgets.scope_view import ScopeView
from gui.workbench import Workbench
from polfuse_lab.bench import BenchClient, BenchStatus

LIGHTS = {"ok": "ok", "warn": "warning", "bad": "bad", "busy": "busy", "off": "off"}
JOGS_M = (-0.1, -0.01, 0.01, 0.1)


class SetupPage(QWidget):
    """The set-up mode of the rig that is worked with."""

    def __init__(self, bench: Workbench, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._bench = bench
        self.link = BenchLink(self)
        self.link.status.connect(self._show)
        self.link.failed.connect(bench.error)
        self.link.opened.connect(self._opened)
        self.link.left.connect(self._left)
        bench.before_collect = self._release
        self.cards: dict[str, DeviceCard] = {}
        self.prompts = PromptBar()
        self.prompts.confirmed.connect(self.link.answer)
        self.rig_words = dim(self.tr("No rig is open: choose one on the start page"))
        self.check_button = button(self.tr("Check the devices"), self.check, role="primary", key="F4")
        self.stop_button = button(self.tr("Let go of the devices"), self.link.close,
                                  self.tr("Bring them to their safe state and close them"))  # fmt: skip
        top = QHBoxLayout()
        top.addWidget(title(self.tr("Set-up")))
        top.addWidget(self.rig_words, 1)
        top.addWidget(self.check_button)
        top.addWidget(self.stop_button)
        self._cards = QVBoxLayout()
        self._cards.addWidget(dim(self.tr("Each device is shown here with a light, once they are checked.")))
        self._cards.addStretch(1)
        left = QVBoxLayout()
        left.addLayout(self._cards)
        left.addStretch(1)
        middle = QVBoxLayout()
        middle.addWidget(self._radar_part())
        middle.addWidget(self._hand_part())
        middle.addStretch(1)
        right = QVBoxLayout()
        right.addWidget(self._camera_part(), 3)
        right.addWidget(self._scope_part(), 2)
        self._parts = (self.radar_card, self.hand_card, self.scope_card, self.camera_card)
        row = QHBoxLayout()
        row.addLayout(left, 5)
        row.addLayout(middle, 5)
        row.addLayout(right, 6)
        column = QVBoxLayout(self)
        column.setContentsMargins(16, 16, 16, 12)
        column.addLayout(top)
        column.addWidget(self.prompts)
        column.addLayout(row, 1)
        bench.rig_changed.connect(self._rig_changed)
        bench.live.tick.connect(self._draw)
        self._here = False
        self._left()

    def shown(self) -> None:
        """The page has come to the front."""
        self._here = True

    def hidden(self) -> None:
        """Another page is in front."""
        self._here = False

    def close_down(self) -> None:
        """The window closes: set-up mode ends, the devices are made safe."""
        self.link.close()

    def check(self) -> None:
        """Open the devices one by one."""
        if self._bench.rig is not None and not self.link.busy:
            self.check_button.setEnabled(False)
            self.check_button.setText(self.tr("Checking…"))
            self.link.start(self._bench.rig)

    @property
    def seen(self) -> bool:
        """Whether the camera's picture and the signals are shown."""
        return self.picture.shows and self.scope.shows

    @property
    def all_ready(self) -> bool:
        """Whether there are devices and each of them can be used."""
        return bool(self.cards) and all(shown.light in ("ok", "warning") for shown in self.cards.values())

    # -- parts --------------------------------------------------------------------------------------------------------

    def _radar_part(self) -> QWidget:
        self.beat, self.sync = LevelMeter("beat"), LevelMeter("sync", loud=True)
        self.signal_words = dim("")
        self.signal_words.hide()
        self.channel = QComboBox()
        self.channel.addItems(("HH", "HV", "VH", "VV"))
        self.channel.setToolTip(self.tr("Channel of the transfer switches, transmit then receive"))
        self.channel.activated.connect(lambda _: self.link.ask("select", self.channel.currentText()))
        self.channel_words = QLabel()
        row = QHBoxLayout()
        row.addWidget(QLabel(self.tr("Switches")))
        row.addWidget(self.channel)
        row.addWidget(self.channel_words, 1)
        self.radar_card = card(heading(self.tr("Radar")), self.beat, self.sync, self.signal_words, row)
        return self.radar_card

    def _hand_part(self) -> QWidget:
        self.place = QLabel("–")
        self.place.setProperty("role", "big")
        self.target = QDoubleSpinBox()
        self.target.setSuffix(" m")
        self.target.setDecimals(3)
        self.target.setSingleStep(0.0508)
        self.target.setToolTip(self.tr("Place along the rail; 0 is the aperture's centre"))
        self.jogs = QHBoxLayout()
        for step in JOGS_M:
            words = f"{100 * step:+.0f} cm".replace("-", "\N{MINUS SIGN}")
            self.jogs.addWidget(button(words, partial(self.link.ask, "jog", step), role="compact"))
        move = QHBoxLayout()
        move.addWidget(self.target, 1)
        move.addWidget(button(self.tr("Go there"), lambda: self.link.ask("move_to", self.target.value())))
        move.addWidget(button(self.tr("Stop"), lambda: self.link.ask("stop"), role="danger", key="Esc"))
        self.angle = QDoubleSpinBox()
        self.angle.setRange(-360, 360)
        self.angle.setSuffix(" °")
        self.angle.setSingleStep(45)
        self.angle_words = QLabel("–")
        turn = QHBoxLayout()
        turn.addWidget(self.angle, 1)
        turn.addWidget(button(self.tr("Turn"), lambda: self.link.ask("turn", self.angle.value())))
        turn.addWidget(self.angle_words)
        self.source_row = QWidget()
        source = QHBoxLayout(self.source_row)
        source.setContentsMargins(0, 0, 0, 0)
        self.source_angle = QDoubleSpinBox()
        self.source_angle.setRange(-360, 360)
        self.source_angle.setSuffix(" °")
        self.source_angle.setSingleStep(45)
        self.source_words = QLabel("–")
        source.addWidget(QLabel(self.tr("Light source")))
        source.addWidget(self.source_angle, 1)
        source.addWidget(button(self.tr("Turn"), lambda: self.link.ask("turn_source", self.source_angle.value())))
        source.addWidget(self.source_words)
        self.source_row.hide()
        self.hand_card = card(
            heading(self.tr("Trolley")),
            self.place,
            self.jogs,
            move,
            heading(self.tr("Polarizer")),
            turn,
            self.source_row,
        )
        return self.hand_card

    def _scope_part(self) -> QWidget:
        self.scope = ScopeView()
        self.scope_card = card(heading(self.tr("Signals")), self.scope, stretch=1)
        return self.scope_card

    def _camera_part(self) -> QWidget:
        self.picture = PictureView(S0, ground=False)
        self.exposure = QDoubleSpinBox()
        self.exposure.setDecimals(3)
        self.exposure.setRange(0.001, 60_000)
        self.exposure.setSuffix(" ms")
        self.exposure.setMinimumWidth(100)
        self.camera_words = dim("")
        row = QHBoxLayout()
        self.exposure.setToolTip(self.tr("Exposure in milliseconds"))
        row.addWidget(self.exposure, 1)
        row.addWidget(button(self.tr("Set"), lambda: self.link.ask("expose", self.exposure.value() * 1e-3)))
        row.addWidget(button(self.tr("Find it"), lambda: self.link.ask("auto_expose"),
                             self.tr("Longest exposure at which nothing is saturated")))  # fmt: skip
        self.camera_card = card(heading(self.tr("Camera")), self.picture, row, self.camera_words, stretch=1)
        return self.camera_card

    # -- news ---------------------------------------------------------------------------------------------------------

    def _rig_changed(self, path: object) -> None:
        self.link.close()
        if isinstance(path, Path):
            show_place(self.rig_words, path)
        else:
            self.rig_words.setText(self.tr("No rig is open: choose one on the start page"))
        self.check_button.setEnabled(path is not None)
        if path is not None and not self._bench.engine.busy:
            QTimer.singleShot(0, self.check)

    def _opened(self, client: BenchClient) -> None:
        self._bench.live.open(client.live())
        self.check_button.setText(self.tr("Check the devices"))
        self.stop_button.setEnabled(True)
        for part in self._parts:
            part.setEnabled(True)
        self.link.ask("camera", running=True)

    def _left(self) -> None:
        self.check_button.setText(self.tr("Check the devices"))
        self.check_button.setEnabled(self._bench.rig is not None)
        self.stop_button.setEnabled(False)
        self.prompts.show_prompts([])
        for shown in self.cards.values():
            shown.show_state("off")
        for part in self._parts:
            part.setEnabled(False)

    def _show(self, status: BenchStatus) -> None:
        self._show_cards(status)
        self.prompts.show_prompts([(prompt.ticket, prompt.text) for prompt in status.prompts])
        for words in status.refused:
            self._bench.error.emit(words, "")
        trolley = status.trolley
        if trolley is not None:
            moving = self.tr("  moving") if trolley.moving else ""
            self.place.setText(f"x = {trolley.x_m:+.3f} m ± {trolley.sd_m * 1e3:.1f} mm{moving}")
            self.target.setRange(trolley.low_m, trolley.high_m)
        if status.switches is not None:
            verified = self.tr("confirmed") if status.switches.verified else self.tr("not confirmed")
            self.channel_words.setText(f"{status.switches.channel}, {verified}")
        if status.polarizer is not None:
            self.angle_words.setText(f"{status.polarizer.angle_deg:.1f}°")
        self.source_row.setVisible(status.source_polarizer is not None)
        if status.source_polarizer is not None:
            self.source_words.setText(f"{status.source_polarizer.angle_deg:.1f}°")
        camera = status.camera
        if camera is not None:
            share = camera.saturated_fraction
            self.camera_words.setText(
                self.tr("{0:.3g} ms, {1} frames, {2:.2g} % saturated").format(
                    camera.exposure_s * 1e3, camera.frames, 100 * (share or 0.0)
                )
            )
            if not self.exposure.hasFocus():
                self.exposure.setValue(camera.exposure_s * 1e3)

    def _show_cards(self, status: BenchStatus) -> None:
        if set(self.cards) != {device.kind for device in status.devices}:
            while (item := self._cards.takeAt(0)) is not None:
                if (widget := item.widget()) is not None:
                    widget.deleteLater()
            self.cards = {device.kind: DeviceCard(device.kind, self._name(device.kind)) for device in status.devices}
            for shown in self.cards.values():
                shown.retry.connect(lambda kind: self.link.ask("retry", kind))
                self._cards.addWidget(shown)
        for device in status.devices:
            self.cards[device.kind].show_state(LIGHTS[device.light], device.what or device.identity, device.mend)

    def _name(self, kind: str) -> str:
        return {
            "radar": self.tr("Radar's audio port"),
            "switches": self.tr("Transfer switches"),
            "trolley": self.tr("Trolley"),
            "camera": self.tr("Camera"),
            "polarizer": self.tr("Polarizer"),
            "source_polarizer": self.tr("Light source's polarizer"),
        }.get(kind, kind)

    def _draw(self) -> None:
        if not self._here or not self.link.busy:
            return
        live = self._bench.live
        levels = live.newest("levels")
        if levels is not None:
            self.beat.show_level(levels.values["beat_peak"], levels.values["beat_rms"])
            self.sync.show_level(levels.values["sync_peak"], levels.values["sync_rms"])
            words = f"{levels.values['what']} {levels.values['mend']}".strip()
            self.signal_words.setText(words)
            self.signal_words.setVisible(bool(words))
        scope = live.newest("scope")
        if scope is not None:
            self.scope.show_signals(scope.arrays["t_s"], scope.arrays["beat"], scope.arrays["sync"])
        for stream in live.streams():
            if stream.startswith("camera."):
                found = live.newest(stream)
                if found is not None:
                    image = found.arrays["image"].astype("float32")
                    self.picture.show_values(image, marked=found.arrays["saturated"] > 0)

    def _release(self) -> BenchLink | None:
        """The set-up mode that must hand its devices over before a collect begins."""
        return self.link if self.link.client is not None else None
