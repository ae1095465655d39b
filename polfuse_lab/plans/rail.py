"""Stop-and-go collect along the rail."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from pydantic import Field, model_validator

from polfuse_lab.plans.base import ChannelsPlan, Visit
from polfuse_lab.plans.optics import OpticsPlan
from polfuse_lab.plans.steps import Checkpoint, MoveTo, Settle, Step

TrackOrder = Literal["forward", "reverse", "serpentine"]


class RailSarPlan(ChannelsPlan):
    """``rail_sar``: the trolley stops at each position along the rail and every channel is recorded there."""

    kind: Literal["rail_sar"] = "rail_sar"
    """Stop and go along the rail."""
    aperture_m: float = Field(default=3.048, ge=0)
    """Length of the synthetic aperture, m (thesis: 10 ft)."""
    step_m: float = Field(default=0.0508, gt=0)
    """Distance between positions, m (thesis: 2 in)."""
    track_order: TrackOrder = "forward"
    """"forward" (to larger x), "reverse", or "serpentine": each pass begins where the last one ended."""
    passes: int = Field(default=1, ge=1, le=1000)
    """How often the rail is run over; records of one place are averaged when they are read."""
    move_settle_s: float = Field(default=0.2, ge=0, le=60)
    """Wait after the trolley stands, s."""
    optics: OpticsPlan | None = None
    """Polarizer series at the aperture's centre, in the first pass of each repeat; left out for radar only."""

    @model_validator(mode="after")
    def _sound(self) -> RailSarPlan:
        if self.step_m > max(self.aperture_m, 1e-9):
            raise ValueError(f"step_m ({self.step_m}) is at most aperture_m ({self.aperture_m})")
        return self

    @property
    def uses_camera(self) -> bool:
        """Whether there is a polarizer series."""
        return self.optics is not None

    @property
    def places_m(self) -> tuple[float, ...]:
        """Places along the rail, m, symmetric about the aperture's centre (10 ft in 2 in steps: 61 places)."""
        return places_along(self.aperture_m, self.step_m)

    def visits(self) -> tuple[Visit, ...]:
        """Every stay at every place: places in the order of the track, pass after pass."""
        places = self.places_m
        found: list[Visit] = []
        for repeat in range(self.repeats):
            for number in range(self.passes):
                for place in in_track_order(range(len(places)), self.track_order, number):
                    found.append(Visit(len(found), places[place], place, repeat))
        return tuple(found)

    def unpaused_steps(self, mosaic: bool) -> Iterator[Step]:
        """Move, settle, record every channel; the polarizer series at the place nearest to the centre."""
        places = self.places_m
        centre = min(range(len(places)), key=lambda place: abs(places[place]))
        seen = -1
        for visit in self.visits():
            yield MoveTo(visit.x_m, visit.position)
            if self.move_settle_s:
                yield Settle(self.move_settle_s)
            optics = self.optics if visit.place == centre and visit.repeat != seen else None
            if optics is not None:
                seen = visit.repeat
                yield from optics.early_steps(mosaic=mosaic)
            yield from self.record_channels(visit.position)
            if optics is not None:
                yield from optics.steps(mosaic=mosaic)
            yield Checkpoint(visit.position)


def places_along(aperture_m: float, step_m: float) -> tuple[float, ...]:
    """Places with a step between them that fit into an aperture, m, symmetric about its centre; at least one."""
    # The tolerance lets 3.048 / 0.0508 be 60 in binary floating point.
    steps = int(aperture_m / step_m + 1e-6)
    return tuple((i - steps / 2) * step_m for i in range(steps + 1))


def in_track_order(places: range, order: TrackOrder, number: int) -> range:
    """Places in the order of pass ``number`` (from 0) over the rail."""
    backwards = order == "reverse" or (order == "serpentine" and number % 2 == 1)
    return places[::-1] if backwards else places
