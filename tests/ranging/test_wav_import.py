import contextlib
import json
import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from made_recordings import Point, recording
from scipy.io import wavfile
from typer.testing import CliRunner

from polfuse_lab.cli import build
from polfuse_lab.errors import PolfuseError
from polfuse_lab.imports import import_wav
from polfuse_lab.imports.riff import read_wav
from polfuse_lab.session import open_session

POINTS = [Point(20.0), Point(52.0, amplitude=0.05)]


def write_24_bit(path, samples, rate=48_000):
    """RIFF by hand: no library at hand writes 24 bits."""
    raw = samples.astype("<i4").view(np.uint8).reshape(-1, 4)[:, 1:].tobytes()
    header = b"fmt " + (16).to_bytes(4, "little") + (1).to_bytes(2, "little") + (2).to_bytes(2, "little")
    header += rate.to_bytes(4, "little") + (rate * 6).to_bytes(4, "little") + (6).to_bytes(2, "little")
    header += (24).to_bytes(2, "little") + b"LIST\x03\x00\x00\x00abc\x00"
    body = b"WAVE" + header + b"data" + len(raw).to_bytes(4, "little") + raw
    path.write_bytes(b"RIFF" + len(body).to_bytes(4, "little") + body)


@pytest.fixture
def wav(tmp_path):
    samples, _, _ = recording(POINTS, dtype=np.int16)
    path = tmp_path / "walk.wav"
    wavfile.write(path, 48_000, samples)
    return path


@pytest.mark.parametrize("dtype", [np.int16, np.int32, np.float32])
def test_samples_are_those_that_scipy_wrote(tmp_path, dtype):
    samples, _, _ = recording(POINTS, dtype=dtype)
    wavfile.write(tmp_path / "a.wav", 48_000, samples)
    read = read_wav(tmp_path / "a.wav")
    assert read.samples.dtype == dtype
    assert np.array_equal(read.samples, samples)
    assert read.sample_rate_hz == 48_000


def test_24_bit_samples_are_exact_and_odd_chunks_are_skipped(tmp_path):
    rng = np.random.default_rng(0)
    samples = rng.integers(-(2**23), 2**23, size=(500, 2)).astype(np.int32) << 8
    write_24_bit(tmp_path / "a.wav", samples)
    assert np.array_equal(read_wav(tmp_path / "a.wav").samples, samples)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", wavfile.WavFileWarning)
        assert np.array_equal(wavfile.read(tmp_path / "a.wav")[1], samples)  # SciPy reads the same


def test_a_header_that_was_never_completed_is_read_to_the_end(wav):
    content = bytearray(wav.read_bytes())
    at = content.index(b"data") + 4
    content[at : at + 4] = b"\xff\xff\xff\xff"
    whole = read_wav(wav).samples
    wav.write_bytes(content)
    assert np.array_equal(read_wav(wav).samples, whole)


@given(data=st.data())
@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_files_are_refused_in_words(tmp_path, data):
    samples = np.arange(40, dtype=np.int16).reshape(20, 2)
    path = tmp_path / "damaged.wav"
    wavfile.write(path, 48_000, samples)
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(0, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(0, len(content)))
    path.write_bytes(content[:cut])
    with contextlib.suppress(PolfuseError):  # and nothing else
        assert read_wav(path).samples.size > 0


def test_truncation_is_said(wav):
    content = wav.read_bytes()
    wav.write_bytes(content[: len(content) // 2])
    with pytest.raises(PolfuseError, match="cut short"):
        read_wav(wav)


def test_the_session_holds_the_samples_exactly_and_says_what_is_assumed(wav, tmp_path):
    done = import_wav([wav], tmp_path / "walk.h5")
    assert (done.sync_channel, done.sync_inverted, done.polarity_from) == (1, False, "convention")
    assert done.sweep_period_s == pytest.approx(1920.5 / 48_000, abs=1e-8)
    assert done.ramp_up_s == pytest.approx(960.25 / 48_000, abs=1e-8)
    assert any("assumption" in note for note in done.notes)
    with open_session(done.session) as session:
        assert session.complete
        assert np.array_equal(session.audio(0), wavfile.read(wav)[1])
        assert session.rig is None
        assert session.sample_rate_hz == 48_000
        assert session.waveform.bandwidth_hz == 80e6
        extra = session.config["extra"]
        assert extra["bandwidth_assumed"] is True
        assert extra["sync_inverted"] is False
        assert extra["files"][0]["name"] == "walk.wav"
        assert str(tmp_path) not in json.dumps(session.config)


def test_several_files_become_several_positions(wav, tmp_path):
    done = import_wav([wav, wav], tmp_path / "two.h5", bandwidth_hz=100e6, centre_hz=2.45e9)
    assert not done.bandwidth_assumed
    assert not any("assumption" in note for note in done.notes)
    with open_session(done.session) as session:
        assert session.sweeps["position"].tolist() == [0, 1]
        assert session.waveform.bandwidth_hz == 100e6


def test_files_of_different_radars_do_not_mix(wav, tmp_path):
    other, _, _ = recording(POINTS, dtype=np.int16, swapped=True)
    wavfile.write(tmp_path / "swapped.wav", 48_000, other)
    with pytest.raises(PolfuseError, match="other channel"):
        import_wav([wav, tmp_path / "swapped.wav"], tmp_path / "out.h5")
    slow, _, _ = recording(POINTS, dtype=np.int16, period=2100.0, ramp=1050.0)
    wavfile.write(tmp_path / "slow.wav", 48_000, slow)
    with pytest.raises(PolfuseError, match="sweep period"):
        import_wav([wav, tmp_path / "slow.wav"], tmp_path / "out.h5")
    assert not list(tmp_path.glob("out.h5*"))


def test_refusals_leave_no_file(tmp_path, wav):
    samples = wavfile.read(wav)[1]
    wavfile.write(tmp_path / "mono.wav", 48_000, samples[:, 0])
    wavfile.write(tmp_path / "same.wav", 48_000, samples[:, [0, 0]])
    (tmp_path / "text.wav").write_text("no sound at all")
    (tmp_path / "empty.wav").write_bytes(b"")
    wavfile.write(tmp_path / "old.wav", 48_000, (samples >> 8).astype(np.uint8))
    for name, words in (
        ("mono.wav", "1 channel"),
        ("same.wav", "identical"),
        ("text.wav", "not a WAV"),
        ("empty.wav", "empty"),
        ("old.wav", "unknown type"),
        ("missing.wav", "cannot be read"),
    ):
        with pytest.raises(PolfuseError, match=words) as caught:
            import_wav([tmp_path / name], tmp_path / "out.h5")
        assert name in str(caught.value)
    with pytest.raises(PolfuseError, match="impossible"):
        import_wav([wav], tmp_path / "out.h5", bandwidth_hz=9e9)
    with pytest.raises(PolfuseError, match="no file"):
        import_wav([], tmp_path / "out.h5")
    assert not list(tmp_path.glob("out.h5*"))


def test_the_command_prints_what_other_tools_rely_on(wav, tmp_path):
    run = CliRunner().invoke(build(), ["import", str(wav), "-o", str(tmp_path / "s.h5"), "--as", "wav", "--json"])
    assert run.exit_code == 0, run.stderr
    values = json.loads(run.stdout)
    assert values["sync_channel"] == 1
    assert values["sync_inverted"] is False
    assert values["sweep_period_s"] == pytest.approx(1920.5 / 48_000)
    assert values["sweeps"] == 12
    assert (values["bandwidth_hz"], values["bandwidth_assumed"]) == (80e6, True)
    again = CliRunner().invoke(build(), ["import", str(wav), "-o", str(tmp_path / "s.h5"), "--as", "wav"])
    assert again.exit_code == 1  # an existing session is never overwritten
    assert "s.h5" in again.stderr
    wrong = CliRunner().invoke(build(), ["import", str(wav), "-o", str(tmp_path / "t.h5"), "--as", "mp3"])
    assert wrong.exit_code == 2
    told = CliRunner().invoke(build(), ["import", str(wav), "-o", str(tmp_path / "u.h5"), "--as", "wav"])
    assert "assumption" in told.stdout
