"""Pictures by tracing from the camera, to the error that is asked for."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.raytrace.backward_kernel import take_samples
from processing.raytrace.picture import LeftOut, Picture, relative_error, statistics, unmet_limit
from processing.raytrace.sources import KIND, Kind
from processing.raytrace.view import View
from processing.raytrace.world import World

Floats = NDArray[np.float64]

PILOT_SAMPLES = 16
"""Samples of the first look, which decides what may be left out and how many more are needed."""

LEFT_OUT_SHARE = 0.3
"""Part of the error asked for that light left out may make; with the rest the noise has 0.95 of it."""


def backward(
    world: World,
    view: View,
    *,
    bounces: int = 4,
    samples: int | None = None,
    error: float | None = None,
    most_samples: int = 65536,
    mueller: bool = False,
    leave_out: bool = True,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Picture:
    """Trace from the camera: ``samples`` for each pixel, or as many as the ``error`` asked for needs.

    With ``error`` a first look of :data:`PILOT_SAMPLES` samples measures how much of the picture each source gives
    after each number of reflections. Light whose summed upper limits (3 sigma) stay below :data:`LEFT_OUT_SHARE` of the
    error is left out, the least first, and reported; so is light that no ray of that look met, with what may hide
    from so many rays. Then rounds are added until the standard error is low enough.

    Args:
        world: the scene.
        view: the camera.
        bounces: most reflections; 0 sees only sky and sun.
        samples: rays for each pixel.
        error: rms over pixels of the worst component's error, over the picture's mean S0.
        most_samples: where to stop if the error is not reached (``Picture.error`` tells).
        mueller: Mueller matrices instead of Stokes vectors; not for skies and suns with a disc, which light from
            all sides.
        leave_out: whether to leave out what does not matter.
        seed: of the random numbers; the picture is a function of it alone.
        progress: called with the fraction done.

    Raises:
        DataError: neither samples nor an error, numbers out of range, or a Mueller picture of several sources.
    """
    if (samples is None) == (error is None):
        raise DataError("give either samples or an error", "the other follows")
    if not (0 <= bounces <= 1000) or (samples is not None and samples < 1) or (error is not None and not error > 0):
        raise DataError(
            f"{bounces} bounces, {samples} samples and an error of {error} were asked for",
            "give 0 to 1000 bounces, and 1 or more samples or an error above 0",
        )
    if mueller and len(world.sources) != 1:
        raise DataError(
            f"a Mueller picture of {len(world.sources)} sources mixes their frames", "simulate one source at a time"
        )
    begun = time.perf_counter()
    run = Run(world, view, mueller, seed, np.ones((bounces + 1, len(world.sources)), dtype=bool))
    left_out: tuple[LeftOut, ...] = ()
    if samples is not None:
        _in_pieces(run, samples, progress)
    else:
        assert error is not None
        if leave_out:
            left_out = run.look(error * LEFT_OUT_SHARE)
        noise = error * math.sqrt(1 - LEFT_OUT_SHARE**2) if left_out else error
        run.add(PILOT_SAMPLES)
        while (now := relative_error(*run.statistics())) > noise and run.samples < most_samples:
            if progress:
                progress(min((noise / now) ** 2, 1.0))
            needed = math.ceil(run.samples * min((now / noise) ** 2 * 1.05, 4.0))
            run.add(min(max(needed, run.samples + 1), most_samples) - run.samples)
    mean, deviation = run.statistics()
    return Picture(mean, deviation, run.samples, run.rays, time.perf_counter() - begun, left_out)


class Run:
    """A picture in the making."""

    def __init__(self, world: World, view: View, mueller: bool, seed: int, wanted: NDArray[np.bool_]) -> None:
        self.world, self.given, self.view, self.seed, self.wanted = world, view, view.row(), seed, wanted
        self.shape = (*view.shape, 4, 4) if mueller else (*view.shape, 4)
        pixels = view.width_px * view.height_px
        self.sums = np.zeros((pixels, 16 if mueller else 4))
        self.squares = np.zeros_like(self.sums)
        self.samples = self.rays = 0

    def add(self, samples: int, shares: Floats | None = None) -> None:
        """More samples; ``shares`` (of :meth:`shares`) takes what each light gave."""
        sums, squares = np.zeros((2, 0, 0, 0)) if shares is None else shares
        self.rays += int(
            take_samples(
                self.world,
                self.view,
                self.wanted,
                self.seed,
                self.samples,
                samples,
                self.sums,
                self.squares,
                sums,
                squares,
            )
        )
        self.samples += samples

    def statistics(self) -> tuple[Floats, Floats]:
        """Mean and its standard error, in the picture's shape."""
        mean, deviation = statistics(self.sums, self.squares, self.samples)
        return mean.reshape(self.shape), deviation.reshape(self.shape)

    def look(self, allowed: float) -> tuple[LeftOut, ...]:
        """Measure the shares of sources and bounces with samples of their own, and strike out what does not matter."""
        pilot = Run(self.world, self.given, False, self.seed + 1, self.wanted)
        shares = pilot.shares()
        pilot.add(PILOT_SAMPLES, shares)
        self.rays += pilot.rays
        level = float(pilot.sums[:, 0].mean()) / PILOT_SAMPLES
        if level <= 0:
            return ()
        # A lamp has no size: no ray that has not been reflected meets it.
        lamps = ~np.isin(self.world.sources[:, KIND], (Kind.SUN, Kind.SKY))
        self.wanted[0, lamps] = False
        pixels = len(pilot.sums)
        limit = upper_limit(shares[0, ..., :-1], shares[1, ..., :-1], PILOT_SAMPLES) / level
        met = np.asarray(shares[0, ..., :-1].any(axis=0))
        unmet = unmet_limit(math.sqrt(float(pilot.squares[:, 0].max())), level, pixels, PILOT_SAMPLES)
        left_out: list[LeftOut] = []
        total = 0.0
        for flat in np.argsort(limit, axis=None, kind="stable"):
            bounce, source = (int(n) for n in np.unravel_index(flat, limit.shape))
            if not self.wanted[bounce, source]:
                continue
            total += float(limit[bounce, source])
            if total > allowed:
                break
            self.wanted[bounce, source] = False
            seen = bool(met[bounce, source])
            error = float(limit[bounce, source]) if seen else unmet
            left_out.append(LeftOut(bounce, source, error, seen, pixels * PILOT_SAMPLES))
        return tuple(left_out)

    def shares(self) -> Floats:
        """Room for what each source gives after each number of reflections, and its squares (see :meth:`add`)."""
        return np.zeros((2, len(self.sums), self.wanted.shape[0], self.wanted.shape[1] + 1))


def upper_limit(sums: Floats, squares: Floats, samples: int) -> Floats:
    """Upper limit (bounces + 1, sources) of each share's rms over pixels: mean squares without their noise, + 3 sd.

    ``sum_i x_i^2 - noise_i`` over pixels is an unbiased estimate of the squares; what it may miss is judged by the
    fluctuation of the pixels' values. A share that was never seen at all has the limit 0: what that is worth is told by
    :func:`processing.raytrace.picture.unmet_limit`.
    """
    mean, error = statistics(sums, squares, samples)
    unbiased = mean * mean - error * error
    pixels = len(mean)
    spread = np.std(unbiased, axis=0) / math.sqrt(pixels)
    return np.asarray(np.sqrt(np.maximum(unbiased.mean(axis=0) + 3 * spread, 0.0)))


def _in_pieces(run: Run, samples: int, progress: Callable[[float], None] | None) -> None:
    """All samples, in pieces of about a million paths so that progress is told and Ctrl-C is heard."""
    piece = max(1, 1_000_000 // max(len(run.sums), 1))
    while run.samples < samples:
        run.add(min(piece, samples - run.samples))
        if progress:
            progress(run.samples / samples)
