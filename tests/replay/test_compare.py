"""Every byte counts: two sessions are the same only if nothing but where and when they were written differs."""

from __future__ import annotations

import json
import shutil
import tracemalloc

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from session.session_records import WAVEFORM, clock, config, exposure, sweeps

from drivers.records import PolarizerFix, SwitchState, TrolleyFix
from polfuse_lab.records import Event, Note
from polfuse_lab.replay import compare, compare_sessions
from polfuse_lab.session import SessionConfig, SessionWriter

DATASETS = ("audio", "images", "sweeps", "frames", "trolley", "switches", "polarizer", "clocks", "notes", "events")


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """A session with every kind of record, and a place for its changed copy."""
    folder = tmp_path_factory.mktemp("pair")
    path = folder / "a.h5"
    with SessionWriter.create(path, config()) as writer:
        for number in range(3):
            writer.write(sweeps(number))
            writer.write(exposure(number))
            writer.write(clock(number))
            writer.write(TrolleyFix(float("nan"), 0.001, False, number, "Idle"))
            writer.write(SwitchState("H", "V", True, number))
            writer.write(PolarizerFix(0.5, 0.001, False, number))
            writer.write(Note("wind", number))
            writer.write(Event("warning", "a sentence", number))
    return path, folder / "b.h5"


def test_a_copy_is_the_same_and_circumstances_do_not_count(pair):
    first, second = pair
    shutil.copy(first, second)
    assert compare_sessions(first, second) == []
    with h5py.File(second, "r+") as file:
        values = json.loads(bytes(file["config"][:]))
        values |= {"host": {"name": "another"}, "started": "later", "source": "replay"}
        del file["config"]
        file["config"] = np.frombuffer(json.dumps(values).encode(), np.uint8)
        state = file["state"][:]
        state["end_unix_s"] += 100
        file["state"][:] = state
    assert compare_sessions(first, second) == []


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(name=st.sampled_from(DATASETS), place=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_one_bit_anywhere_is_found(pair, name, place, bit):
    first, second = pair
    shutil.copy(first, second)
    with h5py.File(second, "r+") as file:
        rows = np.ascontiguousarray(file[name][:])
        raw = rows.view(np.uint8).reshape(-1)
        at = int(place * len(raw))
        raw[at] ^= 1 << bit
        if rows.dtype.names:
            boolean = [field for field in rows.dtype.names if rows.dtype[field].kind == "b"]
            for field in boolean:
                # HDF5 stores a truth value as an enumeration of 0 and 1: another bit of it would not be kept.
                rows[field] = rows[field].view(np.uint8) % 2
        with h5py.File(first) as untouched:
            before = untouched[name][:]
        changed = before.tobytes() != rows.tobytes()
        file[name][:] = rows
        changed = changed and file[name][:].tobytes() != before.tobytes()
    found = compare_sessions(first, second)
    assert [difference.dataset for difference in found] == ([name] if changed else [])
    if changed:
        row = at // rows[:1].nbytes
        assert f"1 rows differ, the first at row {row}" in found[0].what


def test_missing_rows_state_and_configuration_are_found(pair):
    first, second = pair
    shutil.copy(first, second)
    with h5py.File(second, "r+") as file:
        file["trolley"].resize(2, axis=0)
        state = file["state"][:]
        state["state"], state["samples_lost"] = b"aborted", 7
        file["state"][:] = state
        values = json.loads(bytes(file["config"][:])) | {"sample_rate_hz": 44_100.0}
        del file["config"]
        file["config"] = np.frombuffer(json.dumps(values).encode(), np.uint8)
        del file["images"]
    assert [str(difference) for difference in compare_sessions(first, second)] == [
        "config.sample_rate_hz: 48000.0 and 44100.0",
        "state.state: 'finished' and 'aborted'",
        "state.samples_lost: 0 and 7",
        "images: only in the first session",
        "trolley: 3 and 2 rows",
    ]


def test_large_sessions_are_compared_in_slabs(tmp_path, monkeypatch):
    """24 MB of audio against a limit of 1 MB: memory stays at a few slabs."""
    monkeypatch.setattr(compare, "SLAB_BYTES", 1_000_000)
    block = SessionConfig("test", WAVEFORM, 48_000.0, audio_block_frames=50_000)
    for name in ("a.h5", "b.h5"):
        with SessionWriter.create(tmp_path / name, block) as writer:
            for number in range(120):
                writer.write(sweeps(number % 3, 50_000))
    tracemalloc.start()
    assert compare_sessions(tmp_path / "a.h5", tmp_path / "b.h5") == []
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # Two slabs, their bytes for the comparison, and what h5py needs for one chunk of each.
    assert peak < 6_000_000
