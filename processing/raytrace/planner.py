"""How many rays and bounces a picture needs: chosen from a first look, checked while the samples come in.

Errors are root mean square over all pixels and Stokes parameters, below the picture's own root mean square, dB. That
of N samples after b bounces is ``V / N + B(b)^2``: V is the variance of one sample, summed over the picture; B(b) the
light that takes more than b reflections. Both are measured by a first look, V again by every sample that follows, so
that the error told with the picture is that of its own samples. Of all numbers of bounces the one is taken whose rays
cost least.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.raytrace.backward import Run, upper_limit
from processing.raytrace.materials import LOBE, Lobe
from processing.raytrace.picture import LeftOut, Picture, unmet_limit
from processing.raytrace.sources import KIND, SIZE, Kind
from processing.raytrace.view import View
from processing.raytrace.world import World
from processing.tolerances import check_tolerance

Floats = NDArray[np.float64]

PILOT_PATHS = 2048
"""Rays from the camera of the first look, at least."""
PILOT_SAMPLES = 4
"""Of a pixel, at least: fewer tell too little of its variance."""
PILOT_PIXELS = 4096
"""Larger pictures are first looked at with pixels of their own, this many at most."""
MOST_BOUNCES = 40
"""That the first look follows; what lies beyond is extrapolated."""
SAFETY_DB = 0.7
"""How far below the tolerance the expected error must be."""


@dataclass(frozen=True)
class Pilot:
    """What the first look found."""

    tail: Floats
    """(MOST_BOUNCES + 1,) rms of the light after more than so many reflections, over the picture's rms."""
    cost: Floats
    """(MOST_BOUNCES + 1,) rays that a path of up to so many reflections takes."""
    left_out: tuple[LeftOut, ...]
    """All light by reflections and source, and what was not met; of it a picture leaves out what it does not follow."""
    samples: int
    """Of a pixel that serve the picture, too; 0 where the look had other pixels."""
    rays: int
    """Traced, to sources too."""


@dataclass(frozen=True)
class TracePlan:
    """What was chosen, what it was expected to leave, and what its samples tell that it leaves."""

    tolerance_db: float
    bounces: int
    samples: int
    """Rays for each pixel that were taken."""
    predicted_error_db: float
    """From the picture's own samples and the light left out; -inf where every sample agrees and nothing is left out."""
    noise_db: float
    """Its part from the number of rays."""
    left_out_db: float
    """Its part from the bounces left out."""
    forecast_db: float
    """What the first look expected of the samples that it asked for."""
    forecast_samples: int
    """Those samples."""
    rays: int
    """All, the first look's too."""
    pilot_rays: int
    considered: tuple[tuple[int, float, float], ...]
    """Bounces, their light left out (dB) and their rays over the chosen one's; infinite where they cannot do."""
    caustics: bool = False
    """Whether mirrors may throw a sun's disc on other surfaces: met so seldom that no error is foretold of it."""

    @property
    def reached(self) -> bool:
        """Whether the tolerance is kept."""
        return self.predicted_error_db <= self.tolerance_db

    def explain(self) -> list[str]:
        """The choice in words."""
        if not self.samples:
            return [f"no light was met by {self.pilot_rays} rays: nothing to choose by"]
        lines = [
            f"{self.samples} rays of a pixel, {self.bounces} bounces: expected error {self.predicted_error_db:.1f} dB, "
            f"tolerance {self.tolerance_db:g} dB" + ("" if self.reached else ", which is not reached"),
            f"noise of the rays {self.noise_db:.1f} dB, light of further bounces {self.left_out_db:.1f} dB; the first "
            f"look ({self.pilot_rays} rays) asked for {self.forecast_samples} rays of a pixel",
        ]
        for bounces, left_db, cost in self.considered:
            if abs(bounces - self.bounces) > 2 or bounces == self.bounces:
                continue
            why = f"{cost:.2f} times the rays" if math.isfinite(cost) else "too much for any number of rays"
            lines.append(f"not {bounces} bounces: leaves out light of {left_db:.1f} dB, {why}")
        if self.caustics:
            lines.append(
                "mirrors may throw the sun on other surfaces: few rays meet that light, and no error is foretold of it"
            )
        return lines


def trace_to(
    world: World,
    view: View,
    tolerance_db: float,
    *,
    mueller: bool = False,
    most_samples: int = 65536,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> tuple[Picture, TracePlan]:
    """Trace from the camera with the fewest rays and bounces whose expected error is within the tolerance.

    Args:
        world: the scene.
        view: the camera.
        tolerance_db: largest error, dB below the picture (negative).
        mueller: Mueller matrices instead of Stokes vectors.
        most_samples: where to stop (the plan tells whether the tolerance is reached).
        seed: of the random numbers.
        progress: called with the fraction done.

    Returns:
        The picture (what it leaves out among it), and the plan.

    Raises:
        DataError: a tolerance that is no negative number, or a Mueller picture of several sources.
    """
    check_tolerance(tolerance_db, "picture")
    if mueller and len(world.sources) != 1:
        raise DataError(
            f"a Mueller picture of {len(world.sources)} sources mixes their frames", "simulate one source at a time"
        )
    begun = time.perf_counter()
    allowed = 10 ** ((tolerance_db - SAFETY_DB) / 20)
    every = np.ones((MOST_BOUNCES + 1, len(world.sources)), dtype=bool)
    run = Run(world, view, mueller, seed, every)
    pilot = _look(run)
    # Bounces are told apart before the rays of the picture itself: all of them would cost as many rays.
    considered = _considered(pilot, allowed)
    bounces = _cheapest(considered, pilot)
    run.wanted = every[: bounces + 1]
    if not pilot.samples:
        run.add(PILOT_SAMPLES)
    asked, forecast = 0, -math.inf
    while True:
        noise, left = _error(run, pilot, bounces)
        if math.isnan(noise):
            break
        room = allowed**2 - left**2
        most = most_samples if room > 0 else run.samples
        needed = min(max(math.ceil(run.samples * noise**2 / room) if room > 0 else run.samples, run.samples), most)
        if not asked:
            asked = needed
            forecast = _db(math.hypot(noise * math.sqrt(run.samples / needed), left))
        if needed <= run.samples:
            break
        if progress:
            progress(min(run.samples / needed, 1.0))
        # Step by step: single bright rays make the first variances too large as often as too small.
        run.add(min(needed, 2 * run.samples) - run.samples)
    mean, deviation = run.statistics()
    out = tuple(part for part in pilot.left_out if part.bounce > bounces or not part.met)
    traced = run.rays + (0 if pilot.samples else pilot.rays)
    picture = Picture(mean, deviation, run.samples, traced, time.perf_counter() - begun, out)
    dark = math.isnan(noise)
    chosen = next((cost for b, _, cost in considered if b == bounces), math.inf)
    plan = TracePlan(
        tolerance_db=tolerance_db,
        bounces=bounces,
        samples=0 if dark else run.samples,
        predicted_error_db=math.nan if dark else _db(math.hypot(noise, left)),
        noise_db=math.nan if dark else _db(noise),
        left_out_db=math.nan if dark else _db(left),
        forecast_db=forecast,
        forecast_samples=asked,
        rays=traced,
        pilot_rays=pilot.rays,
        considered=tuple((b, left_db, cost / chosen) for b, left_db, cost in considered),
        caustics=_caustics(world),
    )
    return picture, plan


def _look(run: Run) -> Pilot:
    """The first look: with the picture's own pixels where these are few, and then its samples are the picture's."""
    view = run.given
    pixels = view.width_px * view.height_px
    same = pixels <= PILOT_PIXELS
    if not same:
        part = math.sqrt(PILOT_PIXELS / pixels)
        view = replace(view, width_px=math.ceil(view.width_px * part), height_px=math.ceil(view.height_px * part))
    look = run if same else Run(run.world, view, False, run.seed + 1, run.wanted)
    samples = max(PILOT_SAMPLES, math.ceil(PILOT_PATHS / len(look.sums)))
    sums, squares = shares = look.shares()
    look.add(samples, shares)
    paths = len(look.sums) * samples
    lamps = int(np.sum(look.world.sources[:, KIND] != Kind.SKY))
    # A path that goes on after k reflections is one ray, and one more to every lamp from where it ends.
    alive = sums[..., -1].sum(axis=0) / paths
    cost = np.cumsum(alive) + lamps * np.concatenate([[0.0], np.cumsum(alive[1:])])
    light, spread = sums[..., :-1], squares[..., :-1]
    total = light.sum(axis=(1, 2)) / samples
    level = float(total.mean())
    if level <= 0:
        return Pilot(np.zeros(len(cost)), cost, (), samples if same else 0, look.rays)
    size = math.sqrt(max(float(np.mean(total**2)) - _noise(light, spread, samples), level**2))
    tail = np.array([_tail(light, spread, samples, b) for b in range(len(cost))])
    tail /= size + tail[-1]
    limits = upper_limit(light, spread, samples) / level
    unmet = unmet_limit(math.sqrt(float(look.squares[:, 0].max())), level, len(look.sums), samples)
    left_out = tuple(_parts(limits, light.any(axis=0), unmet, paths))
    return Pilot(tail, cost, left_out, samples if same else 0, look.rays)


def _noise(light: Floats, spread: Floats, samples: int) -> float:
    """Variance of a pixel's mean, mean over the picture; lights' own noises taken as independent."""
    variance = spread / samples - (light / samples) ** 2
    return float(np.mean(np.maximum(variance, 0.0).sum(axis=(1, 2)))) / (samples - 1)


def _tail(light: Floats, spread: Floats, samples: int, bounces: int) -> float:
    """rms over pixels of S0 after more than ``bounces`` reflections."""
    further, squares = light[:, bounces + 1 :], spread[:, bounces + 1 :]
    mean = further.sum(axis=(1, 2)) / samples
    square = float(np.mean(mean**2)) - (_noise(further, squares, samples) if further.size else 0.0)
    by_bounce = light.mean(axis=0).sum(axis=1) / samples
    return math.sqrt(max(square, float(mean.mean()) ** 2)) + _beyond(by_bounce)


def _beyond(by_bounce: Floats) -> float:
    """Mean light of more reflections than were followed: the last twenty go on as a geometric series."""
    before, last = float(by_bounce[-20:-10].sum()), float(by_bounce[-10:].sum())
    if not last > 0:
        return 0.0
    ratio = min(last / max(before, 1e-300), 0.98)
    return last * ratio / (1 - ratio)


def _parts(limits: Floats, met: NDArray[np.bool_], unmet: float, rays: int) -> list[LeftOut]:
    """All light that was met, and of each source the reflections from which on no ray met it."""
    found = []
    for source in range(limits.shape[1]):
        seen = np.flatnonzero(met[:, source])
        found += [LeftOut(int(b), source, float(limits[b, source]), True, rays) for b in seen]
        first = int(seen[-1]) + 1 if len(seen) else 0
        if first < len(limits):
            found.append(LeftOut(first, source, unmet, False, rays))
    return found


def _considered(pilot: Pilot, allowed: float) -> list[tuple[int, float, float]]:
    """Bounces, the light that they leave out (dB), and what a picture of theirs costs (rays times a variance)."""
    found = []
    for bounces, (left, cost) in enumerate(zip(pilot.tail, pilot.cost, strict=True)):
        room = allowed**2 - float(left) ** 2
        found.append((bounces, _db(float(left)), float(cost) / room if room > 0 else math.inf))
        if left == 0:
            break
    return found


def _cheapest(considered: list[tuple[int, float, float]], pilot: Pilot) -> int:
    """The bounces that cost least; where none can do, as many as were looked at."""
    best = min(considered, key=lambda one: one[2])
    return best[0] if math.isfinite(best[2]) else len(pilot.tail) - 1


def _error(run: Run, pilot: Pilot, bounces: int) -> tuple[float, float]:
    """Noise and light left out of what a run has, over the picture's rms; NaN without any light."""
    mean, deviation = run.statistics()
    noise = float(np.sum(deviation**2))
    size = float(np.sum(mean**2)) - noise
    if not float(np.sum(mean**2)) > 0:
        return math.nan, math.nan
    # Where noise is most of what there is, the picture cannot be told from it.
    size = max(size, 0.05 * float(np.sum(mean**2)))
    # The first look's samples followed all bounces.
    share = 1 - pilot.samples / run.samples
    return math.sqrt(noise / size), float(pilot.tail[bounces]) * share


def _caustics(world: World) -> bool:
    """Whether a smooth surface may throw the disc of a sun on one that is not."""
    sun = (world.sources[:, KIND] == Kind.SUN) & (world.sources[:, SIZE] > 0)
    smooth = world.materials[:, LOBE] == Lobe.SMOOTH
    return bool(sun.any() and smooth.any())


def _db(value: float) -> float:
    return 20 * math.log10(value) if value > 0 else -math.inf
