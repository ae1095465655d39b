"""Figures of a rig against the thesis's tables, Balanis's formulas for large apertures, and each other."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from polfuse_lab.cli import build
from polfuse_lab.design import DesignWishes, design
from polfuse_lab.rig.examples import thesis_rig
from processing.errors import DataError
from processing.radar.can import design_can, diameter_for_guide_wavelength_m, guide_wavelength_m

LAMBDA = 299_792_458 / 2.4e9


@pytest.fixture(scope="module")
def values():
    return {name: told.value for name, told in design(thesis_rig()).items()}


def test_the_thesis_can():
    # 18.5 cm in the guide at 12.5 cm in free space: 9.94 cm (thesis 5.2), above the limit of one mode.
    diameter = diameter_for_guide_wavelength_m(0.185, 0.125)
    assert diameter == pytest.approx(0.0994, abs=5e-5)
    assert not design_can(diameter, 0.125).single_mode
    assert guide_wavelength_m(diameter, 0.125) == pytest.approx(0.185, rel=1e-12)


@given(st.floats(1.01, 1e6), st.floats(1e-3, 10))
def test_guide_wavelength_and_diameter_are_inverse(ratio, wavelength):
    # Far above the cut-off the guide wavelength tends to that of free space and no longer tells the diameter: an
    # error of eps in the ratio of wavelengths is one of eps / (1 - ratio^2) in the diameter.
    guide = ratio * wavelength
    diameter = diameter_for_guide_wavelength_m(guide, wavelength)
    assert guide_wavelength_m(diameter, wavelength) == pytest.approx(guide, rel=1e-15 * 20 * ratio**2 + 1e-12)


def test_beams_of_a_large_aperture():
    # E-plane: the Airy pattern, 1.02899 wavelength / D wide. H-plane: 37.0 degrees wavelength / a for radii far above
    # a wavelength (Balanis, Antenna Theory, Table 12.2, three figures).
    can = design_can(40 * LAMBDA, LAMBDA)
    assert can.beamwidth_e_rad == pytest.approx(1.02899 / 40, rel=2e-4)
    assert math.degrees(can.beamwidth_h_rad) == pytest.approx(37.0 / 20, rel=5e-3)


def test_figures_of_the_thesis(values):
    assert values["wavelength"] == pytest.approx(0.1249, abs=5e-5)  # 5.1
    # Exact limits of one mode at 2.4 GHz: 7.33 and 9.57 cm.
    assert (values["can_diameter_least"], values["can_diameter_most"]) == pytest.approx((0.0732, 0.0956), abs=1e-4)
    assert (values["can_rule_least"], values["can_rule_most"]) == pytest.approx((0.60 * LAMBDA, 0.75 * LAMBDA))
    assert values["can_single_mode"] is True
    assert values["range_resolution"] == pytest.approx(1.874, abs=5e-4)  # 2.34 (thesis: 1.88)
    assert values["unambiguous_range"] == pytest.approx(900, abs=1)  # Table 5.1
    assert values["trihedral_rcs"] == pytest.approx(37.27, abs=0.02)  # 5.4: 12 pi a^4 / wavelength^2, 4 ft
    assert values["target_far_field"] == pytest.approx(23.8, abs=0.02)
    assert values["grating_lobe_free"] == pytest.approx(37.9, abs=0.1)  # 2 in: 0.41 wavelength
    # Table 5.1's 2.05 m of cross range: 100 m away with 10 ft.
    far = design(thesis_rig(), DesignWishes(at_m=100.0, aperture_m=3.048))
    assert far["cross_range_small_angle"].value == pytest.approx(2.05, abs=0.005)
    assert far["positions"].value == 61


def test_figures_agree_with_each_other(values):
    # A beat of fs / 2 = 24 kHz at the unambiguous range.
    assert values["beat_per_metre"] * values["unambiguous_range"] == pytest.approx(24_000, rel=1e-9)
    # Signal over noise of one sweep against the noise-equivalent RCS of the whole image: 3.2 m in 2 in steps are 63
    # positions of 10 sweeps, which add coherently; the window costs 1.76 dB (Harris), and the beam's axis is not where
    # the image's figure looks: straight ahead, 10.9 degrees above it, with the power pattern cos^n twice.
    n = math.log(0.5) / math.log(math.cos(math.radians(35)))
    off = math.radians(17) - math.atan2(1.069, 10)
    beam_db = 20 * n * math.log10(math.cos(off))
    expected = values["trihedral_rcs"] - values["snr_one_sweep"] - 10 * math.log10(values["positions"] * 10)
    window_db = 10 * math.log10(1.5)
    assert values["noise_equivalent_rcs"] == pytest.approx(expected + window_db - beam_db, abs=0.02)


def test_thesis_camera(values):
    assert values["pixel_angle"] == pytest.approx(8.3e-6 / 8e-3 * 1e3)
    assert values["field_of_view_across"] == pytest.approx(2 * np.degrees(np.arctan(782 * 8.3 / 16_000)))


@pytest.mark.parametrize(
    ("wishes", "words"),
    [
        (DesignWishes(at_m=0.0), "at_m is 0"),
        (DesignWishes(power_w=math.nan), "power_w is nan"),
        (DesignWishes(can_diameter_m=0.05), "no wave of 0.1249 m travels"),
        (DesignWishes(noise_figure_db=math.inf), "noise figure"),
    ],
)
def test_what_makes_no_sense_is_refused(wishes, words):
    with pytest.raises(DataError, match=words):
        design(thesis_rig(), wishes)


def test_command(tmp_path):
    run = CliRunner().invoke(build(), ["design", "--json", "--can", "0.0994"])
    told = json.loads(run.stdout)["values"]
    assert set(told["range_resolution"]) == {"value", "unit", "equation", "note"}
    assert told["can_single_mode"]["value"] is False
    assert "TM01" in told["can_diameter"]["note"]
    text = CliRunner().invoke(build(), ["design"]).stdout
    assert "grating lobe free" in text
    assert "near-field correction" in text  # at 10 m, the trihedral's far field begins at 23.8 m
    refused = CliRunner().invoke(build(), ["design", "--can", "0.05"])
    assert refused.exit_code == 1
