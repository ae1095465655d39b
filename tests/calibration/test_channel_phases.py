"""Phases between channels recorded one after the other, and of antennas in different places."""

from __future__ import annotations

import numpy as np
import pytest
from calibration_rig import DIHEDRAL_45, TRIHEDRAL, complex_noise, distortion
from rail_data import HEIGHT_M
from rail_session import write_session

from polfuse_lab.products.focus import focus
from processing.calibration.channel_phase import UNKNOWN_SD_RAD, channel_phases
from processing.calibration.distortion import CHANNELS, NO_DISTORTION, channel_values
from processing.calibration.phase_centres import ignored_phase, offset_phase_sd, path_phases
from processing.errors import DataError
from processing.radar.antenna import AntennaPair
from processing.sar.grid import ImageGrid

WAVELENGTH = 0.125
TURN = 4 * np.pi / WAVELENGTH
ROTATED = np.array([[np.cos(0.8), np.sin(0.8)], [np.sin(0.8), -np.cos(0.8)]])
"""A dihedral with its fold at 23 degrees: it shows all elements of S."""


def image_of(truth, expected, phases, shifts, sine, noise=1e-8, seed=0):
    """Channels (n, 4) of targets whose channels were recorded in passes with their own phases and places."""
    random = np.random.default_rng(seed)
    values = channel_values(truth.apply(expected)) * np.exp(2j * np.pi * random.random((len(expected), 1)))
    values = values * np.exp(1j * (phases + TURN * np.outer(sine, shifts)))
    return values + complex_noise(random, values.shape, noise)


def test_phases_and_shifts_of_passes_are_found_from_targets_in_the_scene() -> None:
    truth = distortion(np.random.default_rng(0))
    expected = 10 * np.stack([ROTATED, TRIHEDRAL + 0.3 * DIHEDRAL_45, ROTATED])
    sine = np.array([-0.4, 0.0, 0.35])
    phases, shifts = np.array([0, 1.0, -2.0, 3.1]), np.array([0, 0.002, -0.001, 0.003])
    values = image_of(truth, expected, phases, shifts, sine)
    given = {"sine": sine, "wavelength_m": WAVELENGTH, "shift_sd_m": 0.01}
    found = channel_phases(values, np.full(values.shape, 1e-8), expected, truth, **given)
    np.testing.assert_allclose(np.exp(1j * found.phase_rad), np.exp(1j * phases), atol=1e-4)
    np.testing.assert_allclose(found.shift_m, shifts, atol=1e-6)
    assert found.known() == CHANNELS
    cleaned = found.remove(values.T, sine)
    np.testing.assert_allclose(cleaned / cleaned[0], channel_values(truth.apply(expected)).T
                               / channel_values(truth.apply(expected)).T[0], rtol=1e-3)  # fmt: skip


def test_standard_deviations_are_those_of_the_scatter() -> None:
    truth = distortion(np.random.default_rng(1))
    errors, sd = [], 0.0
    for seed in range(200):
        values = image_of(truth, ROTATED[None], np.zeros(4), np.zeros(4), np.zeros(1), noise=1e-3, seed=seed)
        found = channel_phases(
            values, np.full((1, 4), 1e-3), ROTATED[None], truth, sine=np.zeros(1), wavelength_m=WAVELENGTH
        )
        errors.append(found.phase_rad)
        sd = found.phase_sd_rad()
    # Sample sd of 200: 5 %, four of them; HH is what the others are compared with.
    np.testing.assert_allclose(np.std(errors, axis=0)[1:], sd[1:], rtol=0.2)
    assert sd[0] == 0


def test_what_one_trihedral_does_not_tell_stays_unknown() -> None:
    values = image_of(NO_DISTORTION, TRIHEDRAL[None], np.array([0, 1, 2, 0.5]), np.zeros(4), np.zeros(1))
    found = channel_phases(
        values, np.full((1, 4), 1e-8), TRIHEDRAL[None], NO_DISTORTION, sine=np.zeros(1), wavelength_m=WAVELENGTH,
        shift_sd_m=0.002,
    )  # fmt: skip
    assert found.known() == ("HH", "VV")
    assert found.phase_rad[3] == pytest.approx(0.5, abs=1e-3)
    assert found.phase_sd_rad()[1] == pytest.approx(UNKNOWN_SD_RAD)
    # A pass that came back 2 mm off turns a target at 30 degrees by 4 pi / lambda 0.5 x 2 mm.
    assert found.phase_sd_rad(0.5)[3] == pytest.approx(TURN * 0.5 * 0.002, rel=0.01)


def test_reciprocal_scatterers_tie_hv_to_vh() -> None:
    truth = distortion(np.random.default_rng(2))
    sees_hv = np.array([[1, 0], [0.7, 1]], dtype=complex)
    values = image_of(truth, sees_hv[None], np.array([0, 0.6, -1.1, 0]), np.zeros(4), np.zeros(1))
    found = channel_phases(
        values, np.full((1, 4), 1e-8), sees_hv[None], truth, sine=np.zeros(1), wavelength_m=WAVELENGTH, crosstalk_sd=0.1
    )
    assert found.known() == ("HH", "HV", "VV")
    ratio = truth.receive_gain / truth.transmit_gain * np.exp(1j * (0.6 + 1.1))
    tied = found.with_reciprocity(ratio, truth, 0.01)
    assert tied.known() == CHANNELS
    assert tied.phase_rad[2] == pytest.approx(-1.1, abs=0.02)
    assert tied.with_reciprocity(ratio, truth, 3.0) is tied
    with pytest.raises(DataError, match="HV over VH"):
        found.with_reciprocity(0.0, truth, 0.1)


def test_targets_in_the_scene_that_cannot_be_used_are_refused() -> None:
    given = {"sine": np.zeros(1), "wavelength_m": WAVELENGTH}
    for values, expected, words in (
        (np.ones((1, 4)), DIHEDRAL_45[None], "nothing in HH"),
        (np.array([[0, 1, 1, 1]]), TRIHEDRAL[None], "nothing in HH"),
        (np.full((1, 4), np.nan), TRIHEDRAL[None], "nothing in HH"),
        (np.ones((1, 3)), TRIHEDRAL[None], "shapes"),
    ):
        with pytest.raises(DataError, match=words):
            channel_phases(values, np.ones((1, 4)), expected, NO_DISTORTION, **given)


CENTRES = {
    "transmit_h_m": (-0.3, 0.0, 0.1),
    "transmit_v_m": (-0.3, 0.0, -0.1),
    "receive_h_m": (0.3, 0.0, 0.1),
    "receive_v_m": (0.3, 0.0, -0.1),
}
PAIRS = tuple(
    AntennaPair(CENTRES[f"transmit_{name[0].lower()}_m"], CENTRES[f"receive_{name[1].lower()}_m"]) for name in CHANNELS
)
RAIL = np.column_stack([(np.arange(13) - 6) * 0.0508, np.zeros((13, 2))])


def test_phase_of_the_path_in_closed_form() -> None:
    place = np.array([[0.4, 3.66, -HEIGHT_M]])
    found = path_phases(np.zeros((1, 3)), PAIRS, place, WAVELENGTH)[:, 0]
    for pair, phase in zip(PAIRS, found, strict=True):
        half = sum(np.linalg.norm(place[0] - offset) for offset in (pair.transmit_m, pair.receive_m)) / 2
        expected = -TURN * (half - np.linalg.norm(place[0]))
        assert np.exp(1j * phase) == pytest.approx(np.exp(1j * expected), abs=1e-9)
    at = ignored_phase(RAIL, PAIRS, place, place[0], WAVELENGTH)
    np.testing.assert_allclose(at, 0, atol=1e-12)
    with pytest.raises(DataError, match="wavelength"):
        path_phases(RAIL, PAIRS, place, 0.0)


def test_ignored_phase_centres_spoil_the_quad_pol_phase_of_near_targets(tmp_path) -> None:
    # A thing at the thesis's 12 ft whose channels are all alike, and a calibration target 12 m away: the samples
    # follow the true paths, focusing takes the antennas to be in one place, and the far target sets the phases right.
    near, far = (0.4, 3.66, -HEIGHT_M), (0.0, 12.0, -HEIGHT_M)
    measured = {}
    for name, place in (("near", near), ("far", far)):
        session = write_session(tmp_path / f"{name}.h5", [(place, 20 * np.ones((2, 2)))], RAIL[:, 0], centres=CENTRES)
        grid = ImageGrid(np.array([place[0]]), np.array([place[1]]), -HEIGHT_M)
        measured[name] = focus(session, tmp_path / f"{name}_p.h5", grid=grid, tolerance_db=-80).image[:, 0, 0]
    left = measured["near"] / measured["near"][0] / (measured["far"] / measured["far"][0])
    expected = ignored_phase(RAIL, PAIRS, [near], far, WAVELENGTH * 0.99930819)[:, 0]
    # Profiles of the real beat at two range cells: their mirror image is 40 dB down, 1 degree; twice.
    np.testing.assert_allclose(np.angle(left), expected, atol=np.radians(4))
    # That is what the thesis leaves in: VV over HH wrong by more than 40 degrees at 12 ft.
    assert abs(np.degrees(expected[3])) > 40


def test_how_well_phase_centres_must_be_known() -> None:
    places, at = np.array([[0.4, 3.66, -HEIGHT_M], [0.0, 12.0, -HEIGHT_M]]), (0.0, 12.0, -HEIGHT_M)
    sd = offset_phase_sd(RAIL[6:7], PAIRS, places, at, WAVELENGTH, 0.002)
    np.testing.assert_allclose(sd[0], 0, atol=1e-12)
    np.testing.assert_allclose(sd[:, 1], 0, atol=1e-9)
    # VV over HH: four antennas, each moved by d turns its half of the path by 2 pi / lambda (difference of the
    # directions to both places) . d; the sum of the squares over the axes is the length of that difference.
    total = 0.0
    for offset in CENTRES.values():
        to = [np.asarray(place) - offset for place in (places[0], np.asarray(at))]
        total += np.sum((to[0] / np.linalg.norm(to[0]) - to[1] / np.linalg.norm(to[1])) ** 2)
    assert sd[3, 0] == pytest.approx(TURN / 2 * 0.002 * np.sqrt(total), rel=1e-3)
