import json

import numpy as np
import pytest
from plan_rig import RIG, plan, rig
from typer.testing import CliRunner

from polfuse_lab.cli import build
from polfuse_lab.plans.prediction import predict_image, prediction_lines
from processing.errors import DataError
from processing.sar.resolution import point_resolution

RAIL = 'kind = "rail_sar"\nstep_m = 0.0508\naperture_m = 3.048\nsweeps_per_channel = 10\n'


def predicted(text=RAIL, **options):
    return predict_image(rig(), plan(text).steps(mosaic=False), **options)


def test_the_thesis_rail():
    told = predicted()
    # Hann's slant cell: 1.4406 c / 2B = 2.70 m; along the rail the exact support's width at 10 m.
    assert told["resolution_m"]["slant"] == pytest.approx(1.4406 * 299_792_458 / 160e6, rel=1e-3)
    antenna = np.column_stack([(np.arange(61) - 30) * 0.0508, np.zeros((61, 2))])
    exact = point_resolution(antenna, (0, 10, -1.069), centre_hz=2.4e9, bandwidth_hz=80e6, window="hann")
    assert told["resolution_m"]["x"] == pytest.approx(exact.x_m, rel=1e-6)
    # Field notes: 2 in are 0.41 wavelength, alias beyond 38 degrees.
    assert told["step_wavelengths"] == pytest.approx(0.4067, abs=1e-3)
    assert told["alias_free_deg"] == pytest.approx(37.9, abs=0.1)
    # c T fs / 4 B with 960 samples of ramp: 899.4 m (thesis, Table 5.1: 900 m at most).
    assert told["unambiguous_range_m"] == pytest.approx(899.4, abs=0.1)
    # The beam of 70 degrees reaches from 52 degrees below horizontal to above it: 1.069 / tan 52 = 0.835 m.
    assert told["swath_m"]["near"] == pytest.approx(0.835, abs=0.001)
    assert told["swath_m"]["far"] == pytest.approx(899.4, abs=0.1)
    # Beyond 35 degrees the beam ends before the grating lobes begin.
    assert told["swath_m"]["x"] == pytest.approx(np.hypot(10, 1.069) * np.tan(np.radians(35)), rel=1e-9)
    # Per channel 61 positions x 10 up-ramps x 20 ms.
    assert told["assumed"]["integration_s"] == pytest.approx(12.2)


def test_sensitivity_follows_range_power_and_time():
    near, far = predicted(at_m=10.0), predicted(at_m=20.0)
    # R^4 along the slant; the beam's axis points elsewhere at either range, which the gains tell (two-way).
    slant = [np.hypot(at, 1.069) for at in (10.0, 20.0)]
    gains = near["assumed"]["gain_db"] - far["assumed"]["gain_db"]
    rise = 40 * np.log10(slant[1] / slant[0]) + 2 * gains
    assert far["noise_equivalent_rcs_dbsm"] - near["noise_equivalent_rcs_dbsm"] == pytest.approx(rise, abs=1e-9)
    for options, step in (({"power_w": 10.0}, -10.0), ({"noise_figure_db": 13.0}, 3.0)):
        assert predicted(**options)["noise_equivalent_rcs_dbsm"] == pytest.approx(
            near["noise_equivalent_rcs_dbsm"] + step, abs=1e-9
        )
    longer = predicted(RAIL.replace("channel = 10", "channel = 20"))
    assert longer["noise_equivalent_rcs_dbsm"] == pytest.approx(near["noise_equivalent_rcs_dbsm"] - 3.0103, abs=1e-3)
    cell = near["resolution_m"]["x"] * near["resolution_m"]["y"]
    assert near["noise_equivalent_sigma0_db"] == pytest.approx(
        near["noise_equivalent_rcs_dbsm"] - 10 * np.log10(cell), abs=1e-9
    )


def test_runs_of_the_trolley_sample_every_sweep():
    # 1.5 m/s x 40 ms from one sweep to the next, as the dry run has it: alias beyond 31 degrees.
    told = predicted('kind = "continuous_sar"\nspeed_m_s = 1.5')
    assert told["step_m"] == pytest.approx(0.06, rel=0.03)
    assert told["alias_free_deg"] == pytest.approx(31, abs=1.0)


def test_plans_without_an_aperture_have_no_image():
    assert predicted('kind = "ranging"\nsweeps = 4\n') is None
    assert prediction_lines(None) == []
    with pytest.raises(DataError, match="power"):
        predicted(power_w=0.0)


def test_the_command_tells_it(tmp_path):
    text = RIG.replace('"dowkey_ms"', '"dowkey_ms"\noptions = {port = "/dev/x"}')
    (tmp_path / "rig.toml").write_text(text.replace('"grbl"', '"grbl"\noptions = {port = "/dev/y"}'))
    (tmp_path / "plan.toml").write_text(RAIL)
    arguments = ["plan", str(tmp_path / "rig.toml"), str(tmp_path / "plan.toml"), "-o", str(tmp_path / "s.h5")]
    done = CliRunner().invoke(build(), [*arguments, "--at", "12", "--json"])
    assert done.exit_code == 0, done.output
    image = json.loads(done.stdout)["image"]
    assert image["at_m"] == 12
    assert {"resolution_m", "swath_m", "alias_free_deg", "noise_equivalent_rcs_dbsm", "assumed"} <= set(image)
    words = CliRunner().invoke(build(), arguments).stdout
    assert "0.41 wavelengths: grating lobes of targets beyond 38 degrees" in words
    assert "thermal noise as RCS" in words
