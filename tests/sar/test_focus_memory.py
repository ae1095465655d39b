"""Memory of focusing; large images: ``python -m benchmarks speed.focus_memory``."""

import pytest

from benchmarks.speed_focus_memory import FIXED_BYTES, TIMES, measure
from processing.sar.backprojection import backproject
from processing.sar.factorized import factorized


@pytest.mark.parametrize("method", [backproject, factorized])
def test_peaks_stay_below_three_times_image_and_profiles(method):
    try:
        measure(64, 64, method)
        measured = [measure(side, pulses, method) for side, pulses in ((128, 150), (400, 470))]
    except OSError:
        pytest.skip("this system does not tell a process' peak of memory")
    for peak, needed in measured:
        assert peak < TIMES * needed + FIXED_BYTES
