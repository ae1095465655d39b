"""Setting up compiles every kernel, so that the first picture does not wait."""

from __future__ import annotations

from polfuse_lab.warm_up import warm_up
from processing.fusion import kmeans
from processing.optics import stokes
from processing.radar import ridges
from processing.sar import backprojection_kernel, backprojection_live, segments, stolt


def test_every_kernel_is_compiled() -> None:
    warm_up()
    kernels = [
        backprojection_kernel.add_pulses,
        backprojection_live.add_few,
        *(
            thing
            for module in (segments, stolt, stokes, kmeans, ridges)
            for thing in vars(module).values()
            if hasattr(thing, "signatures") and getattr(thing, "__module__", "") == module.__name__
        ),
    ]
    assert len(kernels) >= 6
    assert all(kernel.signatures for kernel in kernels)
