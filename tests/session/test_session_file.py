"""Writing and reading session files: what goes in comes out, and no file is ever replaced."""

from __future__ import annotations

import json

import h5py
import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from session_records import clock, config, exposure, sweeps

from drivers.records import Identity, PolarizerFix, SwitchState, TrolleyFix
from polfuse_lab.errors import PolfuseError
from polfuse_lab.records import Event, Note, Observed, SourceFix, SweepFlag
from polfuse_lab.session import SessionWriter, info, open_session
from polfuse_lab.session.layout import TABLES, TEXT_BYTES, VERSION, encode_text, split_text
from polfuse_lab.session.wire import record_from, record_message


def write(path, records, **changes):
    with SessionWriter.create(path, config(**changes)) as writer:
        for record in records:
            writer.write(record)
    return path


@pytest.mark.parametrize("dtype", ["int16", "int32", "float32"])
def test_samples_come_back_as_sampled(path, dtype):
    records = [sweeps(n, frames, dtype) for n, frames in enumerate([500, 1, 1234, 500])]
    write(path, records, sample_dtype=dtype)
    with open_session(path) as session:
        for index, record in enumerate(records):
            samples = session.audio(index)
            assert samples.dtype == np.dtype(dtype)
            np.testing.assert_array_equal(samples, record.block.samples)


def test_every_field_of_every_record_comes_back(path):
    flags = SweepFlag.LOST | SweepFlag.RETRY
    records = [
        sweeps(7, sweeps_requested=4, flags=flags, attempt=2),
        exposure(3),
        TrolleyFix(0.1, 0.002, False, 5, "Idle"),
        SwitchState("H", "V", True, 6),
        PolarizerFix(0.7, 0.01, False, 7),
        clock(2),
        Note("Wind from the left – ½ Bft", 8),
        Event("warning", "a text", 9),
        Observed(TrolleyFix(0.2, 0.002, True, 10, "Run"), 0),
        SourceFix(PolarizerFix(0.3, 0.02, False, 11)),
        Observed(SourceFix(PolarizerFix(0.3, 0.02, True, 12)), 0),
    ]
    # What reaches the writer's process is what was offered to it.
    for record in records[2:]:
        header, payload = record_message(record)
        assert record_from(msgspec.msgpack.decode(msgspec.msgpack.encode(header)), payload) == record
    write(path, records, identities=(Identity("radar", "d", "n", "x"),), extra={"a": [1, 2]})
    with open_session(path) as s:
        assert (s.state, s.complete, s.schema) == ("finished", True, "polfuse-session/2")
        row = s.sweeps[0]
        assert row["channel"] == 3
        assert (row["position"], row["x_m"], row["sweeps_requested"], row["attempt"]) == (1, 0.07, 4, 2)
        assert (row["t_host_ns"], row["t_device_s"], row["device_frame"]) == (700_000_000, 7 * 0.1, 70_000)
        assert row["flags"] == int(flags)
        np.testing.assert_array_equal(s.frame(0), exposure(3).frame.image)
        assert (s.frames[0]["angle_rad"], s.frames[0]["frame_id"], s.frames[0]["dark"]) == (0.5, 3, False)
        assert s.trolley.tolist() == [(0.1, 0.002, False, 5, b"Idle", -1), (0.2, 0.002, True, 10, b"Run", 0)]
        assert s.switches.tolist() == [(b"H", b"V", True, 6, -1)]
        assert s.polarizer.tolist() == [(0.7, 0.01, False, 7, -1)]
        assert s.source_polarizer.tolist() == [(0.3, 0.02, False, 11, -1), (0.3, 0.02, True, 12, 0)]
        assert s.clocks.tolist() == [(b"radar", 10.0, 10_000_000_000, 20_000)]
        assert s.notes[0]["text"].decode() == "Wind from the left – ½ Bft"
        assert s.events.tolist() == [(b"warning", b"a text", 9)]
        assert s.config["identities"][0]["driver"] == "d"
        assert s.config["extra"] == {"a": [1, 2]}
        assert s.config["versions"]["h5py"] == h5py.__version__
        assert s.waveform == config().waveform
        assert (s.rig, s.plan) == (None, None)


def test_audio_begins_at_chunks_and_nothing_is_rewritten(path):
    # 20 records of 500 frames in chunks of 500, each flushed: 4 bytes a frame, random, so incompressible. The rest is
    # the tables' first chunks (declared sizes) and HDF5's own; measured growth without alignment was several fold.
    with SessionWriter.create(path, config()) as writer:
        for number in range(20):
            writer.write(sweeps(number))
            writer.flush()
    tables = sum(dtype.itemsize * (16 if dtype.itemsize > 500 else 256) for dtype in TABLES.values())
    assert path.stat().st_size < 20 * 500 * 4 * 1.1 + tables + 40_000
    with open_session(path) as session:
        assert session.sweeps["first_sample"].tolist() == [500 * n for n in range(20)]


def test_no_object_is_created_while_recording(path):
    def objects(file):
        names = []
        file.visititems(lambda name, item: names.append((name, len(item.attrs))))
        return sorted(names), len(file.attrs)

    writer = SessionWriter.create(path, config())
    with h5py.File(writer.partial, "r", swmr=True) as file:
        declared = objects(file)
    for record in (sweeps(0), exposure(0), clock(0), Note("n", 0), Event("k", "t", 0)):
        writer.write(record)
    writer.close()
    with h5py.File(path, "r") as file:
        assert objects(file) == declared


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(frames=st.lists(st.integers(1, 1200), max_size=6), images=st.integers(0, 3))
def test_every_flushed_record_is_readable_while_writing(tmp_path_factory, frames, images):
    path = tmp_path_factory.mktemp("live") / "s.h5"
    writer = SessionWriter.create(path, config())
    for number, count in enumerate(frames):
        writer.write(sweeps(number, count))
    for number in range(images):
        writer.write(exposure(number))
    writer.flush()
    with open_session(writer.partial) as session:
        assert (session.state, session.complete) == ("recording", False)
        assert (len(session.sweeps), len(session.frames)) == (len(frames), images)
        for number, count in enumerate(frames):
            np.testing.assert_array_equal(session.audio(number), sweeps(number, count).block.samples)
        for number in range(images):
            np.testing.assert_array_equal(session.frame(number), exposure(number).frame.image)
        writer.write(sweeps(99))
        writer.flush()
        session.refresh()
        np.testing.assert_array_equal(session.audio(len(frames)), sweeps(99).block.samples)
    writer.close()


def test_a_file_that_exists_is_refused_and_untouched(path):
    path.write_bytes(b"precious")
    with pytest.raises(PolfuseError, match="never overwritten"):
        SessionWriter.create(path, config())
    assert path.read_bytes() == b"precious"
    other = path.with_name("t.h5")
    other.with_name("t.h5.partial").write_bytes(b"crashed")
    with pytest.raises(PolfuseError, match="polfuse recover"):
        SessionWriter.create(other, config())
    assert other.with_name("t.h5.partial").read_bytes() == b"crashed"


def test_a_file_that_appears_meanwhile_is_not_replaced(path):
    writer = SessionWriter.create(path, config())
    writer.write(sweeps(0))
    path.write_bytes(b"precious")
    assert writer.close() == path.with_name("s-1.h5")
    assert path.read_bytes() == b"precious"
    assert info(path.with_name("s-1.h5"))["sweeps"] == 1


def test_an_exception_closes_the_session_as_failed(path):
    def broken_import():
        yield sweeps(0)
        raise RuntimeError("the importer broke")

    with pytest.raises(RuntimeError):
        write(path, broken_import())
    with open_session(path) as session:
        assert (session.state, session.reason, len(session.sweeps)) == ("failed", "the importer broke", 1)


@pytest.mark.parametrize(
    "record", [sweeps(0, dtype="int32"), exposure(0)], ids=["another sample type", "a frame without a camera"]
)
def test_records_that_do_not_fit_are_refused(path, record):
    writer = SessionWriter.create(path, config(frame_shape=None))
    with pytest.raises(PolfuseError, match="declare it"):
        writer.write(record)
    writer.write(sweeps(0))
    writer.close()
    assert info(path)["sweeps"] == 1


def test_writing_after_the_end_is_refused(path):
    writer = SessionWriter.create(path, config())
    assert writer.close() == writer.close()
    with pytest.raises(PolfuseError, match="closed"):
        writer.write(sweeps(0))


@given(st.text(max_size=600), st.integers(4, 40))
def test_split_text_keeps_every_character(text, limit):
    pieces = split_text(text, limit)
    assert all(len(piece) <= limit for piece in pieces)
    assert b"".join(pieces).decode() == text.replace("\0", "").encode("utf-8", "replace").decode()


def test_long_text_is_cut_at_a_whole_character():
    # "ä" has 2 bytes of UTF-8, so an odd limit falls into the middle of one.
    assert encode_text("ä" * TEXT_BYTES, TEXT_BYTES - 1).decode() == "ä" * (TEXT_BYTES // 2 - 1)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is not an HDF5 file"),
        (b"RIFF....WAVE" * 100, "is not an HDF5 file"),
        (b"\x89HDF\r\n\x1a\n" + b"\0" * 200, "not a readable HDF5 file"),
    ],
)
def test_what_is_no_session_is_refused(path, content, message):
    path.write_bytes(content)
    with pytest.raises(PolfuseError, match=message):
        open_session(path)


def test_foreign_and_newer_files_are_refused(path):
    with h5py.File(path, "w") as file:
        file["x"] = 1
    with pytest.raises(PolfuseError, match="not a PolFuse session"):
        open_session(path)
    newer = path.with_name("n.h5")
    write(newer, [])
    with h5py.File(newer, "r+") as file:
        file.attrs["version"] = VERSION + 1
    with pytest.raises(PolfuseError, match="update PolFuse Lab"):
        open_session(newer)
    with pytest.raises(PolfuseError, match="does not exist"):
        open_session(path.with_name("nothing.h5"))


def test_info_of_a_session_without_a_rig(path):
    write(path, [sweeps(0), sweeps(5), clock(0)], frame_shape=None)
    found = info(path)
    assert found["channels"] == ["HH", "HV"]
    assert found["positions"] == 2
    # From the first sample (0 s) to the last of record 5 (0.5 s + 500 / 48000 s).
    assert found["duration_s"] == pytest.approx(0.5 + 500 / 48_000, abs=2e-9)
    # One pair of readings 20 us apart: known to half of that.
    assert found["sync_rms_s"] == pytest.approx(10e-6)
    assert found["problems"] == []
    json.dumps(found)


def test_info_tells_what_is_missing_from_the_plan(path):
    plan = 'kind = "sky"\nchannels = ["HH", "VV"]\n[optics]\nframes_per_angle = 1\n'
    write(path, [sweeps(0), sweeps(3, flags=SweepFlag.LOST), exposure(0)], plan_toml=plan)
    problems = " | ".join(info(path)["problems"])
    # VV was lost; 4 default angles of one frame were planned.
    assert "1 of 2 planned position-channel records are missing" in problems
    assert "3 of 4 planned camera frames are missing" in problems
    assert "1 audio records lost audio frames" in problems
