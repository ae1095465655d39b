"""A pass over the simulated rig's wires: what is focused from it is what a rail with stops shows."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from hw_mocks.rig import SimulatedRig
from polfuse_lab.engine import collect
from polfuse_lab.products.focus import default_grid, focus
from polfuse_lab.products.passes import pass_sweeps
from polfuse_lab.session import info, open_session

pytestmark = pytest.mark.realtime

FIELD = Path(__file__).resolve().parents[2] / "examples" / "scenes" / "field.toml"
POINT_M = (0.3, 6.0)
LENGTH_M = 0.9
PLANS = {
    "stops": f"aperture_m = {LENGTH_M}\nstep_m = 0.05\nsweeps_per_channel = 1\n",
    "pass": f'kind = "continuous_sar"\naperture_m = {LENGTH_M}\nspeed_m_s = 0.25\nblock_s = 0.5\n',
}


@pytest.fixture(scope="module")
def images(tmp_path_factory):
    """Images (HH) of one point from a rail with stops and from a pass, and the grid."""
    folder = tmp_path_factory.mktemp("pass")
    # The example's radar and rail, with one target that is cheap to simulate in real time.
    head = FIELD.read_text().split("# Radar targets.")[0]
    scene = folder / "scene.toml"
    point = f"position_m = [{POINT_M[0]}, {POINT_M[1]}, -1.069]\nrcs_dbsm = 15.0\n"
    scene.write_text(f'{head}\n[[point]]\nname = "point"\n{point}')
    found = {}
    with SimulatedRig(scene, folder / "rig", audio="tcp", seed=2) as rig:
        path = rig.write_rig()
        for name, plan in PLANS.items():
            (folder / f"{name}.toml").write_text(plan + 'channels = ["HH"]\nmove_settle_s = 0.0\n')
            outcome = collect(path, folder / f"{name}.toml", folder / f"{name}.h5")
            rig.check()
            assert outcome.state == "finished", outcome.reason
    for name in PLANS:
        with open_session(folder / f"{name}.h5") as session:
            grid = default_grid(session, x_m=(-1.5, 2.0), y_m=(4.0, 8.0), step_m=(0.02, 0.1))
            found[name] = focus(session, folder / f"{name}_products.h5", grid=grid, peaks=1)
    return folder, found, grid


def width_m(row: np.ndarray, x_m: np.ndarray) -> float:
    """-3 dB width of the peak of a row, between the crossings beside it."""
    level = row / row.max()
    at, half = int(level.argmax()), math.sqrt(0.5)
    left = np.interp(half, level[: at + 1], x_m[: at + 1])
    right = np.interp(-half, -level[at:], x_m[at:])
    return float(right - left)


def test_the_point_stands_where_it_is_and_is_as_sharp(images):
    _, found, grid = images
    places, widths, heights = {}, {}, {}
    for name, result in found.items():
        image = np.abs(result.image[0])
        peak = result.peaks[0]
        row = image[int(np.argmin(np.abs(grid.y_m - peak.y_m)))]
        places[name], widths[name], heights[name] = (peak.x_m, peak.y_m), width_m(row, grid.x_m), abs(peak.value)
    # A tenth of a cell: wavelength * R / (2 L) = 0.43 m across, 1.2 * 1.87 m (Hann: 1.44 of them at -3 dB) in range.
    for place in places.values():
        assert place[0] == pytest.approx(POINT_M[0], abs=0.043)
        assert place[1] == pytest.approx(POINT_M[1], abs=0.2)
    # The places of the sweeps are known to some millimetres of the wavelength's 125: 10 ms of the clock at 0.25 m/s.
    assert places["pass"][0] == pytest.approx(places["stops"][0], abs=0.015)
    # -3 dB width of an unweighted aperture: 0.886 wavelength R / (2 L), with R the slant range; 19 stops stand for
    # 19 steps of rail, a pass for its way.
    slant = math.hypot(POINT_M[1], 1.069)
    for name, length_m in {"stops": LENGTH_M + 0.05, "pass": LENGTH_M}.items():
        assert widths[name] == pytest.approx(0.886 * 0.1249 * slant / (2 * length_m), rel=0.03)
    assert heights["pass"] == pytest.approx(heights["stops"], rel=0.05)
    assert len(found["pass"].image) == 1


def test_every_sweep_has_its_place_and_the_file_is_whole(images):
    folder, found, _ = images
    assert [p for p in info(folder / "pass.h5")["problems"] if "taken again" not in p] == []
    with open_session(folder / "pass.h5") as session:
        (run,) = pass_sweeps(session)
        moving = np.flatnonzero(np.isfinite(run.x_m) & (np.abs(np.gradient(run.x_m)) > 0.005))
        # 0.25 m/s in sweeps of 40.01 ms: 10 mm from one to the next, without a gap over 0.9 m.
        steps = np.diff(run.x_m[moving])
        assert np.median(steps) == pytest.approx(0.01, rel=0.02)
        assert steps.max() < 0.02
        assert 85 <= len(moving) <= 92
        assert np.nanmax(run.sd_m) < 0.01
    # Averaged in cells of 1/16 wavelength (7.8 mm): no two sweeps of 10 mm share one, those at a stand do.
    assert 85 <= found["pass"].pulses <= 100
