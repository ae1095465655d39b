"""Calibration targets as a user states them, and what was found of each in the focused image."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from PySide6.QtCore import QObject, Signal
from PySide6.QtGui import QUndoStack

from gui.models import background
from gui.models.change import Change
from polfuse_lab import jobs
from polfuse_lab.cli import calibration_options as options
from polfuse_lab.products.store import Products

if TYPE_CHECKING:  # loaded with the first target: the window opens sooner without
    from polfuse_lab.products.calibration_inputs import TargetSpec
    from polfuse_lab.products.calibration_targets import TargetView

Role = Literal["constant", "crosstalk", "check"]
KINDS: dict[Role, tuple[str, ...]] = {
    "constant": ("trihedral", "trihedral_triangular", "plate", "sphere"),
    "crosstalk": ("dihedral", "dihedral_45", "trihedral", "plate"),
    "check": ("dihedral", "trihedral", "trihedral_triangular", "plate", "sphere"),
}
"""What may stand for what."""
UPRIGHT_DEG = 90.0
RADIUS_M, MIN_SNR_DB = 1.0, 10.0
"""How far from its place a peak may be, and its least level over the background: as 'polfuse calibrate' has them."""


@dataclass(frozen=True)
class Stated:
    """One target; lengths in m, the standard deviation of its angles in degrees."""

    role: Role
    kind: str
    x_m: float
    y_m: float
    edge_m: float = 0.61
    height_m: float = 0.0
    angle_sd_deg: float = 2.0

    def spec(self) -> TargetSpec:
        """As the library takes it, on its axis. Raises :class:`processing.errors.DataError` for impossible numbers."""
        return options.spec(
            self.kind, (self.x_m, self.y_m), self.edge_m, height_m=self.height_m, angle_sd_deg=self.angle_sd_deg,
            name=self.kind,
        )  # fmt: skip


@dataclass(frozen=True)
class Looked:
    """A target and what was found; ``view`` is None while it is being looked for, or could not be."""

    stated: Stated
    view: TargetView | None = None
    error: str = ""
    """Why it could not be looked for, in one sentence."""

    @property
    def waiting(self) -> bool:
        """Whether it is still being looked for."""
        return self.view is None and not self.error

    @property
    def good(self) -> bool:
        """Whether it was found and is what it is said to be."""
        return self.view is not None and self.view.verdict.ok

    @property
    def words(self) -> str:
        """What was found, in one line."""
        return options.told(self.view) if self.view is not None else self.error or "…"


class TargetList(QObject):
    """The targets of one products file. Every change goes through :attr:`undo`."""

    changed = Signal()
    failed = Signal(str, str)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.undo = QUndoStack(self)
        self._stated: tuple[Stated, ...] = ()
        self._looked: dict[Stated, Looked] = {}
        self._products: Path | None = None

    @property
    def targets(self) -> list[Looked]:
        """Targets in the order of stating, with what was found of each."""
        return [self._looked[stated] for stated in self._stated]

    def look_at(self, products: Path) -> None:
        """Begin with another file."""
        self._products = products
        self.undo.clear()
        self._looked.clear()
        self.set_state(())

    def add(self, stated: Stated) -> None:
        """Look for a target, and list it with what was found. One constant and one check at most: the newest."""
        products = self._products
        if products is None or stated in self._stated:
            return
        alone = stated.role != "crosstalk"
        others = tuple(other for other in self._stated if not (alone and other.role == stated.role))
        known = stated in self._looked
        if not known:
            self._looked[stated] = Looked(stated)
        self._do(self.tr("look for a {0}").format(stated.kind), (*others, stated))
        if known:
            return

        def look() -> TargetView:
            from polfuse_lab.products.calibration_inputs import read_focused
            from polfuse_lab.products.calibration_targets import look_in_image

            return look_in_image(
                read_focused(Products(products)), stated.spec(), radius_m=RADIUS_M, min_snr_db=MIN_SNR_DB
            )

        def found(looked: Looked) -> None:
            if products == self._products:
                self._looked[stated] = looked
                self.changed.emit()

        def failed(sentence: str, details: str) -> None:
            found(Looked(stated, error=sentence))
            self.failed.emit(sentence, details)

        background.run(self, look, lambda view: found(Looked(stated, view)), failed)

    def remove(self, index: int) -> None:
        """Take a target away."""
        if 0 <= index < len(self._stated):
            left = self._stated[:index] + self._stated[index + 1 :]
            self._do(self.tr("remove the {0}").format(self._stated[index].kind), left)

    def set_state(self, stated: tuple[Stated, ...]) -> None:
        """What an undo or redo does; not for others."""
        self._stated = stated
        self.changed.emit()

    def _do(self, words: str, after: tuple[Stated, ...]) -> None:
        self.undo.push(Change(words, self.set_state, self._stated, after))

    @property
    def ready(self) -> bool:
        """Whether there is what a calibration needs: a good target for the constant, and nothing that waits."""
        return not any(looked.waiting for looked in self.targets) and any(
            looked.good and looked.stated.role == "constant" for looked in self.targets
        )

    def job(self) -> jobs.JobSpec:
        """The calibration on the targets that were found good; refused ones are left out."""
        assert self._products is not None
        good = [looked.stated for looked in self.targets if looked.good]
        main = next(stated for stated in good if stated.role == "constant")
        check = next((stated for stated in good if stated.role == "check"), None)
        also = [
            f"{stated.kind}@{stated.x_m!r},{stated.y_m!r}@{stated.edge_m!r}@{stated.height_m!r}"
            for stated in good
            if stated.role == "crosstalk"
        ]
        return jobs.calibrate(
            self._products,
            target=main.kind,
            at=(main.x_m, main.y_m),
            edge_m=main.edge_m,
            height_m=main.height_m,
            angle_sd_deg=main.angle_sd_deg,
            also=also or None,
            check=None if check is None else check.kind,
            check_at=None if check is None else (check.x_m, check.y_m),
            check_edge_m=None if check is None else check.edge_m,
            check_height_m=None if check is None else check.height_m,
            # A dihedral stands with its fold upright, as in what tells the crosstalk.
            check_fold_deg=UPRIGHT_DEG if check is not None and check.kind == "dihedral" else None,
        )
