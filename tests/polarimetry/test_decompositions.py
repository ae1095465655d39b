"""Decompositions: canonical targets in closed form, kernels against references, limits and invariants."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.errors import DataError
from processing.polarimetry import coherent, targets
from processing.polarimetry.averaging import window_average
from processing.polarimetry.entropy_bias import entropy_bias, entropy_of, unbiased_eigenvalues
from processing.polarimetry.freeman import freeman_durden, freeman_durden_reference
from processing.polarimetry.h_a_alpha import h_a_alpha, h_a_alpha_reference
from processing.polarimetry.matrices import coherency_turned, planes_of_matrix, planes_of_vector, total_power
from processing.polarimetry.pauli import pauli_of_matrix
from processing.polarimetry.touzi import target_vector, touzi, touzi_reference
from processing.polarimetry.yamaguchi import MODELS, Model, yamaguchi, yamaguchi_reference

EXACT = 1e-6
DIPOLES = np.diag([0.5, 0.25, 0.25])
"""T of a cloud of unit dipoles in all directions (Freeman and Durden 1998)."""
FOLDS = np.radians([-45, -40, -22.5, -10, 0, 7, 22.5, 30, 44.9])

Kernel = Callable[[np.ndarray], np.ndarray]
PAIRS: dict[str, tuple[Kernel, Kernel]] = {
    "freeman": (freeman_durden, freeman_durden_reference),
    "h-a-alpha": (h_a_alpha, h_a_alpha_reference),
    "touzi": (touzi, touzi_reference),
    **{m: (lambda t, m=m: yamaguchi(t, m), lambda t, m=m: yamaguchi_reference(t, m)) for m in MODELS},
}
POWERS = ("freeman", *MODELS)


def one(matrix: np.ndarray) -> np.ndarray:
    """Planes of a scattering matrix (2, 2) or of a coherency matrix (3, 3), as an image of one pixel."""
    if matrix.shape == (2, 2):
        return planes_of_vector(pauli_of_matrix(matrix)[:, None, None])
    return planes_of_matrix(matrix)[:, None, None]


def scene(window: int = 3, dtype: type = np.float64) -> np.ndarray:
    """Averages of speckle of several mechanisms, turned by all angles; with powerless and undefined pixels."""
    rng = np.random.default_rng(11)
    shape = (24, 30)
    weights = rng.uniform(0.02, 1, size=(3, *shape)) ** 2
    k = weights * (rng.normal(size=(3, *shape)) + 1j * rng.normal(size=(3, *shape)))
    k[1] += 0.5 * np.exp(1j * rng.uniform(-3, 3, size=shape)) * k[0]
    k[:, 5:12, 20:28] = 0
    planes = window_average(planes_of_vector(k), window)
    planes[6, 2, 3] = np.nan
    planes[0, 3, 3] = np.inf
    return planes.astype(dtype)


@pytest.mark.parametrize("name", PAIRS)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_kernels_are_their_references(name: str, dtype: type) -> None:
    kernel, reference = PAIRS[name]
    planes = scene(dtype=dtype)
    found, expected = kernel(planes), reference(planes)
    assert found.dtype == dtype
    # Float32: rounding of the result, 2^-24 of values to pi and a half unit; float64: condition of close eigenvalues.
    np.testing.assert_allclose(found, expected, rtol=3e-7, atol=3e-7 if dtype == np.float32 else 1e-10)


@pytest.mark.parametrize("name", PAIRS)
def test_undefined_and_powerless_pixels(name: str) -> None:
    found = PAIRS[name][0](scene())
    assert np.isnan(found[:, 2, 3]).all()
    assert np.isnan(found[:, 3, 3]).all()
    empty = found[:, 8, 24]
    # No power is a power of zero, but there is no angle and no entropy of nothing.
    assert (empty == 0).all() if name in POWERS else np.isnan(empty).all()


@pytest.mark.parametrize("name", POWERS)
def test_powers_are_not_negative_and_sum_to_the_span(name: str) -> None:
    for planes in (scene(1), scene(3), scene(7)):
        powers = PAIRS[name][0](planes)
        sound = np.isfinite(planes).all(axis=0)
        assert (powers[:, sound] >= 0).all()
        span = total_power(planes)[sound]
        np.testing.assert_allclose(powers.sum(axis=0)[sound], span, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("name", PAIRS)
@pytest.mark.parametrize("level", [1e-12, 1e12])
def test_120_db_of_dynamic_range_change_nothing_but_the_scale(name: str, level: float) -> None:
    planes = scene()
    expected, found = PAIRS[name][0](planes), PAIRS[name][0](planes * level)
    powers = slice(0, None) if name in POWERS else slice(4, 7) if name == "h-a-alpha" else slice(0, 0)
    found[powers] /= level
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


def test_mechanisms_120_db_apart_within_a_pixel() -> None:
    # Surface with a cross-polarized power of 1e-12: the volume is 4 T33 (Freeman and Durden 1998).
    powers = freeman_durden(one(np.diag([1.0, 0.0, 1e-12])))[:, 0, 0]
    np.testing.assert_allclose(powers, [1.0, 0.0, 4e-12], rtol=1e-9, atol=1e-20)
    # Eigenvalues of 1, 1e-12 and 1e-13 in any basis: angles are those of the strongest vector. Its error is that of T's
    # rounding, 2e-16, and the others weigh 1e-12.
    rng = np.random.default_rng(8)
    v = np.linalg.qr(rng.normal(size=(3, 3)) + 1j * rng.normal(size=(3, 3)))[0]
    found = h_a_alpha(one(v @ np.diag([1.0, 1e-12, 1e-13]) @ v.conj().T))[:, 0, 0]
    np.testing.assert_allclose(found[[2, 3]], np.arccos(abs(v[0, 0])), atol=1e-9)
    np.testing.assert_allclose(found[0], entropy_of([1.0, 1e-12, 1e-13]), atol=1e-12)
    np.testing.assert_allclose(found[1], 9 / 11, atol=1e-2)
    np.testing.assert_allclose(found[4:6], [1.0, 1e-12], rtol=1e-3)


@pytest.mark.parametrize("name", POWERS)
def test_negative_powers_of_noise_subtraction(name: str) -> None:
    # A negative cross-polarized power counts as it is; a negative span is no power.
    sound, bad = PAIRS[name][0](one(np.diag([1.0, 0.2, -0.1])))[:, 0, 0], PAIRS[name][0](one(np.diag([-1.0, 0.2, 0.1])))
    assert np.isfinite(sound).all()
    np.testing.assert_allclose(sound.sum(), 1.1, rtol=1e-12)
    assert np.isnan(bad).all()
    values = h_a_alpha(one(np.diag([1.0, 0.2, -0.1])))[:, 0, 0]
    assert values[6] == 0
    np.testing.assert_allclose(values[0], entropy_of([1.0, 0.2, 0.0]), rtol=1e-12)


@pytest.mark.parametrize("model", MODELS)
def test_canonical_targets_by_powers(model: Model) -> None:
    # Freeman and Durden 1998 and Yamaguchi 2005: a sphere is surface, a dipole cloud volume, a helix helix, all of it.
    np.testing.assert_allclose(freeman_durden(one(targets.trihedral()))[:, 0, 0], [2, 0, 0], atol=EXACT)
    np.testing.assert_allclose(freeman_durden(one(targets.dihedral()))[:, 0, 0], [0, 2, 0], atol=EXACT)
    np.testing.assert_allclose(freeman_durden(one(DIPOLES))[:, 0, 0], [0, 0, 1], atol=EXACT)
    np.testing.assert_allclose(yamaguchi(one(targets.trihedral()), model)[:, 0, 0], [2, 0, 0, 0], atol=EXACT)
    np.testing.assert_allclose(yamaguchi(one(targets.dihedral()), model)[:, 0, 0], [0, 2, 0, 0], atol=EXACT)
    np.testing.assert_allclose(yamaguchi(one(DIPOLES), model)[:, 0, 0], [0, 0, 1, 0], atol=EXACT)
    for sense in ("left", "right"):
        helix = yamaguchi(one(targets.helix(sense)), model)  # type: ignore[arg-type]
        np.testing.assert_allclose(helix[:, 0, 0], [0, 0, 0, 1], atol=EXACT)


@pytest.mark.parametrize("fold", FOLDS)
def test_a_dihedral_at_any_angle(fold: float) -> None:
    t = one(targets.dihedral(fold))
    # Turned back, it is double bounce whatever its angle (Yamaguchi 2011).
    for model in ("rotated", "extended"):
        np.testing.assert_allclose(yamaguchi(t, model)[:, 0, 0], [0, 2, 0, 0], atol=EXACT)  # type: ignore[arg-type]
    # Not turned back, cross-polarization counts as volume: C22 = 2 s^2, volume 8 s^2, until that is more than HH has:
    # c^2 - 3 s^2 < 0. What remains of VV and HH is fully correlated, so it is one mechanism.
    s2, c2 = np.sin(2 * fold) ** 2, np.cos(2 * fold) ** 2
    expected = [0, 2 - 8 * s2, 8 * s2] if c2 > 3 * s2 else [0, 0, 2]
    np.testing.assert_allclose(freeman_durden(t)[:, 0, 0], expected, atol=EXACT)
    assert h_a_alpha(t)[0, 0, 0] < EXACT
    np.testing.assert_allclose(h_a_alpha(t)[2, 0, 0], np.pi / 2, atol=EXACT)
    alpha, phi, tau, psi = touzi(t)[[0, 3, 6, 9], 0, 0]
    np.testing.assert_allclose([alpha, phi, tau], [np.pi / 2, 0, 0], atol=EXACT)
    # A fold at -45 degrees is that at +45 degrees: its matrix only changes its sign.
    np.testing.assert_allclose(np.exp(4j * psi), np.exp(4j * fold), atol=EXACT)
    sphere, diplane, helix, angle = coherent.krogager(targets.dihedral(fold))
    np.testing.assert_allclose([sphere, diplane, helix], [0, 1, 0], atol=EXACT)
    np.testing.assert_allclose(np.exp(4j * angle), np.exp(4j * fold), atol=EXACT)
    kind, symmetry, orientation, ratio = cameron_of(targets.dihedral(fold))
    assert coherent.CLASSES[int(kind)] == "dihedral"
    np.testing.assert_allclose([symmetry, ratio], [0, 1], atol=EXACT)
    np.testing.assert_allclose(np.exp(4j * orientation), np.exp(4j * fold), atol=EXACT)


def test_canonical_targets_by_angles() -> None:
    # Cloude and Pottier 1997: alpha 0 for a sphere, 45 degrees for a dipole, 90 for a dihedral; no entropy.
    for matrix, alpha in ((targets.trihedral(), 0), (targets.dipole(0.3), 45), (targets.helix("left"), 90)):
        found = h_a_alpha(one(matrix))[:, 0, 0]
        np.testing.assert_allclose(found[[0, 2, 3]], [0, np.radians(alpha), np.radians(alpha)], atol=EXACT)
        assert np.isnan(found[1])
    # A dipole cloud: p = 1/2, 1/4, 1/4, so H = (0.5 ln 2 + 0.5 ln 4) / ln 3 and alpha = 45 degrees, A = 0.
    found = h_a_alpha(one(DIPOLES))[:, 0, 0]
    np.testing.assert_allclose(found[:3], [1.5 * np.log(2) / np.log(3), 0, np.pi / 4], atol=EXACT)
    # Touzi 2007: a sphere has alpha_s 0, a dipole 45 degrees, a helix tau of -+45 degrees.
    np.testing.assert_allclose(touzi(one(targets.trihedral()))[[0, 6], 0, 0], 0, atol=EXACT)
    dipole = touzi(one(targets.dipole(0.3)))[[0, 3, 6, 9], 0, 0]
    np.testing.assert_allclose(dipole, [np.pi / 4, 0, 0, 0.3], atol=EXACT)
    for sense, sign in (("left", -1), ("right", 1)):
        helix = touzi(one(targets.helix(sense)))[[0, 6], 0, 0]  # type: ignore[arg-type]
        np.testing.assert_allclose(helix, [np.pi / 4, sign * np.pi / 4], atol=EXACT)


def test_alpha_where_eigenvalues_are_equal() -> None:
    # Pure noise: the mean over all bases of alpha is 60 degrees at entropy 1 (Cloude and Pottier 1997); whatever turns
    # T then changes nothing.
    found = h_a_alpha(one(np.eye(3)))[:, 0, 0]
    np.testing.assert_allclose(found[:4], [1, 0, np.pi / 3, 0], atol=EXACT)
    rng = np.random.default_rng(2)
    vectors = np.linalg.qr(rng.normal(size=(3, 3)) + 1j * rng.normal(size=(3, 3)))[0]
    # Equal first and second: their space is what is orthogonal to v3; of (1, 0, 0) the square 1 - |v31|^2 lies there.
    t = vectors @ np.diag([2, 2, 1]) @ vectors.conj().T
    v31 = abs(vectors[0, 2])
    expected = 0.4 * np.arccos(np.sqrt(1 - v31**2)) + 0.4 * np.pi / 2 + 0.2 * np.arccos(v31)
    for method in PAIRS["h-a-alpha"]:
        np.testing.assert_allclose(method(one(t))[2, 0, 0], expected, atol=EXACT)


@given(
    st.floats(0, np.pi / 2), st.floats(-np.pi, np.pi), st.floats(-np.pi / 4, np.pi / 4), st.floats(-np.pi, np.pi),
    st.floats(-np.pi, np.pi),
)  # fmt: skip
@settings(max_examples=60, deadline=None)
def test_touzi_finds_the_vector_again(alpha: float, phi: float, tau: float, psi: float, phase: float) -> None:
    # Whatever the angles, also where they wrap: the vector that the angles found stand for is the target's.
    k = target_vector(alpha, phi, tau, psi) * np.exp(1j * phase)
    found = touzi(planes_of_vector(k[:, None, None]))[[0, 3, 6, 9], 0, 0]
    np.testing.assert_allclose(abs(np.vdot(target_vector(*found), k)), 1, atol=1e-7)
    assert 0 <= found[0] <= np.pi / 2 + 1e-12
    assert abs(found[3]) <= np.pi / 4 + 1e-12


@given(st.lists(st.floats(-5, 5), min_size=36, max_size=36), st.floats(-np.pi, np.pi))
@settings(max_examples=60, deadline=None)
def test_invariants(numbers: list[float], angle: float) -> None:
    parts = np.array(numbers).reshape(2, 3, 6)
    k = parts[0] + 1j * parts[1]
    t = k @ k.conj().T / 6
    if t.trace().real < 1e-3:
        return
    entropy, anisotropy, alpha, _, *values = h_a_alpha(one(t))[:, 0, 0]
    assert 0 <= entropy <= 1
    assert np.isnan(anisotropy) or -1e-12 <= anisotropy <= 1
    assert 0 <= alpha <= np.pi / 2 + 1e-12
    assert values[0] >= values[1] >= values[2] >= 0
    np.testing.assert_allclose(np.sum(values), t.trace().real, rtol=1e-9)
    # Turning a target about the line of sight changes neither entropy and alpha nor the rotated powers.
    turned = one(coherency_turned(t, angle))
    np.testing.assert_allclose(h_a_alpha(turned)[0, 0, 0], entropy, atol=1e-7)
    np.testing.assert_allclose(yamaguchi(turned).sum(), t.trace().real, rtol=1e-9)


def cameron_of(matrix: np.ndarray) -> np.ndarray:
    return coherent.cameron(np.array([matrix[0, 0], matrix[1, 0], matrix[0, 1], matrix[1, 1]])[:, None, None])[:, 0, 0]


@pytest.mark.parametrize(
    ("matrix", "name"),
    [
        # Cameron, Youssef and Leung 1996, Table I.
        (np.diag([1, 1]), "trihedral"),
        (np.diag([1, -1]), "dihedral"),
        (np.diag([1, 0]), "dipole"),
        (np.diag([1, 0.5]), "cylinder"),
        (np.diag([1, -0.5]), "narrow diplane"),
        (np.diag([1, 1j]), "quarter wave"),
        (np.diag([1, -1j]), "quarter wave"),
        (targets.helix("left"), "left helix"),
        (targets.helix("right"), "right helix"),
        (np.array([[0, 1], [-1, 0]]), "non-reciprocal"),
        (np.zeros((2, 2)), "undefined"),
        (np.full((2, 2), np.nan), "undefined"),
    ],
)
@pytest.mark.parametrize("angle", [0.0, 0.6, -1.2])
def test_cameron_names_canonical_targets(matrix: np.ndarray, name: str, angle: float) -> None:
    found = cameron_of(targets.turned(matrix.astype(complex) * np.exp(0.7j), angle))
    assert coherent.CLASSES[int(found[0])] == name
    if name in ("dipole", "cylinder", "narrow diplane"):
        np.testing.assert_allclose(np.exp(2j * found[2]), np.exp(2j * angle), atol=1e-9)


def test_cameron_kernel_is_its_reference() -> None:
    rng = np.random.default_rng(4)
    s = rng.normal(size=(4, 20, 25)) + 1j * rng.normal(size=(4, 20, 25))
    s[2, 5:] = s[1, 5:]
    s[:, 0, 0], s[:, 0, 1] = 0, np.nan
    np.testing.assert_allclose(coherent.cameron(s), coherent.cameron_reference(s), atol=1e-12)
    with pytest.raises(DataError, match=r"must be \(4, rows, columns\)"):
        coherent.cameron(s[:3])


@given(st.lists(st.floats(-3, 3), min_size=6, max_size=6))
@settings(max_examples=50, deadline=None)
def test_krogager_powers_of_a_single_look(numbers: list[float]) -> None:
    hh, hv, vv = np.array(numbers[:3]) + 1j * np.array(numbers[3:])
    s = np.array([[hh, hv], [hv, vv]])
    sphere, diplane, helix, _ = coherent.krogager(s)
    np.testing.assert_allclose(
        coherent.krogager_powers(one(s))[:, 0, 0], np.array([sphere, diplane, helix]) ** 2, atol=1e-6
    )
    # |S_rr|^2 + |S_ll|^2 + 2 |S_rl|^2 is the span in circular polarization.
    span = abs(hh) ** 2 + 2 * abs(hv) ** 2 + abs(vv) ** 2
    np.testing.assert_allclose((diplane + helix) ** 2 + diplane**2 + 2 * sphere**2, span, atol=1e-9)


@pytest.mark.parametrize(
    ("truth", "looks"), [((1, 0.3, 0.1), 9), ((1, 0.3, 0.1), 25), ((1, 0.1, 0.01), 25), ((1, 0.5, 0.4), 49)]
)
def test_the_bias_of_entropy_is_foretold(truth: tuple[float, float, float], looks: int) -> None:
    # Monte Carlo of complex Wishart matrices: the correction leaves less than 40 % of the bias; the standard error of
    # the mean entropy of 4000 trials is below 0.002.
    rng = np.random.default_rng(7)
    k = rng.normal(size=(4000, 3, looks)) + 1j * rng.normal(size=(4000, 3, looks))
    k *= np.sqrt(np.array(truth) / 2)[:, None]
    values = np.linalg.eigvalsh(k @ k.conj().swapaxes(1, 2) / looks)[:, ::-1].T
    bias = float(entropy_of(truth)) - entropy_of(values).mean()
    assert bias > 0
    assert abs(bias - entropy_bias(values, looks).mean()) < 0.4 * bias + 0.002
    corrected = unbiased_eigenvalues(values, looks)
    np.testing.assert_allclose(corrected.sum(axis=0), values.sum(axis=0), rtol=1e-12)
    assert np.abs(corrected.mean(axis=1) - truth).max() < np.abs(values.mean(axis=1) - truth).max()


def test_what_cannot_be_decomposed_is_refused() -> None:
    with pytest.raises(DataError, match="no Yamaguchi model 'fast'"):
        yamaguchi(scene(), "fast")  # type: ignore[arg-type]
    with pytest.raises(DataError, match="2 looks has no correction"):
        entropy_bias([1, 0.5, 0.1], 2)
