"""Memory of focusing; large images: ``python -m benchmarks speed.focus_memory``."""

import json
import subprocess
import sys

import pytest

from benchmarks.speed_focus_memory import FIXED_BYTES, TIMES

METHODS = ("backproject", "factorized", "polar_format", "range_migration")
# A process of its own: what other tests left to the allocator, and their threads, are not these methods'.
SCRIPT = """
import json
from benchmarks.speed_focus_memory import measure, measure_migration
from processing.sar.backprojection import backproject
from processing.sar.factorized import factorized
from processing.sar.polar_format import polar_format
from processing.sar.range_migration import range_migration
found = {}
for method in (backproject, factorized, polar_format, range_migration):
    run = measure_migration if method is range_migration else measure
    run(64, 64, method)
    found[method.__name__] = [run(side, pulses, method) for side, pulses in ((128, 150), (400, 470))]
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def peaks(pytestconfig):
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, timeout=110, cwd=pytestconfig.rootpath
    )
    if "OSError" in done.stderr:
        pytest.skip("this system does not tell a process' peak of memory")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize("method", METHODS)
def test_peaks_stay_below_three_times_image_and_profiles(peaks, method):
    for peak, needed in peaks[method]:
        assert needed > 0
        assert peak < TIMES * needed + FIXED_BYTES
