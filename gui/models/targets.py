"""Calibration targets as a user states them, and what was found of each in the focused image."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from PySide6.QtCore import QObject, Signal

from gui.models import background
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
    """A target and what was found; ``view`` is None while it is being looked for."""

    stated: Stated
    view: TargetView | None = None

    @property
    def good(self) -> bool:
        """Whether it was found and is what it is said to be."""
        return self.view is not None and self.view.verdict.ok

    @property
    def words(self) -> str:
        """What was found, in one line."""
        return "…" if self.view is None else options.told(self.view)


class TargetList(QObject):
    """The targets of one products file."""

    changed = Signal()
    failed = Signal(str, str)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.targets: list[Looked] = []
        self._products: Path | None = None

    def look_at(self, products: Path) -> None:
        """Begin with another file."""
        self._products = products
        self.targets = []
        self.changed.emit()

    def add(self, stated: Stated) -> None:
        """Look for a target, and list it with what was found. One constant and one check at most: the newest."""
        products = self._products
        if products is None:
            return
        if stated.role != "crosstalk":
            self.targets = [other for other in self.targets if other.stated.role != stated.role]
        waiting = Looked(stated)
        self.targets.append(waiting)
        self.changed.emit()

        def look() -> TargetView:
            from polfuse_lab.products.calibration_inputs import read_focused
            from polfuse_lab.products.calibration_targets import look_in_image

            return look_in_image(
                read_focused(Products(products)), stated.spec(), radius_m=RADIUS_M, min_snr_db=MIN_SNR_DB
            )

        def done(view: TargetView) -> None:
            self.targets = [Looked(stated, view) if other is waiting else other for other in self.targets]
            self.changed.emit()

        def failed(sentence: str, details: str) -> None:
            self.targets = [other for other in self.targets if other is not waiting]
            self.changed.emit()
            self.failed.emit(sentence, details)

        background.run(look, done, failed)

    def remove(self, index: int) -> None:
        """Take a target away."""
        if 0 <= index < len(self.targets):
            del self.targets[index]
            self.changed.emit()

    @property
    def ready(self) -> bool:
        """Whether there is what a calibration needs: a good target for the constant, and nothing that waits."""
        return all(looked.view is not None for looked in self.targets) and any(
            looked.good and looked.stated.role == "constant" for looked in self.targets
        )

    def job(self) -> jobs.JobSpec:
        """The calibration on the targets that were found good; refused ones are left out."""
        assert self._products is not None
        good = [looked.stated for looked in self.targets if looked.good]
        main = next(stated for stated in good if stated.role == "constant")
        check = next((stated for stated in good if stated.role == "check"), None)
        also = [
            f"{stated.kind}@{stated.x_m!r},{stated.y_m!r}@{stated.edge_m!r}"
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
