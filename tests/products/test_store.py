"""The products file: round trip, replacement as a whole, and what happens when it goes wrong."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import signal
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.provenance import arrays_sha256
from polfuse_lab.products.store import Products

IMAGE = (np.arange(12).reshape(3, 4) + 1j).astype(np.complex64)


def write(
    products: Products, stage: str = "focus", arrays: dict[str, np.ndarray] | None = None, **more: object
) -> None:
    given_ = {"settings": {"method": "bp"}, "inputs": [], "units": {}} | more
    products.write(stage, {"image": IMAGE} if arrays is None else arrays, **given_)  # type: ignore[arg-type]


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(
    array=hnp.arrays(
        st.sampled_from(["<f4", "<f8", "<c8", "<c16", "|i1", "<u2", "<i8", "|b1"]),
        hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=5),
    )
)
def test_any_array_comes_back_bit_for_bit(tmp_path: Path, array: np.ndarray) -> None:
    products = Products(tmp_path / "p.h5")
    write(products, arrays={"a": array})
    back = products.read("focus")["a"]
    assert back.dtype == array.dtype
    assert back.shape == array.shape
    assert back.tobytes() == array.tobytes()  # bytes: NaN payloads count too


def test_settings_units_and_order_of_stages(tmp_path: Path) -> None:
    products = Products(tmp_path / "p.h5")
    write(products, "ranging")
    write(products, "focus", settings={"channels": ("HH", "VV"), "z_m": np.float64(-1.07), "path": Path("a")})
    write(products, "calibration")
    write(products, "focus", units={"image": "m"}, settings={"channels": ("HH", "VV"), "z_m": np.float64(-1.07)})
    assert products.stages() == ["ranging", "focus", "calibration"]
    assert products.settings("focus") == {"channels": ["HH", "VV"], "z_m": -1.07}
    assert products.units("focus") == {"image": "m"}


def test_settings_longer_than_an_hdf5_attribute(tmp_path: Path) -> None:
    products = Products(tmp_path / "p.h5")
    long = {"rig_toml": "x" * 200_000}  # HDF5 attributes end at 65,536 bytes
    write(products, settings=long)
    assert products.settings("focus") == long


def test_provenance_holds_hashes_of_inputs_and_of_own_stages(tmp_path: Path) -> None:
    session = tmp_path / "s.h5"
    session.write_bytes(b"raw samples")
    products = Products(tmp_path / "p.h5")
    write(products, "focus", inputs=[session])
    write(products, "calibration", inputs=[products.path])
    origin = products.provenance("focus")
    assert origin["inputs"] == [
        {"path": str(session), "bytes": 11, "sha256": hashlib.sha256(b"raw samples").hexdigest()}
    ]
    assert origin["versions"]["numpy"] == np.__version__
    assert origin["time_utc"].endswith("+00:00")
    later = products.provenance("calibration")
    assert later["inputs"] == []
    assert later["stages"] == {"focus": arrays_sha256({"image": IMAGE})}


def test_same_input_gives_the_same_bytes_of_arrays(tmp_path: Path) -> None:
    first, second = Products(tmp_path / "1.h5"), Products(tmp_path / "2.h5")
    write(first)
    write(second)
    assert first.provenance("focus")["sha256"] == second.provenance("focus")["sha256"]
    write(second, arrays={"image": IMAGE.conj()})
    assert first.provenance("focus")["sha256"] != second.provenance("focus")["sha256"]


def test_a_missing_stage_names_the_command_that_makes_it(tmp_path: Path) -> None:
    products = Products(tmp_path / "p.h5")
    with pytest.raises(PolfuseError, match="polfuse focus"):
        products.read("focus")
    write(products)
    with pytest.raises(PolfuseError, match=r"no stage 'optics' \(present: focus\).*polfuse optics SESSION"):
        products.settings("optics")


@pytest.mark.parametrize("content", [b"", b"not HDF5 at all" * 100])
def test_a_file_that_is_no_hdf5(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "p.h5"
    path.write_bytes(content)
    with pytest.raises(PolfuseError, match="cannot be read as HDF5"):
        Products(path).stages()
    with pytest.raises(PolfuseError, match="cannot be read as HDF5"):
        write(Products(path))
    assert path.read_bytes() == content


def test_another_hdf5_file_is_refused_and_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "session.h5"
    with h5py.File(path, "w") as file:
        file.attrs["schema"] = "polfuse-session"
    before = path.read_bytes()
    with pytest.raises(PolfuseError, match="is no products file"):
        write(Products(path))
    assert path.read_bytes() == before


def test_a_newer_file_is_refused(tmp_path: Path) -> None:
    products = Products(tmp_path / "p.h5")
    write(products)
    with h5py.File(products.path, "r+") as file:
        file.attrs["version"] = 99
    with pytest.raises(PolfuseError, match="newer program"):
        products.read("focus")


def _keep_open(path: Path, opened: multiprocessing.synchronize.Event) -> None:
    with h5py.File(path, "r+"):
        opened.set()
        time.sleep(60)


def test_a_file_open_for_writing_elsewhere(tmp_path: Path) -> None:
    products = Products(tmp_path / "p.h5")
    write(products)
    context = multiprocessing.get_context("spawn")
    opened = context.Event()
    other = context.Process(target=_keep_open, args=(products.path, opened))
    other.start()
    try:
        assert opened.wait(30)
        with pytest.raises(PolfuseError, match="open for writing in another program"):
            products.read("focus")
    finally:
        other.kill()
        other.join(10)


@pytest.mark.parametrize("name", ["", "a/b", ".hidden"])
def test_bad_names(tmp_path: Path, name: str) -> None:
    with pytest.raises(PolfuseError, match="is no name"):
        write(Products(tmp_path / "p.h5"), name)


def test_texts_and_stray_units_are_refused(tmp_path: Path) -> None:
    products = Products(tmp_path / "p.h5")
    with pytest.raises(PolfuseError, match="not numbers"):
        write(products, arrays={"names": np.array(["HH"])})
    with pytest.raises(PolfuseError, match="units are given for imgae"):
        write(products, units={"imgae": "m"})
    assert not products.path.exists()


def test_a_missing_input_leaves_the_old_stage(tmp_path: Path) -> None:
    products = Products(tmp_path / "p.h5")
    write(products)
    with pytest.raises(PolfuseError, match=r"nowhere\.h5.*cannot be read"):
        write(products, arrays={"image": 2 * IMAGE}, inputs=[tmp_path / "nowhere.h5"])
    assert products.read("focus")["image"].tobytes() == IMAGE.tobytes()


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(PolfuseError, match="check that the folder exists"):
        write(Products(tmp_path / "no" / "p.h5"))


def _hold(path: Path, held: multiprocessing.synchronize.Event) -> None:
    from polfuse_lab.products.lock import exclusive

    with exclusive(path):
        held.set()
        time.sleep(60)


def test_a_second_writer_is_told_and_a_killed_one_leaves_no_lock(tmp_path: Path) -> None:
    products = Products(tmp_path / "p.h5")
    context = multiprocessing.get_context("spawn")
    held = context.Event()
    other = context.Process(target=_hold, args=(products.path, held))
    other.start()
    try:
        assert held.wait(30)
        with pytest.raises(PolfuseError, match="being written by another program"):
            write(products)
    finally:
        other.kill()
        other.join(10)
    write(products)
    assert products.stages() == ["focus"]
    assert [item.name for item in tmp_path.iterdir()] == ["p.h5"]


def _write_for_ever(path: Path) -> None:
    number = 0
    while True:
        number += 1
        Products(path).write(
            "focus", {"image": np.full((400, 400), number)}, settings={"number": number}, inputs=[], units={}
        )


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs kill -9")
def test_a_killed_writer_leaves_a_whole_stage(tmp_path: Path) -> None:
    products = Products(tmp_path / "p.h5")
    context = multiprocessing.get_context("spawn")
    for pause_s in (0.05, 0.013, 0.031):
        other = context.Process(target=_write_for_ever, args=(products.path,))
        other.start()
        limit = time.monotonic() + 30
        while not products.path.exists() and time.monotonic() < limit:
            time.sleep(0.01)
        time.sleep(pause_s)
        assert other.pid is not None
        os.kill(other.pid, signal.SIGKILL)
        other.join(10)
        # Whatever the instant: one number in the settings and in every pixel, never a mixture or a torn file.
        image = products.read("focus")["image"]
        assert np.unique(image).tolist() == [products.settings("focus")["number"]]
    write(products)
    assert products.read("focus")["image"].tobytes() == IMAGE.tobytes()
