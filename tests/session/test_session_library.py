"""Sessions as a library: larger than memory, while they are written, as xarray datasets, of every version."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
import tracemalloc
from pathlib import Path

import h5py
import numpy as np
import pytest
from session_records import WAVEFORM, clock, config, exposure, sweeps

from drivers.records import Channel, TrolleyFix
from polfuse_lab.errors import PolfuseError
from polfuse_lab.records import Event, Note
from polfuse_lab.session import SessionWriter, info, open_session
from polfuse_lab.session.layout import SWEEPS

RECORD = 50_000_000
"""Samples of a record of the huge session: 200 MB."""


@pytest.fixture
def huge(path: Path) -> Path:
    """A session of 100 records of 200 MB: 20 GB of audio, of which the disk holds only what was written."""
    with SessionWriter.create(path, config(frame_shape=None, audio_block_frames=65_536)) as writer:
        writer.write(sweeps(0, 1000))
    with h5py.File(path, "r+") as file:
        file["audio"].resize(100 * RECORD, axis=0)
        file["audio"][42 * RECORD + 7] = (123, -456)
        rows = np.zeros(100, SWEEPS)
        rows["first_sample"] = np.arange(100) * RECORD
        rows["samples"] = RECORD
        rows["channel"] = np.arange(100) % 4
        rows["position"] = np.arange(100) // 4
        rows["t_host_ns"] = np.arange(100) * 10**12
        file["sweeps"].resize(100, axis=0)
        file["sweeps"][:] = rows
    assert path.stat().st_size < 10_000_000
    return path


def test_a_session_larger_than_memory_is_chosen_from_and_read_in_pieces(huge):
    resident = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    tracemalloc.start()
    with open_session(huge) as session:
        chosen = session.select(channel="VH", position=slice(5, 15), time=(30_000.0, None))
        assert [record.index for record in chosen] == [30, 34, 38, 42, 46, 50, 54, 58]
        record = chosen[3]
        assert len(record) == RECORD
        assert record[7:8].tolist() == [[123, -456]]
        assert record[5:12:2].tolist() == [[0, 0], [123, -456], [0, 0], [0, 0]]
        found = 0
        for number, block in enumerate(record.blocks(1_000_000)):
            found += int(np.count_nonzero(block))
            if number == 9:
                break
        assert found == 2
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # A block is 4 MB; two of them may be there at once, beside the tables and HDF5's cache of chunks.
    assert peak < 30e6
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - resident) * 1024
    assert grown < 100e6


def test_xarray_reads_of_a_huge_session_only_what_is_looked_at(huge):
    pytest.importorskip("xarray")
    with open_session(huge) as session:
        session.to_xarray()  # what it imports counts for nothing
    tracemalloc.start()
    with open_session(huge) as session:
        dataset = session.to_xarray()
        assert dataset.audio.shape == (100, RECORD, 2)
        piece = dataset.audio.isel(record=42, sample=slice(0, 1000))
        assert piece.values[7].tolist() == [123, -456]
        assert not dataset.audio.isel(record=[1, 3], sample=[5, 7], input=1).values.any()
        assert dataset.sample_time[RECORD - 1] == pytest.approx((RECORD - 1) / 48_000)
    # The times alone of 50 million samples would be 400 MB.
    assert tracemalloc.get_traced_memory()[1] < 30e6
    tracemalloc.stop()


def small(path: Path) -> Path:
    with SessionWriter.create(path, config(extra={})) as writer:
        for number in range(8):
            writer.write(sweeps(number))
            writer.write(clock(number))
        for number in range(3):
            writer.write(exposure(number))
    return path


def test_xarray_has_the_samples_coordinates_and_units(path):
    pytest.importorskip("xarray")
    with open_session(small(path)) as session:
        dataset = session.to_xarray()
        assert dataset.audio.dims == ("record", "sample", "input")
        assert dataset.image.dims == ("frame", "row", "column")
        assert dataset.audio.dtype == np.int16
        for number in range(8):
            np.testing.assert_array_equal(dataset.audio[number].values, sweeps(number).block.samples)
        np.testing.assert_array_equal(dataset.image[2].values, exposure(2).frame.image)
        # Any mixture of indices gives what NumPy's would give of the whole array.
        whole = np.stack([sweeps(number).block.samples for number in range(8)])
        part = dataset.audio.isel(record=[5, 1], sample=slice(400, 100, -7), input=0)
        np.testing.assert_array_equal(part.values, whole[[5, 1], 400:100:-7, 0])
        np.testing.assert_array_equal(dataset.audio[3, 17].values, whole[3, 17])
        np.testing.assert_array_equal(dataset.audio[:, [9, 2], 1].values, whole[:, [9, 2], 1])
        assert dataset.audio[:0, :5].values.shape == (0, 5, 2)
        np.testing.assert_array_equal(dataset.image[:, 3, ::2].values[1], exposure(1).frame.image[3, ::2])
        assert dataset.channel.values.tolist() == [Channel(n % 4).name for n in range(8)]
        np.testing.assert_allclose(dataset.x, 0.01 * np.arange(8))
        assert (dataset.x.attrs["units"], dataset.sample_time.attrs["units"]) == ("m", "s")
        np.testing.assert_allclose(dataset.sample_time[[0, 499]], [0, 499 / 48_000])
        assert dataset.attrs["Conventions"].startswith("CF-")
        started = np.datetime64(session.config["started"][:19], "s")
        assert abs((dataset.time[0].values - started) / np.timedelta64(1, "s")) < 1e6
        # Records are 0.1 s apart.
        assert np.diff(dataset.time.values)[3] / np.timedelta64(1, "ms") == pytest.approx(100, abs=0.1)
        chosen = session.select(channel="VV").to_xarray()
        assert chosen.record.values.tolist() == [3, 7]
        np.testing.assert_array_equal(chosen.audio[1].values, whole[7])


def test_xarray_refuses_records_of_several_lengths_and_tells_that_it_is_missing(path, monkeypatch):
    with SessionWriter.create(path, config()) as writer:
        writer.write(sweeps(0, 500))
        writer.write(sweeps(1, 400))
    with open_session(path) as session:
        if "xarray" in sys.modules or pytest.importorskip("xarray"):
            with pytest.raises(PolfuseError, match="audio records of 400 to 500 samples make no array"):
                session.to_xarray()
            assert session.select(position=0, channel="HH").to_xarray().audio.shape == (1, 500, 2)
        monkeypatch.setitem(sys.modules, "polfuse_lab.session.xarray_view", None)
        monkeypatch.delattr("polfuse_lab.session.xarray_view", raising=False)
        with pytest.raises(PolfuseError, match=r"needs the package xarray .*pip install xarray"):
            session.to_xarray()


LOADED_WRITER = """
import sys
sys.path.insert(0, {folder!r})
from session_records import clock, config, exposure, sweeps
from polfuse_lab.session import SessionWriter
writer = SessionWriter.create({path!r}, config())
print("begun", flush=True)
for number in range({count}):
    writer.write(sweeps(number))
    writer.write(exposure(number))
    writer.write(clock(number))
    if number % 3 == 0:
        writer.flush()
writer.close()
"""


def test_reading_keeps_up_with_a_writer_under_load(path):
    # The writer writes as fast as it can; each record that is seen must be whole and right at once.
    count = 600
    code = LOADED_WRITER.format(folder=str(Path(__file__).parent), path=str(path), count=count)
    writer = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert writer.stdout is not None
    try:
        assert writer.stdout.readline() == "begun\n"
        partial = path.with_name("s.h5.partial")
        seen = looks = 0
        deadline = time.monotonic() + 60
        with open_session(partial) as session:
            while seen < count:
                assert time.monotonic() < deadline, f"only {seen} of {count} records came"
                session.refresh()
                looks += 1
                assert len(session.sweeps) >= seen
                for number in range(seen, len(session.sweeps)):
                    assert session.sweeps[number]["t_host_ns"] == number * 100_000_000
                    np.testing.assert_array_equal(session.audio(number), sweeps(number).block.samples)
                for number in range(len(session.frames))[-1:]:
                    np.testing.assert_array_equal(session.frame(number), exposure(number).frame.image)
                seen = len(session.sweeps)
                if writer.poll() is not None and seen < count:
                    session.refresh()
            assert session.sync.clocks["radar"].pairs >= 1
        assert looks > 3
        assert writer.wait(timeout=20) == 0
    finally:
        writer.kill()
        writer.wait()
        writer.stdout.close()
    with open_session(path) as session:
        assert (session.state, len(session.sweeps), session.missing_records) == ("finished", count, 0)


VERSION_1 = {
    "state": [("state", "S32"), ("reason", "S1000"), ("end_unix_s", "f8"), ("end_host_ns", "i8"),
              ("samples_lost", "i8"), ("frames_lost", "i8")],
    "sweeps": [("first_sample", "i8"), ("samples", "i8"), ("channel", "i4"), ("position", "i4"), ("x_m", "f8"),
               ("x_sd_m", "f8"), ("sweeps_requested", "i4"), ("attempt", "i4"), ("t_host_ns", "i8"),
               ("t_device_s", "f8"), ("device_frame", "i8"), ("lost", "i8"), ("flags", "u4")],
    "frames": [("angle_rad", "f8"), ("angle_sd_rad", "f8"), ("exposure_s", "f8"), ("gain_db", "f8"),
               ("frame_id", "i8"), ("t_host_ns", "i8"), ("t_device_s", "f8"), ("incomplete", "?"), ("dark", "?"),
               ("lost_before", "i4"), ("attempt", "i4")],
    "trolley": [("x_m", "f8"), ("sd_m", "f8"), ("moving", "?"), ("t_host_ns", "i8"), ("state", "S32")],
    "switches": [("transmit", "S4"), ("receive", "S4"), ("verified", "?"), ("t_host_ns", "i8")],
    "polarizer": [("angle_rad", "f8"), ("sd_rad", "f8"), ("moving", "?"), ("t_host_ns", "i8")],
    "clocks": [("device", "S32"), ("t_device_s", "f8"), ("t_host_ns", "i8"), ("round_trip_ns", "i8")],
    "notes": [("text", "S1000"), ("t_host_ns", "i8")],
    "events": [("kind", "S32"), ("text", "S1000"), ("t_host_ns", "i8")],
}  # fmt: skip
"""All tables of the first version, frozen: nothing here follows the package."""


def write_version_1(path: Path) -> None:
    """A file of the first version, written with h5py alone."""
    rows: dict[str, list[tuple[object, ...]]] = {
        "state": [(b"finished", b"all steps carried out", 1.7e9, 9, 0, 0)],
        "sweeps": [(0, 4, 3, 0, 0.25, 0.001, 1, 0, 1_000, 2.5, 120_000, 0, 0)],
        "frames": [(0.5, 0.01, 0.02, 3.0, 17, 2_000, 3.5, False, True, 0, 0)],
        "trolley": [(0.25, 0.001, False, 900, b"Idle")],
        "switches": [(b"V", b"V", True, 800)],
        "polarizer": [(0.5, 0.01, False, 1_900)],
        "clocks": [(b"radar", 2.5, 1_000, 20)],
        "notes": [(b"dry", 5_000)],
        "events": [(b"mark", b"target A", 700)],
    }
    settings = {
        "source": "collect", "waveform": WAVEFORM.model_dump(), "sample_rate_hz": 48_000.0, "sample_dtype": "int16",
        "audio_channels": 2, "frame_shape": [2, 3], "frame_dtype": "uint8", "rig_toml": None, "plan_toml": None,
        "identities": [], "extra": {}, "versions": {}, "host": {}, "started": "2026-01-02T03:04:05+00:00",
        "start_unix_s": 1.7e9, "start_host_ns": 0,
    }  # fmt: skip
    with h5py.File(path, "w") as file:
        file.attrs["schema"], file.attrs["version"] = "polfuse-session", 1
        file["config"] = np.frombuffer(json.dumps(settings).encode(), np.uint8)
        file["audio"] = np.arange(8, dtype=np.int16).reshape(4, 2)
        file["images"] = np.arange(6, dtype=np.uint8).reshape(1, 2, 3)
        for name, fields in VERSION_1.items():
            file[name] = np.array(rows[name], dtype=fields)


def test_a_file_of_the_first_version(path):
    write_version_1(path)
    with open_session(path) as session:
        assert session.schema == "polfuse-session/1"
        assert session.complete
        (record,) = session.select(channel="VV")
        assert (record.x_m, record.samples.tolist()) == (0.25, [[0, 1], [2, 3], [4, 5], [6, 7]])
        (frame,) = session.select_frames(dark=True)
        assert frame.image.tolist() == [[0, 1, 2], [3, 4, 5]]
        assert np.isnan(frame.row["source_angle_rad"])
        assert session.trolley["state"].tolist() == [b"Idle"]
        assert session.sync.clocks["radar"].pairs == 1
    found = info(path)
    assert found["notes"] == [
        {"kind": "mark", "time_s": pytest.approx(-3e-7), "text": "target A"},
        {"kind": "note", "time_s": pytest.approx(4e-6), "text": "dry"},
    ]
    assert found["problems"] == []


def test_long_notes_are_one_note_again(path):
    text = "ä" * 1500
    with SessionWriter.create(path, config()) as writer:
        writer.write(sweeps(0))
        writer.write(Note(text, 2_000_000_000))
        writer.write(Note("another", 3_000_000_000))
        writer.write(Event("mark", "target B", 1_000_000_000))
        writer.write(TrolleyFix(0.0, 0.001, False, 0, "Idle"))
    assert [(item["kind"], item["text"]) for item in info(path)["notes"]] == [
        ("mark", "target B"),
        ("note", text),
        ("note", "another"),
    ]
