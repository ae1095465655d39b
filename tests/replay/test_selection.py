"""A session as a library: what is chosen is right, only that is read, and the documented example runs."""

from __future__ import annotations

import re
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from session.session_records import SHAPE, WAVEFORM, exposure, sweeps

from drivers.records import AudioBlock, Channel
from polfuse_lab.errors import PolfuseError
from polfuse_lab.records import Exposure, SweepFlag, Sweeps
from polfuse_lab.session import SessionConfig, SessionWriter, open_session

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "session-file.md"


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """Two passes over four positions: record n at 0.1 n seconds, in channel n % 4, at position n // 4; 3 frames."""
    path = tmp_path_factory.mktemp("library") / "day1.h5"
    made = SessionConfig("test", WAVEFORM, 48_000.0, audio_block_frames=500, frame_shape=SHAPE)
    with SessionWriter.create(path, made) as writer:
        for number in range(16):
            writer.write(sweeps(number))
        writer.write(sweeps(5, attempt=1, flags=SweepFlag.LOST | SweepFlag.REPEATED))
        writer.write(sweeps(6, attempt=1, flags=SweepFlag.REPEATED))
        for number in range(3):
            frame = exposure(number).frame
            writer.write(Exposure(frame, np.radians(45.0 * number), dark=number == 2))
    return path


def test_records_by_channel_position_and_time(path):
    with open_session(path) as session:
        assert session.select().indices.tolist() == list(range(18))
        assert session.select(channel="HV").indices.tolist() == [1, 5, 9, 13, 16]
        assert session.select(channel=(Channel.VV, "hh"), position=2).indices.tolist() == [8, 11]
        assert session.select(position=slice(2, None)).indices.tolist() == list(range(8, 16))
        assert session.select(position=[0, 3], channel="VH").indices.tolist() == [
            2,
            14,
        ]
        # The interval holds its beginning and not its end, exactly.
        assert session.select(time=(0.3, 0.5)).indices.tolist() == [3, 4]
        assert session.select(time=(None, 0.2)).indices.tolist() == [0, 1]
        # The second attempt at number 5 lost audio and replaces nothing; that at number 6 replaces it.
        assert session.select(latest=True, position=1).indices.tolist() == [4, 5, 7, 17]
        assert len(session.select(channel="HH", time=(100.0, None))) == 0
        with pytest.raises(PolfuseError, match=r"no channel 'XX'.*HH, HV, VH, VV"):
            session.select(channel="XX")


def test_records_tell_what_they_are_and_read_when_asked(path):
    with open_session(path) as session:
        chosen = session.select(channel="VV", position=slice(1, 4))
        assert [(r.channel, r.position, r.index) for r in chosen] == [(Channel.VV, p, 4 * p + 3) for p in (1, 2, 3)]
        np.testing.assert_allclose([r.time_s for r in chosen], [0.7, 1.1, 1.5], rtol=1e-12)
        np.testing.assert_array_equal(chosen.rows["x_m"], [r.x_m for r in chosen])
        np.testing.assert_array_equal(chosen[-1].samples, session.audio(15))
        assert [r.index for r in chosen[1:]] == [11, 15]
        np.testing.assert_array_equal(np.concatenate(list(chosen[0].blocks(180))), session.audio(7))
        frames = session.select_frames(angle_deg=(0, 45.3))
        assert frames.indices.tolist() == [0, 1]
        np.testing.assert_array_equal(frames[1].image, session.frame(1))
        assert session.select_frames(dark=True)[0].angle_deg == pytest.approx(90)
        assert session.select_frames(time=(0.1, 0.2)).indices.tolist() == [1]


@settings(max_examples=60, deadline=None)
@given(
    start=st.one_of(st.none(), st.integers(-600, 600)),
    stop=st.one_of(st.none(), st.integers(-600, 600)),
    step=st.one_of(st.none(), st.integers(1, 7), st.integers(-7, -1)),
)
def test_slices_of_a_record_are_those_of_its_array(path, start, stop, step):
    with open_session(path) as session:
        record, part = session.select(channel="HV")[1], slice(start, stop, step)
        np.testing.assert_array_equal(record[part], session.audio(5)[part])


def test_a_session_larger_than_the_memory_that_it_needs(tmp_path):
    """32 MB of audio in one channel, gone through in pieces: what is held at once is one piece and one chunk."""
    path = tmp_path / "large.h5"
    made = SessionConfig("test", WAVEFORM, 48_000.0, audio_block_frames=20_000)
    samples = np.random.default_rng(1).integers(-100, 100, (1_000_000, 2)).astype(np.int16)
    with SessionWriter.create(path, made) as writer:
        for number in range(8):
            writer.write(Sweeps(AudioBlock(samples, 48_000.0, 0, 0.0, number), Channel.HH, number))
    with open_session(path) as session:
        tracemalloc.start()
        total = sum(
            int(block.astype(np.int64).sum()) for r in session.select(channel="HH") for block in r.blocks(10_000)
        )
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert total == 8 * int(samples.sum(dtype=np.int64))
    assert peak < 2_000_000


def test_the_documented_example_runs(path, tmp_path, monkeypatch):
    monkeypatch.chdir(path.parent)
    blocks = re.findall(r"^```python\n(.*?)^```", DOCUMENT.read_text(), re.MULTILINE | re.DOTALL)
    assert blocks
    said = []
    exec(compile(blocks[0], str(DOCUMENT), "exec"), {"print": lambda *words: said.append(words)})
    # 4 positions in HH; two frames with the lens open.
    assert said[0] == ("HH", 4)
    assert len(said) == 1 + 4 + 2
