"""The filter of a session's file: any is read back, and the one that is chosen by measuring keeps pace and room."""

from __future__ import annotations

import os
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from session_records import config, exposure, sweeps

from polfuse_lab.errors import PolfuseError
from polfuse_lab.plans.storage import expected_frame
from polfuse_lab.rig import CameraSection, StorageSection
from polfuse_lab.session import SessionWriter, open_session, recover
from polfuse_lab.session.filter_planner import Demand, Forecast, choose_filter, disk_bytes_per_s, forecast
from polfuse_lab.session.filters import FILTERS, options

RNG = np.random.default_rng(4)

# Sizes and times that can be followed by hand: 100, 50 and 25 bytes stored of 100, at 0, 10 and 100 ns a byte.
MADE_UP = {
    "audio": {
        "none": Forecast(1.0, 0.0),
        "bitshuffle-lz4": Forecast(0.5, 10.0),
        "bitshuffle-zstd": Forecast(0.25, 100.0),
    }
}


def demand(disk: float, *, free: int | None = None, pace: float = 1e5) -> Demand:
    return Demand({"audio": 10**8, "images": 0}, pace, disk, free, other_bytes=1000)


def test_by_hand_the_disk_decides() -> None:
    """1e8 bytes: none takes 1e8 / disk, lz4 1 s + 5e7 / disk, zstd 10 s + 2.5e7 / disk seconds."""
    assert choose_filter(MADE_UP, demand(1e9)).filter == "none"  # 0.1, 1.05, 10.0
    choice = choose_filter(MADE_UP, demand(2e7))  # 5, 3.5, 11.25
    assert (choice.filter, choice.kept, choice.predicted_bytes) == ("bitshuffle-lz4", True, 50_001_000)
    assert choice.predicted_seconds == pytest.approx(3.5)
    assert list(choice.considered) == ["bitshuffle-lz4", "none", "bitshuffle-zstd"]
    assert choose_filter(MADE_UP, demand(1e6)).filter == "bitshuffle-zstd"  # 100, 51, 35
    # Room for 30 MB: only the smallest; for 20 MB none, and that is told.
    assert choose_filter(MADE_UP, demand(1e9, free=30_000_000)).filter == "bitshuffle-zstd"
    choice = choose_filter(MADE_UP, demand(1e9, free=20_000_000))
    assert (choice.filter, choice.kept) == ("bitshuffle-zstd", False)
    assert "none finds room" in choice.explain()[0]
    # 9e6 bytes a second by zstd are too slow for 1e7, so that room alone does not take it.
    choice = choose_filter(MADE_UP, demand(1e9, free=30_000_000, pace=1e7))
    assert (choice.filter, choice.kept) == ("bitshuffle-lz4", False)
    choice = choose_filter(MADE_UP, demand(1e9, pace=1e12))
    assert (choice.filter, choice.kept) == ("none", False)
    assert "none keeps the pace" in choice.reason
    assert any("does not keep the pace" in line for line in choice.explain())


@pytest.mark.parametrize("bits", [0, 3, 7, 12])
def test_size_by_the_bits_of_noise(bits: int) -> None:
    """White noise of n whole bits takes n of 16 bits and hardly more, for bits are sorted by their weight."""
    sample = RNG.integers(0, 2**bits, (200_000, 2)).astype(np.int16)
    found = forecast(sample, 50_000)
    assert found["none"].ratio == pytest.approx(1 + 4 / 200_000, rel=1e-9)  # a checksum of 4 bytes for each chunk
    assert bits / 16 <= found["bitshuffle-lz4"].ratio <= bits / 16 + 0.02
    assert found["bitshuffle-zstd"].ratio <= found["bitshuffle-lz4"].ratio + 0.01
    assert all(0 < one.ns_per_byte < 1e4 for one in found.values())


def test_frames_foretold_from_the_rig_file_alone() -> None:
    """Another scene with the same camera: within a factor of two; the campaign is ``accuracy.planners``."""
    camera = CameraSection(
        driver="harvesters", width_px=200, height_px=160, pixel_format="Mono12", exposure_s=0.01, focal_length_m=0.008,
        pixel_pitch_m=5e-6, saturation_counts=4095, electrons_per_count=3.0, read_noise_counts=2.0,
    )  # fmt: skip
    foretold = forecast(expected_frame(camera)[None])
    row, column = np.mgrid[0:160, 0:200]
    light = 900 + 700 * np.sin(row / 17) * np.cos(column / 23)
    frame = np.rint(light + np.sqrt(light / 3 + 4) * RNG.normal(size=light.shape)).astype(np.uint16)
    for name, one in forecast(frame[None]).items():
        assert foretold[name].ratio / 2 < one.ratio < 2 * foretold[name].ratio


def test_the_disk_is_measured_and_left_as_it_was(tmp_path: Path) -> None:
    assert 1e5 < disk_bytes_per_s(tmp_path) < 1e12
    assert not list(tmp_path.iterdir())
    assert disk_bytes_per_s(tmp_path / "nowhere") == float("inf")


def test_what_cannot_be_stored() -> None:
    with pytest.raises(PolfuseError, match="no filter 'gzip'"):
        options("gzip")
    with pytest.raises(PolfuseError, match="no sample"):
        forecast(np.zeros((0, 2), np.int16))
    with pytest.raises(PolfuseError, match="no sample of images"):
        choose_filter(MADE_UP, Demand({"audio": 1, "images": 1}, 1.0, 1e9))


@pytest.mark.parametrize("name", FILTERS)
def test_every_filter_is_read_back(tmp_path: Path, name: str) -> None:
    path = tmp_path / "s.h5"
    records = [sweeps(0), exposure(1), sweeps(1), sweeps(2)]
    with SessionWriter.create(path, config(storage={"filter": name, "reason": "tried"})) as writer:
        for number, record in enumerate(records):
            writer.write(record, plain=number == 2)  # as a writer does that has fallen behind
    with open_session(path) as session:
        assert session.config["storage"] == {"filter": name, "reason": "tried"}
        np.testing.assert_array_equal(session.audio(1), records[2].block.samples)
        np.testing.assert_array_equal(session.frame(0), records[1].frame.image)
        assert session._file["audio"].id.get_create_plist().get_nfilters() == 1 + (name != "none")  # the checksum
    # A copy of the file is stored in the same way.
    os.rename(path, tmp_path / "s.h5.partial")
    recover(tmp_path / "s.h5.partial", tmp_path / "copy.h5")
    with open_session(tmp_path / "copy.h5") as session:
        np.testing.assert_array_equal(session.audio(2), records[3].block.samples)
        assert session._file["images"].id.get_create_plist().get_nfilters() == 1 + (name != "none")  # the checksum


def test_the_rig_file_knows_the_same_filters() -> None:
    (allowed,) = [item.annotation for name, item in StorageSection.model_fields.items() if name == "filter"]
    assert set(get_args(allowed)) == {"auto", *FILTERS}
    with pytest.raises(PolfuseError, match="no filter 'gzip'"):
        config(storage={"filter": "gzip"})
