"""Memory of focusing; large images: ``python -m benchmarks speed.focus_memory``."""

import pytest

from benchmarks.speed_focus_memory import FIXED_BYTES, TIMES, measure, measure_migration
from processing.sar.backprojection import backproject
from processing.sar.factorized import factorized
from processing.sar.polar_format import polar_format
from processing.sar.range_migration import range_migration


@pytest.mark.parametrize("method", [backproject, factorized, polar_format, range_migration])
def test_peaks_stay_below_three_times_image_and_profiles(method):
    run = measure_migration if method is range_migration else measure
    try:
        run(64, 64, method)
        # The smaller of two: what the allocator keeps from work done before is not this one's.
        measured = [min(run(side, pulses, method) for _ in range(2)) for side, pulses in ((128, 150), (400, 470))]
    except OSError:
        pytest.skip("this system does not tell a process' peak of memory")
    for peak, needed in measured:
        assert peak < TIMES * needed + FIXED_BYTES
