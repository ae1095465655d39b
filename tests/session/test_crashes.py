"""Killed writers, damaged files and full disks."""

from __future__ import annotations

import contextlib
import errno
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from session_records import clock, config, exposure, sweeps

from polfuse_lab.errors import PolfuseError
from polfuse_lab.session import SessionWriter, info, open_session, recover, recovery
from polfuse_lab.session import space as disk
from polfuse_lab.session.space import Ballast, ballast_path, in_use, is_disk_full, require_free

# Writes and flushes records for ever, telling after each flush how many are safe.
WRITER = """
import sys
sys.path.insert(0, {folder!r})
from session_records import clock, config, exposure, sweeps
from polfuse_lab.session import SessionWriter
writer = SessionWriter.create({path!r}, config())
for number in range(100_000):
    writer.write(sweeps(number))
    writer.write(exposure(number))
    writer.write(clock(number))
    writer.flush()
    print(number + 1, flush=True)
"""


def killed_after(path: Path, seconds: float) -> int:
    """Start a writer, kill it some time after its first record, and return how many records it had flushed."""
    code = WRITER.format(folder=str(Path(__file__).parent), path=str(path))
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    process.stdout.readline()
    time.sleep(seconds)
    process.send_signal(signal.SIGKILL)
    rest, _ = process.communicate(timeout=20)
    whole = [line for line in rest.splitlines(keepends=True) if line.endswith("\n")]
    return int(whole[-1]) if whole else 1


@pytest.mark.parametrize("attempt", range(4))
def test_killed_at_any_instant_every_flushed_record_survives(path, attempt):
    flushed = killed_after(path, random.Random(attempt).uniform(0.0, 0.25))
    partial = path.with_name("s.h5.partial")
    assert partial.exists()
    assert not path.exists()
    assert not in_use(ballast_path(path))
    with open_session(partial) as session:
        assert session.state == "recording"
        assert len(session.sweeps) >= flushed
    rescued = recover(partial, path)
    assert not ballast_path(path).exists()
    with open_session(path) as session:
        assert len(session.sweeps) >= flushed
        assert len(session.frames) >= flushed
        assert session.state == "engine lost"
        for number in range(flushed):
            np.testing.assert_array_equal(session.audio(number), sweeps(number).block.samples)
            np.testing.assert_array_equal(session.frame(number), exposure(number).frame.image)
            assert session.sweeps[number]["x_m"] == sweeps(number).x_m
        total = len(session.sweeps) + len(session.frames) + len(session.clocks)
    assert rescued.recovered_records == total
    assert partial.exists()


def finished(path: Path, records: int = 30) -> Path:
    with SessionWriter.create(path, config()) as writer:
        for number in range(records):
            writer.write(sweeps(number))
            writer.write(clock(number))
    return path


@pytest.mark.parametrize("share", [0.0, 0.0002, 0.001, 0.3, 0.9, 0.999])
def test_recover_of_a_truncated_file_is_refused_in_one_sentence(path, share):
    content = finished(path).read_bytes()
    cut = path.with_name("cut.h5.partial")
    cut.write_bytes(content[: int(share * len(content))])
    with pytest.raises(PolfuseError) as caught:
        recover(cut, path.with_name("out.h5"))
    assert str(cut) in str(caught.value)
    assert "is cut short" in str(caught.value) or "is not an HDF5 file" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert sorted(p.name for p in path.parent.iterdir()) == ["cut.h5.partial", "s.h5"]


def test_recover_keeps_what_can_be_read_of_damaged_audio(path):
    content = bytearray(finished(path).read_bytes())
    with h5py.File(path, "r") as file:
        place = file["audio"].id.get_chunk_info(12)
    content[place.byte_offset : place.byte_offset + 64] = b"\xff" * 64
    broken = path.with_name("broken.h5")
    broken.write_bytes(content)
    rescued = recover(broken, path.with_name("out.h5"))
    assert rescued.lost_records == 1
    with open_session(rescued.session) as session:
        assert len(session.sweeps) == 29
        np.testing.assert_array_equal(session.audio(12), sweeps(13).block.samples)


def test_recover_ends_a_reader_that_comes_to_nothing(path, monkeypatch):
    monkeypatch.setattr(recovery, "STALL_S", 0.0)
    with pytest.raises(PolfuseError, match="did not come forward"):
        recover(finished(path), path.with_name("out.h5"))
    assert [p.name for p in path.parent.iterdir()] == ["s.h5"]


def test_recover_refuses_a_file_that_is_written_and_existing_names(path):
    writer = SessionWriter.create(path, config())
    writer.write(sweeps(0))
    writer.flush()
    with pytest.raises(PolfuseError, match="still being written"):
        recover(writer.partial, path.with_name("out.h5"))
    writer.close()
    with pytest.raises(PolfuseError, match="never overwritten"):
        recover(path, path)
    with pytest.raises(PolfuseError, match="does not exist"):
        recover(path.with_name("nothing"), path.with_name("out.h5"))


def test_recover_of_a_finished_session_copies_it(path):
    rescued = recover(finished(path), path.with_name("out.h5"))
    assert (rescued.recovered_records, rescued.lost_records) == (60, 0)
    before, after = info(path), info(rescued.session)
    assert after == before


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 6 MB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount, umount = shutil.which("mount"), shutil.which("umount")
    options = ["-t", "tmpfs", "-o", "size=6m", "tmpfs", str(folder)]
    if not sys.platform.startswith("linux") or mount is None or umount is None or os.geteuid() != 0:
        pytest.skip("a small file system can only be mounted by root on Linux")
    if subprocess.run([mount, *options], capture_output=True).returncode:
        pytest.skip("this machine does not let a file system be mounted")
    yield folder
    subprocess.run([umount, "-l", str(folder)], check=True)


def fill_until_full(writer: SessionWriter, *, check: bool) -> int:
    """Write until the disk is full; return the number of records accepted and flushed."""
    flushed = 0
    with contextlib.suppress(PolfuseError):
        for number in range(2000):
            writer.write(sweeps(number, 5000))
            if check:
                writer.flush()
            else:
                assert writer._file is not None
                try:
                    writer._file.flush()
                except (OSError, RuntimeError) as error:
                    writer._fail(error)
            flushed = number + 1
    return flushed


@pytest.mark.parametrize("check", [True, False], ids=["watched", "unwatched"])
def test_full_disk_ends_in_a_clean_file(small_disk, check):
    path = small_disk / "s.h5"
    writer = SessionWriter.create(path, config(audio_block_frames=5000))
    flushed = fill_until_full(writer, check=check)
    # 6 MB less 2 MB of ballast hold at least 150 records of 20 kB.
    assert flushed >= 150
    with open_session(path) as session:
        assert (session.state, session.reason) == ("failed", "the disk is full")
        assert len(session.sweeps) >= flushed
        for number in (0, flushed // 2, flushed - 1):
            np.testing.assert_array_equal(session.audio(number), sweeps(number, 5000).block.samples)
    assert [p.name for p in small_disk.iterdir()] == ["s.h5"]


def test_too_small_a_disk_is_told_before_anything_is_written(small_disk):
    with pytest.raises(PolfuseError, match=r"needs about 102 MB and the disk has [56] MB left"):
        SessionWriter.create(small_disk / "s.h5", config(), expected_bytes=100_000_000)
    assert list(small_disk.iterdir()) == []


def test_disk_full_is_known_in_all_its_forms():
    assert is_disk_full(OSError(errno.ENOSPC, "x"))
    # As h5py 3.16 words a failed flush: the errno stands in the text only.
    assert is_disk_full(RuntimeError("Unable to flush file's cached information (file write failed: errno = 28, ...)"))
    assert not is_disk_full(OSError(errno.EIO, "Input/output error"))


def test_simulated_enospc_closes_cleanly(path, monkeypatch):
    writer = SessionWriter.create(path, config())
    writer.write(sweeps(0))

    append = writer._append_sweeps

    def full(*_):
        assert ballast_path(path).exists()
        # Once: what had not been flushed is written again when the ballast is gone.
        monkeypatch.setattr(writer, "_append_sweeps", append)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(writer, "_append_sweeps", full)
    with pytest.raises(PolfuseError, match=r"the disk is full; everything before that is kept in s\.h5"):
        writer.write(sweeps(1))
    assert info(path)["sweeps"] == 1
    assert not ballast_path(path).exists()


def test_free_space_is_asked_for(path, monkeypatch):
    monkeypatch.setattr(disk, "free_bytes", lambda _: 1_000_000)
    require_free(path, 1_000_000)
    with pytest.raises(PolfuseError, match="needs about 2 MB"):
        require_free(path, 2_000_000)


def test_ballast_takes_real_space_and_is_locked(tmp_path):
    ballast = Ballast(tmp_path / "b", 3_000_001)
    ballast.take()
    assert (tmp_path / "b").stat().st_size == 3_000_001
    assert (tmp_path / "b").stat().st_blocks * 512 >= 3_000_000
    assert in_use(tmp_path / "b")
    ballast.free()
    ballast.free()
    assert not (tmp_path / "b").exists()
