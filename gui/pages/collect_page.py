"""Choose or write a plan, see what it takes, run it, and steer it while it runs."""

from __future__ import annotations

import re
import time
from pathlib import Path

from PySide6.QtGui import QFontDatabase
from PySide6.QtWidgets import (
    QComboBox,
    QFileDialog,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QPlainTextEdit,
    QProgressBar,
    QStackedWidget,
    QVBoxLayout,
    QWidget,
)

from gui.models import background
from gui.models.plan_draft import PlanDraft, Verdict
from gui.models.words import duration, home_short, size, typed
from gui.widgets.layout import button, card, dim, heading, title
from gui.widgets.progress_grid import ProgressGrid
from gui.widgets.prompt_bar import PromptBar
from gui.workbench import Workbench
from polfuse_lab import remembered
from polfuse_lab.engine.protocol import Finished, StatusEvent
from polfuse_lab.rig.examples import OTHER_PLANS, example_plan

QUAD = ("HH", "HV", "VH", "VV")
NOTES_SHOWN = 4
LAST_PLAN = "collect.plan"
"""Name among what is remembered."""


class CollectPage(QWidget):
    """The plan while nothing runs, the progress while something does."""

    def __init__(self, bench: Workbench, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._bench = bench
        self._finished: Finished | None = None
        self._notes: list[str] = []
        self._channels: tuple[str, ...] = QUAD
        self.draft = PlanDraft(self)
        self.draft.judged.connect(self._judged)
        self._stack = QStackedWidget()
        self._stack.addWidget(self._plan_view())
        self._stack.addWidget(self._run_view())
        column = QVBoxLayout(self)
        column.setContentsMargins(24, 20, 24, 16)
        column.addWidget(title(self.tr("Collect")))
        column.addWidget(self._stack, 1)
        bench.rig_changed.connect(lambda _: self._changed())
        bench.engine.attached.connect(self._begun)
        bench.engine.status.connect(self._show)
        bench.engine.finished.connect(self._ended)
        bench.engine.failed.connect(lambda *_: self._idle())
        self._begin_with(str(remembered.Settings.load().get(LAST_PLAN, "")))

    @property
    def outcome(self) -> Finished | None:
        """How the last collect ended; None while it runs."""
        return self._finished

    @property
    def done_share(self) -> float:
        """Share of the collect's steps that are done."""
        return self.bar.value() / max(self.bar.maximum(), 1)

    # -- the plan -----------------------------------------------------------------------------------------------------

    def _plan_view(self) -> QWidget:
        self.kinds = QComboBox()
        self.kinds.addItem(self.tr("rail SAR, stop and go"), "plan")
        self.kinds.addItem(self.tr("sky noise"), "sky")
        for kind in OTHER_PLANS:
            self.kinds.addItem(kind.replace("_", " "), kind)
        self.kinds.setToolTip(self.tr("Begin with an example of this kind of plan"))
        self.kinds.activated.connect(lambda _: self._choose_kind())
        self.text = QPlainTextEdit()
        self.text.setFont(QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont))
        self.text.setLineWrapMode(QPlainTextEdit.LineWrapMode.NoWrap)
        self.text.setAccessibleName(self.tr("plan"))
        self.text.textChanged.connect(self._changed)
        self.output = QLineEdit()
        self.output.setToolTip(self.tr("The session file that is written; it is never overwritten"))
        self.output.textChanged.connect(lambda _: self._changed())
        self.verdict = QLabel()
        self.verdict.setWordWrap(True)
        self.start_button = button(self.tr("Start the collect"), self.start, role="primary", key="F5")
        choose = QHBoxLayout()
        choose.addWidget(self.kinds, 1)
        choose.addWidget(button(self.tr("Open…"), self._open, self.tr("Open a plan file")))
        choose.addWidget(button(self.tr("Save…"), self._save, self.tr("Save this plan as a file")))
        where = QHBoxLayout()
        where.addWidget(self.output, 1)
        where.addWidget(button(self.tr("Browse…"), self._browse))
        self.verdict_title = heading(self.tr("What it will do"))
        left = card(heading(self.tr("Plan")), choose, self.text, stretch=2)
        right = card(
            self.verdict_title,
            self.verdict,
            heading(self.tr("Session file")),
            where,
            dim(self.tr("Closing this window does not end a collect: it runs in a process of its own.")),
            self.start_button,
        )
        right.setMinimumWidth(330)
        column = QVBoxLayout()
        column.addWidget(right)
        column.addStretch(1)
        view = QWidget()
        row = QHBoxLayout(view)
        row.setContentsMargins(0, 0, 0, 0)
        row.addWidget(left, 3)
        row.addLayout(column, 2)
        return view

    def _begin_with(self, last: str) -> None:
        """The plan that was written last, else the first example."""
        self._remembered = last
        if not last.strip():
            self._choose_kind()
            return
        kind = re.search(r'^\s*kind\s*=\s*"(\w+)"', last, re.MULTILINE)
        self.kinds.setCurrentIndex(max(self.kinds.findData(kind[1] if kind else None), 0))
        self.text.setPlainText(last)
        self.propose_name()

    def _remember(self, text: str) -> None:
        """Keep what is written for the next start of the program; an example as it came need not be kept."""
        if text == example_plan(self.kinds.currentData()):
            text = ""
        if text == self._remembered:
            return
        self._remembered = text

        def keep() -> str:
            settings = remembered.Settings.load()
            settings.set(LAST_PLAN, text or None)
            settings.save()
            return settings.warning

        background.run(self, keep, lambda warning: self._bench.error.emit(warning, "") if warning else None,
                       self._bench.error.emit)  # fmt: skip

    def _choose_kind(self) -> None:
        self.text.setPlainText(example_plan(self.kinds.currentData()))
        self.propose_name()

    def propose_name(self) -> None:
        """A name for the next session file that is not taken."""
        settings = remembered.Settings.load()
        folder = typed(str(settings.get("sessions_folder", "~/polfuse-sessions")))
        self.output.setText(home_short(folder / time.strftime("%Y-%m-%d-%H%M%S.h5")))

    def _changed(self) -> None:
        self.start_button.setEnabled(False)
        output = typed(self.output.text() or "session.h5")
        # A folder that is not there yet is made on the way: room is looked for where it will stand.
        while not output.parent.is_dir() and output.parent != output.parent.parent:
            output = output.parent
        self.draft.change(self.text.toPlainText(), self._bench.rig, output)

    def _judged(self, verdict: Verdict) -> None:
        self._remember(self.text.toPlainText())
        self.start_button.setEnabled(verdict.ready and not self._bench.engine.busy)
        outcome = verdict.outcome
        if outcome is None:
            self.verdict_title.setText(self.tr("Not yet"))
            self.verdict.setText("\n\n".join(verdict.problems))
            return
        planned = outcome.planned
        lines = [
            self.tr("{0} positions, {1} audio records, {2} camera frames").format(
                planned.positions, outcome.records, planned.frames + planned.dark_frames
            ),
            self.tr("takes about {0}").format(duration(outcome.seconds)),
            self.tr("at most {0}; {1} are free").format(size(outcome.bytes), size(outcome.free_bytes)),
        ]
        if outcome.questions:
            lines.append(self.tr("asks the operator {0} times").format(outcome.questions))
        lines += [self.tr("Note: {0}").format(words) for words in outcome.warnings]
        lines += [self.tr("Problem: {0}").format(words) for words in verdict.problems]
        self.verdict_title.setText(self.tr("What it will do") if verdict.ready else self.tr("Not yet"))
        self.verdict.setText("\n".join(lines))

    def _open(self) -> None:
        name, _ = QFileDialog.getOpenFileName(self, self.tr("Open a plan"), "", self.tr("Plan files (*.toml)"))
        if name:
            self.text.setPlainText(Path(name).read_text(encoding="utf-8", errors="replace"))

    def _save(self) -> None:
        name, _ = QFileDialog.getSaveFileName(
            self, self.tr("Save the plan"), "plan.toml", self.tr("Plan files (*.toml)")
        )
        if name:
            try:
                Path(name).write_text(self.text.toPlainText(), encoding="utf-8")
            except OSError as error:
                self._bench.error.emit(self.tr("{0} cannot be written ({1})").format(name, error.strerror), "")

    def _browse(self) -> None:
        name, _ = QFileDialog.getSaveFileName(
            self, self.tr("Session file"), str(typed(self.output.text())), "HDF5 (*.h5)"
        )
        if name:
            self.output.setText(home_short(name))

    def start(self) -> None:
        """Begin the collect that is planned."""
        verdict = self.draft.verdict
        if verdict is None or not verdict.ready or verdict.plan is None or self._bench.rig is None:
            return
        output = typed(self.output.text())
        try:
            output.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            self._bench.error.emit(self.tr("{0} cannot be made ({1})").format(output.parent, error.strerror), "")
            return
        self.start_button.setEnabled(False)
        self.start_button.setText(self.tr("Starting…"))
        if self._bench.rig != self._bench.simulated:
            remembered.remember_rig(self._bench.rig)
        self._bench.begin_collect(verdict.plan, output)

    # -- the run ------------------------------------------------------------------------------------------------------

    def _run_view(self) -> QWidget:
        self.prompts = PromptBar()
        self.prompts.confirmed.connect(self._bench.engine.answer)
        self.doing = QLabel()
        self.doing.setProperty("role", "big")
        self.doing.setWordWrap(True)
        self.bar = QProgressBar()
        self.times = QLabel()
        self.grid = ProgressGrid()
        self.warnings = QPlainTextEdit()
        self.warnings.setReadOnly(True)
        self.warnings.setPlaceholderText(self.tr("No warnings"))
        self.pause_button = button(self.tr("Pause"), self._pause, self.tr("After the present step"), key="F6")
        self.abort_button = button(
            self.tr("Abort"),
            self._bench.engine.abort,
            self.tr("Stop now; what has been recorded is kept"),
            "danger",
            "F8",
        )
        self.note = QLineEdit()
        self.note.setPlaceholderText(self.tr("A note for the session, kept with the time of day…"))
        self.note.returnPressed.connect(self._note)
        self.done_button = button(self.tr("Back to the plan"), self._idle)
        self.look_button = button(self.tr("Look at the session"), self._look, role="primary")
        buttons = QHBoxLayout()
        for made in (self.pause_button, self.abort_button):
            buttons.addWidget(made)
        buttons.addStretch(1)
        for made in (self.done_button, self.look_button):
            buttons.addWidget(made)
        notes = QHBoxLayout()
        notes.addWidget(self.note, 1)
        self.note_button = button(self.tr("Add note"), self._note)
        notes.addWidget(self.note_button)
        self.noted = dim("")
        self.noted.hide()
        view = QWidget()
        column = QVBoxLayout(view)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(self.prompts)
        column.addWidget(card(self.doing, self.bar, self.times, self.grid, buttons))
        column.addWidget(card(heading(self.tr("Notes")), notes, self.noted))
        column.addWidget(card(heading(self.tr("Warnings")), self.warnings, stretch=1), 1)
        return view

    def _begun(self, _: object) -> None:
        if self._bench.engine.replaying:
            return
        self.start_button.setText(self.tr("Start the collect"))
        verdict = self.draft.verdict
        plan = verdict.plan if verdict is not None else None
        channels = self._channels = tuple(getattr(plan, "channels", QUAD))
        positions = verdict.outcome.planned.positions if verdict is not None and verdict.outcome is not None else 0
        self.grid.begin(positions, channels)
        self.warnings.clear()
        self._tell_notes([])
        self._finished = None
        self.bar.setValue(0)
        self._running(True)
        self._stack.setCurrentIndex(1)

    def _running(self, running: bool) -> None:
        for made in (self.pause_button, self.abort_button, self.note, self.note_button):
            made.setEnabled(running)
        for made in (self.done_button, self.look_button):
            made.setVisible(not running)

    def _show(self, status: StatusEvent) -> None:
        if self._bench.engine.replaying:
            return
        self.doing.setText(status.reason or status.state)
        self.bar.setMaximum(max(status.steps, 1))
        self.bar.setValue(status.step)
        self.times.setText(
            self.tr("{0} gone, {1} to go; {2} records, {3} frames").format(
                duration(status.elapsed_s), duration(status.eta_s), status.sweeps, status.frames
            )
        )
        if status.positions != self.grid.positions:  # a run that was not begun here
            self.grid.begin(status.positions, self._channels)
        if status.channel and status.position >= 0 and status.state == "running":
            self.grid.mark(status.position, status.channel, "now")
        text = "\n".join(status.warnings)
        if text != self.warnings.toPlainText():
            self.warnings.setPlainText(text)
        self.pause_button.setText(self.tr("Go on") if status.state == "paused" else self.tr("Pause"))
        self._paused = status.state == "paused"
        self.prompts.show_prompts([(prompt.ticket, prompt.text) for prompt in status.prompts])

    _paused = False

    def _pause(self) -> None:
        if self._paused:
            self._bench.engine.resume()
        else:
            self._bench.engine.pause()
            self.pause_button.setText(self.tr("Pausing…"))

    def _note(self) -> None:
        if self.note.text().strip():
            text = self.note.text().strip()
            self._bench.engine.note(text)
            self.note.clear()
            self._tell_notes([*self._notes, f"{time.strftime('%H:%M:%S')}  {text}"])

    def _tell_notes(self, notes: list[str]) -> None:
        self._notes = notes
        self.noted.setText("\n".join(notes[-NOTES_SHOWN:]))
        self.noted.setVisible(bool(notes))

    def _ended(self, outcome: Finished) -> None:
        if self._bench.engine.replaying:
            return
        self._finished = outcome
        self.grid.finish(whole=outcome.state == "finished")
        self.prompts.show_prompts([])
        self._running(False)
        lost = outcome.samples_lost + outcome.frames_lost
        words = {
            "finished": self.tr("Finished: everything is recorded"),
            "aborted": self.tr("Aborted: what was recorded is kept"),
        }.get(outcome.state, self.tr("Failed: {0}").format(outcome.reason))
        self.doing.setText(words)
        self.bar.setValue(self.bar.maximum() if outcome.state == "finished" else self.bar.value())
        self.times.setText(
            self.tr("{0} positions, {1} records, {2} frames in {3}; {4}").format(
                outcome.positions,
                outcome.sweeps,
                outcome.frames,
                duration(outcome.seconds),
                self.tr("nothing lost") if lost == 0 else self.tr("lost: {0}").format(lost),
            )
        )
        self.warnings.setPlainText("\n".join(outcome.warnings))
        self.look_button.setEnabled(outcome.session is not None)
        if outcome.session is not None:
            remembered.remember_session(Path(outcome.session))

    def _idle(self) -> None:
        self.start_button.setText(self.tr("Start the collect"))
        if not self._bench.engine.busy:
            self._stack.setCurrentIndex(0)
            self.propose_name()

    def _look(self) -> None:
        if self._finished is not None and self._finished.session is not None:
            self._bench.open_session(Path(self._finished.session))
            self._bench.page_wanted.emit("session")
