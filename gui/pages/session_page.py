"""A recorded session: what is in it, whether it is whole, and what to make of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from PySide6.QtCore import Qt, QTimer
from PySide6.QtWidgets import QDoubleSpinBox, QHBoxLayout, QLabel, QPlainTextEdit, QSlider, QVBoxLayout, QWidget

from gui.models import background
from gui.models.words import duration, moment, signed_db
from gui.widgets.job_bar import JobBar
from gui.widgets.layout import button, card, dim, heading, show_place, title
from gui.widgets.replay_bar import FASTEST, SLOWEST
from gui.workbench import Workbench
from polfuse_lab import jobs
from polfuse_lab.jobs import Job, Prediction, predict_focus
from polfuse_lab.session import info

TOLERANCES_DB = (-20, -30, -40, -50, -60, -70, -80)
METHODS = {"rma": "range migration", "pfa": "polar format", "bp": "back-projection",
           "ffbp": "factorized back-projection", "reference": "exact back-projection"}  # fmt: skip


class SessionPage(QWidget):
    """Facts on the left, what can be done on the right."""

    def __init__(self, bench: Workbench, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._bench = bench
        self.where = dim(self.tr("No session is open: collect one, or open one on the start page"))
        self.facts = QLabel()
        self.facts.setWordWrap(True)
        self.facts.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.problems = QPlainTextEdit()
        self.problems.setReadOnly(True)
        self.problems.setPlaceholderText(self.tr("No problems"))
        self.tolerance = QSlider(Qt.Orientation.Horizontal)
        self.tolerance.setRange(0, len(TOLERANCES_DB) - 1)
        self.tolerance.setValue(TOLERANCES_DB.index(-50))
        self.tolerance.setTickPosition(QSlider.TickPosition.TicksBelow)
        self.tolerance.setAccessibleName(self.tr("from fast to accurate"))
        self.tolerance.valueChanged.connect(lambda _: self._predict_soon())
        self.prediction = QLabel()
        self.prediction.setProperty("role", "heading")
        self.prediction.setWordWrap(True)
        self.choice = dim("")
        self.why = dim("")
        self.why.hide()
        self.why_button = button(self.tr("What else there was"), self._tell_why)
        self.why_button.setCheckable(True)
        self.focus_button = button(self.tr("Focus"), self._focus, role="primary", key="Ctrl+F")
        self.optics_button = button(self.tr("Polarization pictures"), self._optics)
        self.speed = QDoubleSpinBox()
        self.speed.setRange(SLOWEST, FASTEST)
        self.speed.setStepType(QDoubleSpinBox.StepType.AdaptiveDecimalStepType)
        self.speed.setDecimals(1)
        self.speed.setValue(1.0)
        self.speed.setSuffix(" ×")
        self.speed.setToolTip(self.tr("How many times as fast as it was recorded; it can be changed while it plays"))
        self.replay_button = button(self.tr("Play it in the live view"), self._replay)
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.setInterval(200)
        self._timer.timeout.connect(self._predict)
        ends = QHBoxLayout()
        ends.addWidget(QLabel(self.tr("fast")))
        ends.addWidget(self.tolerance, 1)
        ends.addWidget(QLabel(self.tr("accurate")))
        play = QHBoxLayout()
        play.addWidget(self.speed)
        play.addWidget(self.replay_button, 1)
        self.doings = QVBoxLayout()
        self.doings.addWidget(card(heading(self.tr("Radar picture")), ends, self.prediction, self.choice,
                                    self.why_button, self.why, self.focus_button))  # fmt: skip
        self.doings.addWidget(card(heading(self.tr("Camera")), self.optics_button))
        self.doings.addWidget(card(heading(self.tr("Replay")), play))
        self.doings.addStretch(1)
        row = QHBoxLayout()
        row.addWidget(
            card(heading(self.tr("What is in it")), self.facts, heading(self.tr("Problems")), self.problems, stretch=3),
            3,
        )
        row.addLayout(self.doings, 2)
        column = QVBoxLayout(self)
        column.setContentsMargins(24, 20, 24, 16)
        column.addWidget(title(self.tr("Session")))
        column.addWidget(self.where)
        column.addWidget(JobBar(bench.jobs))
        column.addLayout(row, 1)
        bench.session_opened.connect(self.open)
        bench.jobs.over.connect(self._over)
        self._predicted = False
        self._mine: dict[int, Path] = {}
        self._enable(False)

    def open(self, path: Path) -> None:
        """Show a session."""
        show_place(self.where, path)
        self._enable(False)
        background.run(self, lambda: info(path), self._described, self._bench.error.emit)

    @property
    def products(self) -> Path:
        """Where the products of this session go: beside it."""
        session = self._bench.session
        assert session is not None
        return session.with_name(f"{session.stem}-products.h5")

    @property
    def predicted(self) -> bool:
        """Whether it is known how focusing would go."""
        return self._predicted

    def _enable(self, on: bool) -> None:
        for made in (self.focus_button, self.optics_button, self.replay_button):
            made.setEnabled(on)

    def _described(self, found: dict[str, Any]) -> None:
        sync = found["sync_rms_s"]
        lines = [
            self.tr("begun {0}, {1} long, {2}").format(
                moment(found["started"]), duration(found["duration_s"]), found["state"]
            ),
            self.tr("{0} positions, channels {1}").format(found["positions"], ", ".join(found["channels"]) or "–"),
            self.tr("{0} audio records, {1} camera frames").format(found["sweeps"], found["frames"]),
            self.tr("lost: {0} samples, {1} frames").format(found["samples_lost"], found["frames_lost"]),
            self.tr("clocks agree within {0:.2f} ms").format(sync * 1e3) if sync is not None else "",
            *(f"{device['kind']}: {device['name']}" for device in found["devices"]),
        ]
        self.facts.setText("\n".join(line for line in lines if line))
        self.problems.setPlainText("\n".join(found["problems"]))
        self._enable(True)
        self.focus_button.setEnabled(found["sweeps"] > 0)
        self.optics_button.setEnabled(found["frames"] > 0)
        self._predict_soon()

    # -- focusing -----------------------------------------------------------------------------------------------------

    @property
    def tolerance_db(self) -> float:
        """The largest error asked for, dB."""
        return float(TOLERANCES_DB[self.tolerance.value()])

    def _predict_soon(self) -> None:
        self._predicted = False
        self.prediction.setText(self.tr("Error at most {0} dB: looking how…").format(signed_db(self.tolerance_db)))
        self.choice.setText("")
        self.why.setText("")
        self._timer.start()

    def _predict(self) -> None:
        session, tolerance_db = self._bench.session, self.tolerance_db
        if session is None or not self.focus_button.isEnabled():
            return

        def done(found: Prediction) -> None:
            if tolerance_db == self.tolerance_db:
                self._predicted = True
                self.prediction.setText(
                    self.tr("Error about {0} dB, takes about {1:.1f} s").format(
                        signed_db(found.error_db), found.seconds
                    )
                )
                first, *others = found.why or (METHODS[found.method],)
                self.choice.setText(first)
                self.why.setText("\n".join(f"\N{BULLET} {words}" for words in others))

        background.run(
            self,
            lambda: predict_focus(session, tolerance_db),
            done,
            lambda sentence, _: self.prediction.setText(sentence),
        )

    def _tell_why(self) -> None:
        self.why.setVisible(self.why_button.isChecked())

    def _focus(self) -> None:
        assert self._bench.session is not None
        self._submit(jobs.focus(self._bench.session, self.products, tolerance_db=self.tolerance_db))

    def _optics(self) -> None:
        assert self._bench.session is not None
        self._submit(jobs.optics(self._bench.session, self.products))

    def _submit(self, spec: jobs.JobSpec) -> None:
        self._mine[id(self._bench.jobs.submit(spec))] = self.products

    def _over(self, job: Job) -> None:
        if job.state == "failed":
            self._bench.error.emit(job.error, job.details)
        products = self._mine.pop(id(job), None)
        if products is not None and job.state == "done":
            self._bench.open_products(products)
            self._bench.page_wanted.emit("products")

    # -- replay -------------------------------------------------------------------------------------------------------

    def _replay(self) -> None:
        if self._bench.session is not None:
            self._bench.play(self._bench.session, self.speed.value())
