"""The antennas' pattern where transmitter and receiver stand apart."""

import numpy as np
import pytest
from rail_data import BANDWIDTH_HZ, CELL_M, CENTRE_HZ, C, ground, rail, relative_db

from processing.radar.antenna import AntennaPair
from processing.radar.profiles import RangeProfiles
from processing.sar.aperture import two_way_gain
from processing.sar.backprojection import backproject, backproject_reference
from processing.sar.factorized import factorized

BEAMWIDTH, DEPRESSION = np.radians(70), np.radians(17)
PAIR = AntennaPair((0.9, 0.0, 0.3), (-1.1, 0.2, 0.0))
PLACE = (2.0, 5.0, -1.069)


def amplitude(antenna):
    """One antenna's amplitude pattern, cos^(n/2), half power at half the beam width: written out here."""
    n = np.log(0.5) / np.log(np.cos(BEAMWIDTH / 2))
    sight = np.asarray(PLACE) - antenna
    cosine = sight @ np.array([0, np.cos(DEPRESSION), -np.sin(DEPRESSION)]) / np.linalg.norm(sight, axis=-1)
    return cosine ** (n / 2)


def echoes(positions=61):
    """Of a unit target, weakened by the amplitude patterns of both antennas, each at its own place."""
    antenna = rail(positions)
    there, back = antenna + np.array(PAIR.transmit_m), antenna + np.array(PAIR.receive_m)
    half = 0.5 * (np.linalg.norm(there - PLACE, axis=1) + np.linalg.norm(back - PLACE, axis=1))[:, None]
    axis = CELL_M / 8 * np.arange(-64, 200)
    values = np.sinc((axis - half) / CELL_M) * np.exp(-4j * np.pi * CENTRE_HZ / C * half)
    values *= (amplitude(there) * amplitude(back))[:, None]
    return RangeProfiles(
        values[None], axis, antenna, ("HV",), CENTRE_HZ, BANDWIDTH_HZ, "rectangular", True, pairs=(PAIR,)
    )


@pytest.mark.parametrize("positions", [1, 61])
@pytest.mark.parametrize("method", [backproject, backproject_reference])
def test_each_antenna_sees_the_target_from_its_own_place(method, positions):
    grid = ground([PLACE[0]], [PLACE[1]])
    image = method(echoes(positions), grid, interpolator="sinc16", beamwidth_rad=BEAMWIDTH, depression_rad=DEPRESSION)
    # Closed form: sum(w g g) / sum(w g^2) = 1. float32 gains and samples.
    np.testing.assert_allclose(image, 1.0, atol=3e-6)
    # Control: the platform's own place is another place for the pattern.
    own = two_way_gain(rail(1)[0], grid, BEAMWIDTH, DEPRESSION)[0, 0]
    apart = two_way_gain(rail(1)[0], grid, BEAMWIDTH, DEPRESSION, PAIR)[0, 0]
    assert abs(own / apart - 1) > 0.02


def test_kernels_agree_on_gains_of_antennas_apart():
    grid = ground(np.linspace(-6, 6, 60), np.linspace(3, 14, 48))
    pattern = {"beamwidth_rad": BEAMWIDTH, "depression_rad": DEPRESSION}
    plain = backproject_reference(echoes(), grid, interpolator="sinc8", **pattern)
    assert relative_db(backproject(echoes(), grid, **pattern), plain) < -112
    # Factorized at its default: -50 dB, and its gains between nodes by splines, -60 dB.
    assert relative_db(factorized(echoes(), grid, **pattern), plain) < -49


def test_behind_either_antenna_there_is_no_gain():
    behind = AntennaPair((0.0, 6.0, 0.0), (0.0, 0.0, 0.0))
    grid = ground([0.0], [3.0, 9.0], z=0.0)
    gain = two_way_gain(np.zeros(3), grid, BEAMWIDTH, 0.0, behind)
    assert gain[0, 0] == 0
    assert gain[1, 0] > 0
