"""Fused displays in the window: classes by name, Pauli space, one cursor on the ground and in the camera's picture."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtWidgets import QWidget

from gui.main_window import MainWindow
from gui.models.cursor import JoinedCursors, LinkedCursor
from gui.pages.collect_page import LAST_PLAN, CollectPage
from gui.pages.products_page import ProductsPage
from gui.widgets import demo
from gui.widgets.class_view import ClassView
from gui.widgets.pictured import view_of
from gui.widgets.space_view import PITCH_DEG, YAW_DEG, SpaceView, demo_space
from polfuse_lab import remembered
from polfuse_lab.products.pictures import Picture, Track
from polfuse_lab.products.places import Places
from polfuse_lab.products.store import Products
from processing.optics.camera_model import Pinhole

X, Y = np.linspace(-2, 2, 21), np.linspace(5, 9, 31)
CAMERA = Pinhole(0.008, 32e-6, 200, 150, (0.0, 0.0, 0.0), 0.2)


def registered() -> dict[str, np.ndarray]:
    """What stage "fusion" holds of a flat ground 1.2 m below the camera."""
    x, y = np.meshgrid(X, Y)
    u, v, _ = CAMERA.project(np.stack([x, y, np.full_like(x, -1.2)], axis=-1))
    return {"x_m": X, "y_m": Y, "u_px": u.astype(np.float32), "v_px": v.astype(np.float32)}


@pytest.mark.parametrize("name", demo.names())
def test_every_widget_can_be_seen_alone(qtbot, name: str) -> None:
    module = importlib.import_module(f"gui.widgets.{name}")
    widget: QWidget = module._demo()
    qtbot.addWidget(widget)
    widget.resize(640, 420)
    widget.show()
    qtbot.waitExposed(widget)
    image = widget.grab().toImage()
    seen = {image.pixel(QPoint(x, y)) for x in range(2, image.width(), 7) for y in range(2, image.height(), 7)}
    assert len(seen) > 2  # more than its ground


def test_classes_are_told_by_name(qtbot) -> None:
    labels = np.array([[0, 1, -1], [1, 1, 0]])
    view = view_of(Picture("c", "Classes", "classes", labels, "", X[:3], Y[:2], legend={0: "field", 1: "<roof>"}))
    qtbot.addWidget(view)
    assert isinstance(view, ClassView)
    assert view.describe(float(X[1]), float(Y[0])).endswith("   <roof>")
    assert view.describe(float(X[2]), float(Y[0])).endswith("   no class")
    assert "&lt;roof&gt;" in view.legend.text()
    assert view.value_at(float(X[1]), float(Y[0])) is None
    assert view.image.getLevels().tolist() == [-0.5, 1.5]


def test_tracks_are_drawn_with_their_words(qtbot) -> None:
    track = Track(np.array([0.0, 1.0]), np.array([5.0, 6.0]), "vx +1.00, vy +1.00 m/s")
    view = view_of(Picture("p", "P", "number", np.ones((31, 21)), "1", X, Y, tracks=(track,)))
    qtbot.addWidget(view)
    texts = [item.toPlainText() for item in view.item.items if hasattr(item, "toPlainText")]
    assert texts == ["vx +1.00, vy +1.00 m/s"]


def test_the_space_is_turned_and_marks_the_pixel_under_the_cursor(qtbot) -> None:
    space = demo_space()
    view = SpaceView(space)
    qtbot.addWidget(view)
    view.resize(800, 400)
    cursor = LinkedCursor()
    view.follow(cursor)
    cursor.move((3.0, 14.0))
    assert f"{space.features[3, 14, 3]:.3f}" in view.readout.text()
    cursor.move((99.0, 0.0))
    assert view.readout.text() == "undefined there"
    view.canvas.resize(800, 360)
    # The middle of the cube is the middle of each plot, whichever way it is turned.
    middle = np.array([[0.5], [0.5], [0.5], [0.5 * view.canvas._tops[3]]])
    for yaw, pitch in ((0, 0), (40, 30), (-100, 90)):
        view.canvas.turn(yaw, pitch)
        for up, x in ((1, 200), (3, 600)):
            np.testing.assert_allclose(view.canvas.places(middle, up), [[x, 180]], atol=1e-9)
    qtbot.keyClick(view.canvas, Qt.Key.Key_Up)
    assert view.canvas.turned[1] == 85.0
    qtbot.mouseDClick(view.canvas, Qt.MouseButton.LeftButton)
    assert view.canvas.turned == (YAW_DEG, PITCH_DEG)
    # From above, with the first axis to the right: |HH+VV| is across and |HH-VV| upwards on the screen.
    view.canvas.turn(-YAW_DEG, 90.0)
    ends = np.array([[0.0, 0, 1], [0, 0, 0], [0, 1, 0], [0, 0, 0]])  # origin, |HH+VV|, |HH-VV|
    origin, odd, even = view.canvas.places(ends, 1)
    assert odd[0] - origin[0] == pytest.approx(origin[1] - even[1])
    assert odd[0] > origin[0]


def test_ground_and_camera_share_a_cursor(qtbot) -> None:
    places = Places(registered())
    u, v, _ = CAMERA.project([X[15], Y[10], -1.2])
    assert places.to_camera(float(X[15]), float(Y[10])) == pytest.approx((float(u), float(v)), abs=1e-3)
    assert places.to_ground(float(u), float(v)) == pytest.approx((X[15], Y[10]))
    assert places.to_camera(3.0, 6.0) is None
    assert places.to_ground(5.0, 5.0) is None  # the sky
    ground, camera = LinkedCursor(), LinkedCursor()
    joined = JoinedCursors(ground, camera, places.to_camera, places.to_ground)
    ground.move((float(X[15]) + 0.03, float(Y[10])))
    assert camera.place == pytest.approx((float(u), float(v)), abs=1e-3)
    assert ground.place == (X[15] + 0.03, Y[10])  # it leads, and is not led back to the pixel's middle
    camera.move((5.0, 5.0))
    assert ground.place is None
    assert joined is not None


def test_pauli_beside_dolp_of_the_camera_and_of_the_ground(qtbot, window: MainWindow, tmp_path: Path) -> None:
    path = tmp_path / "fused.h5"
    products = Products(path)
    random = np.random.default_rng(0)
    features = np.abs(random.normal(0.3, 0.1, (4, 31, 21))).astype(np.float32)
    classes = (np.arange(21) > 10) * np.ones((31, 1), int)
    pauli = random.normal(size=(3, 31, 21)) + 0j
    axes = {"x_m": X, "y_m": Y}
    products.write("polarimetry", {"pauli": pauli, "span": np.abs(pauli[0]), **axes}, settings={}, inputs=[], units={})
    plane = np.full((150, 200), 0.25)
    planes = dict.fromkeys(("s0", "s0_sd", "dolp", "dolp_sd", "aop", "aop_sd"), plane)
    products.write("optics", planes, settings={}, inputs=[], units={})
    fusion = {"features": features, "classes": classes.astype(np.int8), "s0_on_ground": features[3], **registered()}
    products.write(
        "fusion", {**fusion, "dolp_on_ground": features[3]},
        settings={"class_names": ["left", "right"], "classes": {}}, inputs=[], units={},
    )  # fmt: skip
    window.open(path)
    page = window.page("products")
    assert isinstance(page, ProductsPage)

    def show(*names: str) -> None:
        page.choose(*names)
        qtbot.waitUntil(lambda: sorted(page.shown_names) == sorted(names))

    qtbot.waitUntil(lambda: page.holds("fusion.space"))
    show("polarimetry.pauli", "fusion.dolp_on_ground")
    page.views[0].pointed.emit((float(X[3]), float(Y[7])))
    assert f"DOLP on the ground {features[3, 7, 3]:.3f}" in page.views[1].readout.text()
    show("polarimetry.pauli", "optics.dolp")
    u, v, _ = CAMERA.project([X[3], Y[7], -1.2])
    page.views[0].pointed.emit((float(X[3]), float(Y[7])))
    assert page.views[1].readout.text().startswith(f"column {float(u):.0f} px, row {float(v):.0f} px")
    page.views[1].pointed.emit((float(u), float(v)))
    assert page.views[0].readout.text().startswith(f"x {X[3]:.2f} m, y {Y[7]:.2f} m")
    show("fusion.colours", "fusion.space")
    page.views[0].pointed.emit((float(X[3]), float(Y[7])))
    space = page.views[1]
    assert isinstance(space, SpaceView)
    assert f"DOLP {features[3, 7, 3]:.3f}" in space.readout.text()


def test_the_last_plan_is_there_again(qtbot, window: MainWindow) -> None:
    page = window.page("collect")
    assert isinstance(page, CollectPage)
    qtbot.waitUntil(lambda: page.draft.verdict is not None)
    assert remembered.Settings.load().get(LAST_PLAN) is None  # an example as it came
    text = 'kind = "polarizer_series"\nname = "mine"\n'
    page.text.setPlainText(text)
    qtbot.waitUntil(lambda: remembered.Settings.load().get(LAST_PLAN) == text)
    another = MainWindow()
    qtbot.addWidget(another)
    again = another.page("collect")
    assert isinstance(again, CollectPage)
    assert again.text.toPlainText() == text
    assert again.kinds.currentData() == "polarizer_series"
    qtbot.waitUntil(lambda: again.draft.verdict is not None)
    another.close()
