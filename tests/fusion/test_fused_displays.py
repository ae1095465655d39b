"""Fused displays: colours by their formula, classes in the space of Pauli components, pictures of every stage."""

from __future__ import annotations

import colorsys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Path3DCollection

from polfuse_lab.products import style
from polfuse_lab.products.fused_colours import class_rgb, fused_colours_figure, fused_rgb, largest_shown
from polfuse_lab.products.pauli_space import MOST, PauliSpace, load_space, space_figure
from polfuse_lab.products.pictures import load_picture, picture_names
from polfuse_lab.products.store import Products

UNIT = st.floats(0.02, 1.0)


@given(UNIT, UNIT, UNIT, UNIT)
def test_a_pure_mechanism_has_dolp_as_saturation_and_s0_as_value(dolp: float, full: float, s0: float, white: float):
    for number, hue in enumerate((0.0, 1 / 3, 2 / 3)):  # red, green, blue
        vector = np.zeros(4)
        vector[number], vector[3] = 0.7, dolp
        told = colorsys.rgb_to_hsv(*fused_rgb(vector, s0, full_dolp=full, white=white))
        assert told == pytest.approx((hue, min(dolp / full, 1), min(s0 / white, 1)), abs=1e-9)


def test_light_without_polarization_is_grey_and_without_s0_there_is_nothing() -> None:
    features = np.array([[1, np.nan, 0.6], [0, np.nan, 0.0], [0, np.nan, 0.6], [0.0, np.nan, 0.2]])
    rgb = fused_rgb(features, [0.5, 0.4, 1.0], full_dolp=0.2, white=1.0)
    # No polarization; an echo below the noise; two mechanisms alike: magenta.
    np.testing.assert_allclose(rgb, [[0.5, 0.5, 0.5], [0.4, 0.4, 0.4], [1, 0, 1]], atol=1e-12)
    assert np.isnan(fused_rgb(features, [0.5, np.nan, 1.0])[1]).all()
    assert largest_shown([np.nan, np.inf]) == 1.0
    np.testing.assert_allclose(largest_shown(np.arange(1001.0)), 995.0)


def test_classes_have_their_colours() -> None:
    rgb = class_rgb([[0, 1], [-1, 0]])
    np.testing.assert_allclose(rgb[0, 0], [0, 0x72 / 255, 0xB2 / 255])
    np.testing.assert_array_equal(rgb[1, 1], rgb[0, 0])
    assert np.isnan(rgb[1, 0]).all()


@pytest.fixture(scope="module")
def fused(tmp_path_factory: pytest.TempPathFactory) -> Products:
    """A fused file of 40 x 30 pixels with two classes, and a polarizer series between which something moved."""
    products = Products(tmp_path_factory.mktemp("displays") / "p.h5")
    random = np.random.default_rng(0)
    x, y = np.linspace(-2, 2, 40), np.linspace(4, 7, 30)
    features = np.abs(random.normal(0.1, 0.05, (4, 30, 40)))
    classes = np.repeat(np.arange(40) // 20, 30).reshape(40, 30).T.astype(np.int8)
    features[0, classes == 0] = 1.0
    features[2, classes == 1] = 1.0
    features[:, 0, 0], classes[0, 0] = np.nan, -1
    fusion = {"features": features.astype(np.float32), "classes": classes, "x_m": x, "y_m": y}
    products.write(
        "fusion",
        {**fusion, "s0_on_ground": np.full((30, 40), 900.0, np.float32)},
        # The first class is too small for statistics, as may happen: the second keeps its name.
        settings={"class_names": ["field", "roof"], "classes": {"roof": {}}},
        inputs=[],
        units={},
    )
    thing = np.zeros((20, 24), np.uint8)
    thing[4:7, 6:11] = 1
    planes = {name: random.random((20, 24)) for name in ("dolp", "dolp_sd", "dolp_before", "error_before")}
    products.write(
        "motion",
        {**planes, "error_after": planes["error_before"] / 10, "object": thing},
        settings={
            "velocity_m_s": None,
            "displacement_px": [[0, 0], [1.0, 2.0], [2.0, 4.0], [3.0, 6.0]],
            "time_s": [0.0, 0.5, 1.0, 1.5],
        },
        inputs=[],
        units={},
    )
    return products


def test_classes_in_space(fused: Products) -> None:
    space = load_space(fused)
    groups = space.groups(most=100)
    assert [points.shape for points in groups.values()] == [(4, 100), (4, 100)]
    assert (groups["field"][0] == 1.0).all()
    assert space.groups()["field"].shape == (4, 30 * 20 - 1)  # one of them is undefined
    assert MOST > 600
    # The cursor's place: the pixel it is in, none beside the picture or where nothing is defined.
    np.testing.assert_array_equal(space.at(2.04, 7.04), space.features[:, 29, 39].astype(np.float64))
    assert space.at(2.06, 7.0) is None
    assert space.at(-2.0, 4.0) is None


def test_figures(fused: Products, tmp_path: Path) -> None:
    drawn = space_figure(load_space(fused))
    assert [axes.get_zlabel() for axes in drawn.axes] == ["|HV| / norm", "DOLP (more: at the top)"]
    for axes in drawn.axes:
        assert isinstance(axes, Axes3D)
        for points in axes.collections:
            assert isinstance(points, Path3DCollection)
            assert np.ma.max(points._offsets3d[2]) <= axes.get_zlim()[1]
    assert [text.get_text() for text in drawn.legends[0].get_texts()] == ["field", "roof"]
    colours = fused_colours_figure(fused.read("fusion"))
    for name, figure in (("space", drawn), ("colours", colours)):
        assert style.save(figure, tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    nothing = np.full((4, 3, 3), np.nan)
    empty = PauliSpace(nothing, np.full((3, 3), -1), (), np.arange(3.0), np.arange(3.0))
    style.save(space_figure(empty), tmp_path / "empty.png")


def test_pictures_of_classes_and_of_what_moved(fused: Products) -> None:
    assert load_picture(fused, "fusion.classes").legend == {0: "field", 1: "roof"}
    assert load_picture(fused, "fusion.colours").values.shape == (30, 40, 3)
    names = dict(picture_names(fused))
    assert {"motion.dolp", "motion.dolp_before", "motion.error_after", "motion.object"} <= set(names)
    before, after = (load_picture(fused, f"motion.error_{when}") for when in ("before", "after"))
    assert before.limits == after.limits
    (track,) = after.tracks
    # The middle of columns 6 to 10 and rows 4 to 6; then 6 px to the right and 3 px down in 1.5 s.
    np.testing.assert_allclose((track.x[0], track.y[0]), (8, 5))
    np.testing.assert_allclose((track.x[-1], track.y[-1]), (14, 8))
    assert track.words == "+4.0 px/s right, +2.0 px/s down"
    thing = load_picture(fused, "motion.object")
    np.testing.assert_array_equal(thing.values >= 0, fused.read("motion")["object"] > 0)


def test_pictures_of_a_simulated_scene(tmp_path: Path) -> None:
    products = Products(tmp_path / "s.h5")
    body = np.array([[0, 1, 2], [-1, 1, 0]], np.int32)
    plane = np.full((2, 3), 0.25, np.float32)
    powers = {"single_m2": plane, "double_m2": 2 * plane * (body == 1), "multiple_m2": plane * 0}
    products.write(
        "simulation",
        {**dict.fromkeys(("s0", "dolp", "dolp_sd", "aop"), plane), **powers, "body": body,
         "x_m": np.arange(3.0), "y_m": np.arange(2.0)},
        settings={
            "bodies": [{"name": "yard", "kind": "ground"}, {"name": "van", "kind": "car", "velocity_m_s": [2, -1, 0]},
                       {"name": "lawn", "kind": "ground"}],
            "noise_span_m2": 0.01,
        },
        inputs=[],
        units={},
    )  # fmt: skip
    assert [name for name, _ in picture_names(products)] == [
        f"simulation.{part}" for part in ("s0", "dolp", "aop", "body", "mechanism")
    ]
    stands = load_picture(products, "simulation.body")
    np.testing.assert_array_equal(stands.values, [[0, 1, 0], [-1, 1, 0]])
    assert stands.legend == {0: "ground", 1: "car"}
    (track,) = stands.tracks
    np.testing.assert_allclose((track.x, track.y), ([1.0, 3.0], [0.5, -0.5]))  # a second's way
    assert track.words == "van: vx +2.00, vy -1.00 m/s"
    strongest = load_picture(products, "simulation.mechanism")
    np.testing.assert_array_equal(strongest.values, [[0, 1, 0], [0, 1, 0]])
    assert load_picture(products, "simulation.dolp").sd is not None
    assert load_picture(products, "simulation.aop").values[0, 0] == pytest.approx(np.degrees(0.25))
