"""Antennas that are apart on the trolley: told in the rig file, followed by focusing, kept in the product."""

import numpy as np
import pytest
from rail_data import HEIGHT_M, ground
from rail_session import AMPLITUDE, RIG, write_session

from drivers.records import Channel
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.antennas import antenna_pairs
from polfuse_lab.products.focus import focus
from polfuse_lab.products.ranging import range_profiles
from polfuse_lab.products.store import Products
from polfuse_lab.rig import Rig, parse_model
from polfuse_lab.scale.focus_tiles import Scale
from processing.radar.antenna import AntennaPair

CENTRES = {
    "transmit_h_m": (-0.3, 0.0, 0.1),
    "transmit_v_m": (-0.3, 0.0, -0.1),
    "receive_h_m": (0.3, 0.05, 0.1),
    "receive_v_m": (0.3, 0.05, -0.1),
}
TOLD = ", ".join(f"{name} = {list(place)}" for name, place in CENTRES.items())
APART = RIG.replace("[radar]", f"phase_centres = {{ {TOLD} }}\n[radar]")
PLACE, S = (1.2, 8.0, -HEIGHT_M), np.array([[3.0, 1.0], [0.5j, -2.0]])
EXPECTED = AMPLITUDE * np.array([S[0, 0], S[1, 0], S[0, 1], S[1, 1]])
POSITIONS = (np.arange(21) - 10) * 0.0508


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    path = tmp_path_factory.mktemp("apart") / "apart.h5"
    return write_session(path, [(PLACE, S)], POSITIONS, rig=APART, centres=CENTRES)


def test_channels_are_measured_between_their_own_antennas(session):
    # HV transmits H and receives V.
    pairs = range_profiles(session).pairs
    assert pairs is not None
    assert pairs[1] == AntennaPair(CENTRES["transmit_h_m"], CENTRES["receive_v_m"])
    assert pairs[2] == AntennaPair(CENTRES["transmit_v_m"], CENTRES["receive_h_m"])


def test_antennas_in_one_place_need_no_pairs():
    assert antenna_pairs(parse_model(RIG, Rig, "rig.toml"), ["HH"]) is None
    alike = RIG.replace("[radar]", "phase_centres = {}\n[radar]")
    assert antenna_pairs(parse_model(alike, Rig, "rig.toml"), ["HH"]) is None
    assert antenna_pairs(None, ["HH"]) is None


def test_a_target_has_its_amplitude_and_phase_between_antennas_apart(session, tmp_path):
    # The samples follow the path from antenna to antenna. Half a path of 0.6 m between them differs from the
    # monostatic one by 6 mm and by the 0.1 m that they sit higher or lower by 13 mm: up to 2 rad at 2.4 GHz.
    here = ground([PLACE[0]], [PLACE[1]])
    made = focus(session, tmp_path / "p.h5", grid=here, tolerance_db=-80)
    np.testing.assert_allclose(made.image[:, 0, 0], EXPECTED, atol=0.02 * AMPLITUDE * 3)
    settings = Products(tmp_path / "p.h5").settings("focus")
    assert settings["antennas_m"][0] == {"transmit": [-0.3, 0.0, 0.1], "receive": [0.3, 0.05, 0.1]}
    assert settings["motion"] == "the platform stood still while it swept"


def test_leaving_the_places_out_of_the_rig_file_turns_the_phase(tmp_path):
    path = write_session(tmp_path / "s.h5", [(PLACE, S)], POSITIONS, centres=CENTRES, channels=(Channel.HH,))
    made = focus(path, tmp_path / "p.h5", grid=ground([PLACE[0]], [PLACE[1]]), tolerance_db=-80)
    # Closed form at the middle of the rail: half the path, less the monostatic range.
    sight = np.array(PLACE)
    half = sum(np.linalg.norm(sight - CENTRES[name]) for name in ("transmit_h_m", "receive_h_m")) / 2
    turned = -4 * np.pi * (half - np.linalg.norm(sight)) / 0.125
    assert abs(np.angle(made.image[0, 0, 0] / EXPECTED[0] * np.exp(-1j * turned))) < 0.2
    assert abs(np.angle(np.exp(1j * turned))) > 0.5


def test_tiles_follow_the_antennas_too(session, tmp_path):
    grid = ground(np.linspace(-2, 3, 40), np.linspace(6, 10, 36))
    whole = focus(session, tmp_path / "whole.h5", grid=grid, method="bp")
    focus(session, tmp_path / "tiles.h5", grid=grid, method="bp", scale=Scale(tile=16))
    tiled = Products(tmp_path / "tiles.h5").read("focus")
    np.testing.assert_array_equal(tiled["image"], whole.image)


def test_range_migration_is_refused_in_words(session, tmp_path):
    with pytest.raises(PolfuseError, match="phase_centres"):
        focus(session, tmp_path / "p.h5", grid=ground([0.0], [8.0]), method="rma")
