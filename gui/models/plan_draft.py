"""A plan that is being written: what is wrong with it, or what it will do, a moment after each change."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from PySide6.QtCore import QObject, QTimer, Signal

from gui.models import background
from polfuse_lab.plans import Plan, parse_plan
from polfuse_lab.plans.dry_run import DryRun, dry_run
from polfuse_lab.rig import load_rig

SETTLE_MS = 300


@dataclass(frozen=True)
class Verdict:
    """What became of a draft."""

    text: str
    plan: Plan | None
    outcome: DryRun | None
    """None where the plan, or the rig, cannot be read."""
    problems: tuple[str, ...]

    @property
    def ready(self) -> bool:
        """Whether it can be collected."""
        return self.outcome is not None and not self.problems


class PlanDraft(QObject):
    """Judges the text of a plan against a rig."""

    judged = Signal(object)
    """A :class:`Verdict`, of the newest text only."""

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.verdict: Verdict | None = None
        self._text, self._rig, self._output = "", Path(), Path()
        self._asked = 0
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.setInterval(SETTLE_MS)
        self._timer.timeout.connect(self._ask)

    def change(self, text: str, rig: Path | None, output: Path) -> None:
        """The text, the rig or the place of the file has changed."""
        self.verdict = None
        self._asked += 1
        if rig is None:
            self._timer.stop()
            self.verdict = Verdict(text, None, None, (self.tr("choose a rig first, on the start page"),))
            self.judged.emit(self.verdict)
            return
        self._text, self._rig, self._output = text, rig, output
        self._timer.start()

    def _ask(self) -> None:
        number, text, rig, output = self._asked, self._text, self._rig, self._output

        def judge() -> Verdict:
            plan = parse_plan(text, self.tr("plan"))
            outcome = dry_run(load_rig(rig), plan, output=output)
            return Verdict(text, plan, outcome, outcome.problems)

        def done(verdict: Verdict) -> None:
            if number == self._asked:
                self.verdict = verdict
                self.judged.emit(verdict)

        background.run(self, judge, done, lambda sentence, _: done(Verdict(text, None, None, (sentence,))))
