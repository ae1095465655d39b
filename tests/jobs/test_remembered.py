"""What is remembered survives a crash; what is damaged is set aside and said."""

from __future__ import annotations

import json
import os
import threading
from pathlib import Path

import pytest

from drivers.user_data import user_data_folder
from polfuse_lab.remembered import (
    Settings,
    forget,
    recent_rigs,
    recent_sessions,
    remember_rig,
    remember_session,
)
from polfuse_lab.remembered.recent import MOST


def test_the_newest_is_first_and_each_file_is_there_once(tmp_path):
    for name in ("a.toml", "b.toml", "a.toml"):
        remember_rig(tmp_path / name, f"rig {name}")
    remember_session(tmp_path / "s.h5")
    assert [Path(item.path).name for item in recent_rigs()] == ["a.toml", "b.toml"]
    assert recent_rigs()[0].name == "rig a.toml"
    assert [item.name for item in recent_sessions()] == ["s.h5"]
    assert not recent_sessions()[0].exists
    (tmp_path / "s.h5").touch()
    assert recent_sessions()[0].exists
    forget(tmp_path / "a.toml")
    assert [Path(item.path).name for item in recent_rigs()] == ["b.toml"]


def test_no_more_than_the_last_are_kept():
    for number in range(MOST + 5):
        remember_session(f"/x/{number}.h5")
    kept = recent_sessions()
    assert len(kept) == MOST
    assert kept[0].name == f"{MOST + 4}.h5"


def test_two_programs_and_many_threads_lose_nothing():
    threads = [threading.Thread(target=remember_session, args=(f"/x/{number}.h5",)) for number in range(12)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(recent_sessions()) == 12


@pytest.mark.parametrize("content", ["", "{", "[]", '{"version": "x"}', '"\udcff', "[" * 5000])
def test_a_damaged_file_is_set_aside_and_begun_anew(content):
    folder = user_data_folder()
    folder.mkdir(parents=True)
    for name in ("recent.json", "settings.json"):
        (folder / name).write_bytes(content.encode(errors="surrogateescape"))
    assert recent_rigs() == []
    settings = Settings.load()
    assert "damaged" in settings.warning
    assert settings.get("theme", "dark") == "dark"
    remember_rig("/x/rig.toml")
    assert len(recent_rigs()) == 1
    settings.set("theme", "light")
    settings.save()
    assert settings.warning == ""
    assert Settings.load().get("theme", "dark") == "light"
    assert len(list(folder.glob("*-damaged-*"))) == 2


def test_entries_of_another_kind_are_left_out():
    folder = user_data_folder()
    folder.mkdir(parents=True)
    good = {"path": "/x/a.h5", "name": "a", "opened_unix_s": 5}
    (folder / "recent.json").write_text(
        json.dumps({"version": 1, "sessions": [good, 3, {"path": 4}, None], "rigs": "none"})
    )
    assert [item.name for item in recent_sessions()] == ["a"]
    assert recent_rigs() == []


def test_a_newer_version_is_neither_used_nor_overwritten():
    folder = user_data_folder()
    folder.mkdir(parents=True)
    newer = json.dumps({"version": 99, "values": {"theme": "future"}})
    (folder / "settings.json").write_text(newer)
    settings = Settings.load()
    assert "newer" in settings.warning
    assert settings.get("theme") is None
    settings.set("theme", "dark")
    settings.save()
    assert "newer" in settings.warning
    assert (folder / "settings.json").read_text() == newer


def test_values_keep_the_type_of_their_default():
    settings = Settings({"size": 3, "name": "x", "on": True, "odd": [1, 2]})
    assert settings.get("size", 1.5) == 3.0
    assert settings.get("size", 7) == 3
    assert settings.get("size", "large") == "large"
    # A bool is no number, and a number no bool.
    assert settings.get("on", 1) == 1
    assert settings.get("size", True) is True
    assert settings.get("odd", []) == [1, 2]
    assert settings.get("missing", "d") == "d"
    with pytest.raises(TypeError):
        settings.set("file", Path("x"))
    with pytest.raises(ValueError, match="JSON"):
        settings.set("size", float("nan"))
    settings.set("name", None)
    assert settings.get("name") is None


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_cannot_be_written_is_said():
    folder = user_data_folder()
    folder.mkdir(parents=True, mode=0o500)
    settings = Settings.load()
    settings.save()
    assert "cannot be written" in settings.warning


def test_a_folder_that_is_a_file_is_said(monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setenv("POLFUSE_USER_DATA", str(tmp_path / "file"))
    remember_rig("/x/rig.toml")
    settings = Settings.load()
    settings.save()
    assert "cannot be written" in settings.warning
    assert recent_rigs() == []
