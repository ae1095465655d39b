"""Series of calibration targets, one after the other on the same place (thesis 5.5)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from pydantic import Field, model_validator

from polfuse_lab.plans.base import ChannelsPlan, Visit
from polfuse_lab.plans.rail import places_along
from polfuse_lab.plans.steps import Ask, Checkpoint, Mark, MoveTo, Settle, Step
from polfuse_lab.rig import FileModel

TargetKind = Literal["trihedral", "trihedral_square", "dihedral", "dihedral_45", "plate"]

_WORDS = {
    "trihedral": "trihedral with triangular faces",
    "trihedral_square": "trihedral with square faces",
    "dihedral": "dihedral, its fold upright",
    "dihedral_45": "dihedral, its fold at 45 degrees",
    "plate": "plate",
}


class SeriesTarget(FileModel):
    """One target of a calibration series."""

    name: str = Field(min_length=1, max_length=100)
    """Its name in prompts, marks and results."""
    kind: TargetKind
    """"trihedral" (triangular faces), "trihedral_square", "dihedral" (fold upright), "dihedral_45", or "plate"."""
    edge_m: float = Field(gt=0)
    """Length of its edges, m (a triangular trihedral's: from the corner to a tip)."""
    range_m: float = Field(gt=0)
    """Ground range from the rail, m (thesis: 12 ft)."""
    x_m: float = 0.0
    """Place along the rail, m."""
    height_m: float = Field(default=0.0, ge=0)
    """Height of its phase centre (corner; middle of the fold or face) above the ground, m."""
    azimuth_deg: float = Field(default=0.0, ge=-90, le=90)
    """Direction to the aperture's centre in its own frame, degrees: from an edge (trihedral) or its boresight."""
    elevation_deg: float = Field(default=0.0, ge=-90, le=90)
    """Likewise, above its lower face (trihedral) or its boresight, degrees."""
    angle_sd_deg: float = Field(default=0.0, ge=0, le=45)
    """Standard deviation of these angles and of a fold's, degrees (thesis: 5)."""
    position_sd_m: float = Field(default=0.0, ge=0, le=10)
    """Standard deviation of its place along x and y, m."""
    edge_sd_m: float = Field(default=0.0, ge=0, le=1)
    """Standard deviation of its edge, m."""

    @property
    def prompt(self) -> str:
        """What the operator is asked to do."""
        return (
            f"Place {self.name} ({_WORDS[self.kind]}, edge {self.edge_m:g} m) at a ground range of {self.range_m:g} m,"
            f" x = {self.x_m:g} m, and take all others away; then confirm."
        )


class CalibrationSeriesPlan(ChannelsPlan):
    """``calibration_series``: targets of known RCS, one after the other, each ``repeats`` times, from one position or
    along a small aperture. Records of one place and target are averaged when they are read."""

    kind: Literal["calibration_series"] = "calibration_series"
    """Targets of known RCS."""
    targets: tuple[SeriesTarget, ...] = Field(min_length=1)
    """The targets, in this order."""
    aperture_m: float = Field(default=0.0, ge=0)
    """Length of the synthetic aperture, m; 0 records from the rail's centre alone."""
    step_m: float = Field(default=0.0508, gt=0)
    """Distance between positions, m (thesis: 2 in)."""
    move_settle_s: float = Field(default=0.2, ge=0, le=60)
    """Wait after the trolley stands, s."""
    place_again: bool = False
    """Ask to take the target away and place it again for each repeat, so that repeats show how well it is placed."""

    @model_validator(mode="after")
    def _sound(self) -> CalibrationSeriesPlan:
        names = [target.name for target in self.targets]
        if len(set(names)) != len(names):
            raise ValueError(f"targets have different names, found {names}")
        if self.aperture_m and self.step_m > self.aperture_m:
            raise ValueError(f"step_m ({self.step_m}) is at most aperture_m ({self.aperture_m}), or aperture_m is 0")
        return self

    def visits(self) -> tuple[Visit, ...]:
        """Target after target; for each its repeats, and in each the places along the rail."""
        places = places_along(self.aperture_m, self.step_m)
        found: list[Visit] = []
        for target in self.targets:
            for repeat in range(self.repeats):
                for place, x_m in enumerate(places):
                    found.append(Visit(len(found), x_m, place, repeat, target.name))
        return tuple(found)

    def unpaused_steps(self, mosaic: bool) -> Iterator[Step]:
        """Ask for the target, mark whose records follow, record."""
        targets = {target.name: target for target in self.targets}
        for visit in self.visits():
            if visit.place == 0 and (visit.repeat == 0 or self.place_again):
                yield Ask(targets[visit.target].prompt)
            if visit.place == 0:
                yield Mark(f"target {visit.target}, repeat {visit.repeat + 1} of {self.repeats}")
            yield MoveTo(visit.x_m, visit.position)
            if self.move_settle_s:
                yield Settle(self.move_settle_s)
            yield from self.record_channels(visit.position)
            yield Checkpoint(visit.position)
