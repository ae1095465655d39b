"""Every knob that trades speed for accuracy, what it does, and where its trade is measured."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Knob:
    """One setting that trades time (or room) for accuracy."""

    name: str
    where: str
    """Option or argument."""
    trades: str
    """What is traded, in words."""
    measured: str
    """Task of ``polfuse trade`` (its name up to the size), or benchmark."""
    decided_by: str
    """Who chooses where nothing is told."""


KNOBS = (
    Knob("method of focusing", "focus --method", "bp, ffbp, rma, pfa, reference", "focus", "planner"),
    Knob("interpolator", "backproject(interpolator=)", "2 to 16 taps", "focus", "planner"),
    Knob("range oversampling", "focus --oversampling", "bins per cell", "focus", "planner"),
    Knob("factorization", "factorized(tolerance_db=)", "grids of partial sums", "focus", "planner"),
    Knob("Stolt's filter", "range_migration(taps=)", "taps of the resampling", "accuracy.focus_planner", "fixed"),
    Knob("polar format", "focus --method pfa", "straight wavefronts", "accuracy.polar_format", "planner"),
    Knob("motion within a sweep", "backproject(motion=)", "modelled or not", "accuracy.focus_planner", "bound"),
    Knob("memory and tiles", "focus --memory, --tile", "room for time, the same bits", "speed.scale", "told"),
    Knob("autofocus", "focus --autofocus-method", "iterations and model", "accuracy.autofocus", "gain in entropy"),
    Knob("zero padding of a profile", "range_axis(oversampling=)", "level between bins", "ranging.padding", "planner"),
    Knob("window over the ramp", "focus --window", "side lobes for resolution", "ranging.window", "hann"),
    Knob("demosaicer", "optics --demosaic", "bilinear, newton, residual", "optics.demosaic", "bilinear, or tolerance"),
    Knob("precision of the mosaic's pass", "mosaic_stokes", "float32 or float64", "optics.precision", "bound"),
    Knob("bias of DOLP", "always on", "a function for each pixel", "optics.debias", "on"),
    Knob(
        "registration of exposures",
        "optics --register",
        "pieces or whole, left or splines",
        "accuracy.planners",
        "off, or tolerance",
    ),
    Knob(
        "camera's picture on the ground", "fuse --tolerance", "lines or splines", "accuracy.planners", "straight lines"
    ),
    Knob("rays of a pixel", "raytrace: samples, error", "noise", "raytrace", "error asked for"),
    Knob("bounces", "raytrace: bounces", "light left out", "raytrace", "measured limit"),
    Knob("rays and bounces", "raytrace --tolerance", "noise, light left out", "accuracy.planners_traced", "planner"),
    Knob("rays of a radar", "simulate --tolerance", "bounces, cells, splits", "accuracy.planners_traced", "planner"),
    Knob("segments of a track", "simulate --tolerance", "rays sent anew", "accuracy.planners_traced", "planner"),
    Knob("facets of a body", "raytrace: divisions", "shape of curved bodies", "accuracy.raytrace", "told"),
    Knob("speckle filter and its window", "decompose --filter, --window", "speckle for edges", "speckle", "told"),
    Knob("window of a decomposition", "decompose --window", "bias of entropy for edges", "decompose.window", "method"),
    Knob("precision of matrices", "float32 or float64 planes", "144 or 300 dB", "decompose.precision", "as given"),
    Knob(
        "step of physical optics",
        "physical_optics(step)",
        "points of the integral",
        "accuracy.near_field",
        "half a wave",
    ),
    Knob("draws of a budget", "calibrate_targets(draws=)", "Monte Carlo's own noise", "accuracy.calibration", "1000"),
    Knob(
        "filter of the session file",
        "[storage] filter",
        "room for time, lossless",
        "storage.frames",
        "bitshuffle-lz4, or auto",
    ),
    Knob("sizes of live pictures", "live process", "display size, skipped records", "speed.live", "what keeps up"),
)
"""In the order of the work; the tests compare the tasks with what ``polfuse trade`` measures."""
