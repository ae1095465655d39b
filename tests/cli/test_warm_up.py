"""Setting up compiles every kernel, so that the first picture does not wait."""

from __future__ import annotations

from polfuse_lab.warm_up import warm_up
from processing.fusion import kmeans
from processing.optics import stokes
from processing.polarimetry import averaging, coherent, freeman, h_a_alpha, touzi, wishart, yamaguchi
from processing.polarimetry.detection import cfar
from processing.polarimetry.speckle import nonlocal_means, refined_lee
from processing.radar import ridges
from processing.sar import (
    backprojection_kernel,
    backprojection_live,
    polar_format_kernel,
    range_migration_kernel,
    segments,
    stolt,
)

POLARIMETRY = (
    averaging, coherent, freeman, h_a_alpha, touzi, wishart, yamaguchi, cfar, nonlocal_means, refined_lee,
)  # fmt: skip


def test_every_kernel_is_compiled() -> None:
    warm_up()
    kernels = [
        backprojection_kernel.add_pulses,
        backprojection_live.add_few,
        *(
            thing
            for module in (segments, stolt, range_migration_kernel, polar_format_kernel, stokes, kmeans, ridges)
            for thing in vars(module).values()
            if hasattr(thing, "signatures") and getattr(thing, "__module__", "") == module.__name__
        ),
        # Of these the ones that Python calls; what they call in turn has no signature when it comes from the cache.
        *(
            thing
            for module in POLARIMETRY
            for thing in vars(module).values()
            if getattr(thing, "targetoptions", {}).get("parallel") and thing.__module__ == module.__name__
        ),
    ]
    assert len(kernels) >= 6
    assert all(kernel.signatures for kernel in kernels)
