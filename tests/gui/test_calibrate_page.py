"""The calibration page: reflectors are found where they stand, refused with reasons, and the outcome is told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import Qt

from gui.models import targets
from gui.models.targets import Looked, Stated, TargetList
from gui.pages.calibrate_page import CalibratePage
from gui.workbench import Workbench
from polfuse_lab.cli import calibration_options as options
from polfuse_lab.products.store import Products
from processing.calibration.rcs import square_trihedral_rcs

CENTRE_HZ, EDGE_M = 2.4e9, 0.61
WAVELENGTH_M = 299_792_458.0 / CENTRE_HZ
TRIHEDRAL, DIHEDRAL = (1.0, 8.0), (-2.0, 11.0)


@pytest.fixture
def focused(tmp_path: Path) -> Path:
    """A trihedral, S_hh = S_vv, and a dihedral, S_hh = -S_vv, as sincs in noise; calibrated already."""
    x, y = np.linspace(-5, 5, 201), np.linspace(4, 16, 161)
    rng = np.random.default_rng(2)
    image = (0.01 * (rng.normal(size=(4, 161, 201)) + 1j * rng.normal(size=(4, 161, 201)))).astype(np.complex64)
    amplitude = np.sqrt(square_trihedral_rcs(EDGE_M, WAVELENGTH_M))
    for (at_x, at_y), signs in ((TRIHEDRAL, (1, 0, 0, 1)), (DIHEDRAL, (1, 0, 0, -1))):
        # Amplitudes were compensated for the spreading R^2, which grows across a range cell.
        shape = np.outer(np.sinc((y - at_y) / 1.9) * (y / at_y) ** 2, np.sinc((x - at_x) / 0.5))
        for channel, sign in enumerate(signs):
            image[channel] += (sign * amplitude * shape).astype(np.complex64)
    path = tmp_path / "s-products.h5"
    antenna = np.stack([np.linspace(-1.5, 1.5, 61), np.zeros(61), np.zeros(61)], axis=1)
    store = Products(path)
    store.write("ranging", {"antenna_m": antenna}, settings={"range_compensated": True}, inputs=[], units={})
    store.write(
        "focus",
        {"image": image, "x_m": x, "y_m": y},
        settings={
            "channels": ["HH", "HV", "VH", "VV"], "z_m": 0.0, "centre_hz": CENTRE_HZ, "bandwidth_hz": 80e6,
            "range_compensated": True,
        },
        inputs=[],
        units={},
    )  # fmt: skip
    return path


@pytest.fixture
def page(qtbot, focused: Path) -> CalibratePage:
    bench = Workbench()
    made = CalibratePage(bench)
    bench.setParent(made)
    qtbot.addWidget(made)
    made.resize(1200, 700)
    made.show()
    qtbot.waitExposed(made)
    bench.open_products(focused)
    qtbot.waitUntil(lambda: made.view.shows)
    return made


def state(qtbot, page: CalibratePage, role: str, kind: str, place: tuple[float, float]) -> Looked:
    """Say what stands where, as a user does: choose, click in the picture, press the button."""
    page.role.setCurrentIndex(page.role.findData(role))
    page.kind.setCurrentText(kind)
    vb = page.view.item.vb
    point = page.view.graph.mapFromScene(vb.mapViewToScene(vb.mapToView(vb.mapFromView(_point(place)))))
    qtbot.mouseClick(page.view.graph.viewport(), Qt.MouseButton.LeftButton, pos=point)
    # A pixel of the screen is a few centimetres.
    assert page.x_m.value() == pytest.approx(place[0], abs=0.1)
    assert page.y_m.value() == pytest.approx(place[1], abs=0.1)
    count = len(page.targets.targets)
    qtbot.mouseClick(page.look_button, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: all(one.view is not None for one in page.targets.targets), timeout=20_000)
    assert len(page.targets.targets) >= count
    return page.targets.targets[-1]


def _point(place: tuple[float, float]):
    from PySide6.QtCore import QPointF

    return QPointF(*place)


def test_targets_are_found_and_marked_or_refused_with_reasons(qtbot, page: CalibratePage) -> None:
    assert not page.calibrate_button.isEnabled()
    found = state(qtbot, page, "constant", "trihedral", TRIHEDRAL)
    assert found.good, found.words
    assert found.view is not None
    # The peak is between pixels of 5 by 7.5 cm.
    assert (found.view.x_m, found.view.y_m) == pytest.approx(TRIHEDRAL, abs=0.1)
    assert page.calibrate_button.isEnabled()
    assert state(qtbot, page, "check", "dihedral", DIHEDRAL).good
    # Nothing stands here.
    empty = state(qtbot, page, "crosstalk", "dihedral_45", (-4.0, 6.5))
    assert not empty.good
    assert "REFUSED" in page.list.item(2).text()
    assert page.list.item(0).text().startswith("✓")
    # A dihedral turned by 45 degrees shows in the cross-polarized channels, a trihedral does not.
    wrong = state(qtbot, page, "crosstalk", "dihedral_45", TRIHEDRAL)
    assert not wrong.good
    assert len(page._marks.points()) == 4
    page.list.setCurrentRow(3)
    qtbot.mouseClick(page.remove_button, Qt.MouseButton.LeftButton)
    stated = [one.stated for one in page.targets.targets]
    assert [one.kind for one in stated] == ["trihedral", "dihedral", "dihedral_45"]
    # Everything can be taken back, and what was found is not looked for again.
    for count in (4, 3, 2, 1, 0):
        page.targets.undo.undo()
        assert len(page.targets.targets) == count
    assert not page.targets.undo.canUndo()
    assert not page.calibrate_button.isEnabled()
    while page.targets.undo.canRedo():
        page.targets.undo.redo()
    assert [one.stated for one in page.targets.targets] == stated
    assert not any(one.waiting for one in page.targets.targets)
    assert page.calibrate_button.isEnabled()


def test_a_further_target_has_a_height_of_its_own(qtbot, page: CalibratePage) -> None:
    state(qtbot, page, "constant", "trihedral", TRIHEDRAL)
    page.height_m.setValue(0.25)
    state(qtbot, page, "crosstalk", "dihedral", DIHEDRAL)
    (text,) = (str(word).partition("=")[2] for word in page.targets.job().words if str(word).startswith("--also="))
    spec = options.further(text, edge_m=9.0, height_m=9.0, angle_sd_deg=0.0)
    x_m, y_m = page.x_m.value(), page.y_m.value()
    assert (spec.kind, spec.x_m, spec.y_m, spec.edge_m, spec.height_m) == ("dihedral", x_m, y_m, EDGE_M, 0.25)


def test_the_job_takes_the_good_targets_only(qtbot, page: CalibratePage, monkeypatch: pytest.MonkeyPatch) -> None:
    state(qtbot, page, "constant", "trihedral", TRIHEDRAL)
    state(qtbot, page, "check", "dihedral", DIHEDRAL)
    state(qtbot, page, "crosstalk", "dihedral_45", (-4.0, 6.5))
    words = [str(word) for word in page.targets.job().words]
    assert "--target=trihedral" in words
    assert "--check=dihedral" in words
    assert not any(word.startswith("--also") for word in words)


def test_a_second_constant_takes_the_place_of_the_first() -> None:
    looked = TargetList()
    looked._products = Path("none.h5")
    ran: list[object] = []
    original = targets.background.run
    targets.background.run = lambda asker, work, done, failed: ran.append(work)  # nothing is looked for
    try:
        looked.add(Stated("constant", "trihedral", 0.0, 5.0))
        looked.add(Stated("constant", "plate", 1.0, 6.0))
        looked.add(Stated("crosstalk", "dihedral", 2.0, 6.0))
    finally:
        targets.background.run = original
    assert [one.stated.kind for one in looked.targets] == ["plate", "dihedral"]
    assert len(ran) == 3
    assert not looked.ready
