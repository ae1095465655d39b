"""Marks, and rooms of their own: no test writes into the user's data folder or meets another test's engine."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest
from hypothesis import settings

# A run of the tests gives the same result twice; other examples are sought by make explore.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("explore", deadline=None, print_blob=True)
settings.load_profile("repeatable")

REAL_TIME = {
    "audio",
    "camera",
    "campaigns",
    "demo",
    "engine",
    "faults",
    "gentl",
    "gige",
    "gui",
    "plugins",
    "replay",
    "serial",
}
"""Folders of tests that talk to devices or engines in real time; they run after the numerics, which fill every core."""

_number = itertools.count()
_tests = Path(__file__).parent


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if REAL_TIME & set(item.path.relative_to(_tests).parts[:-1]):
            item.add_marker(pytest.mark.realtime)


@pytest.fixture(autouse=True)
def own_folders(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    base, number = tmp_path_factory.getbasetemp(), next(_number)
    monkeypatch.setenv("POLFUSE_USER_DATA", str(base / f"user-data-{number}"))
    runtime = base / f"run-{number}"
    runtime.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime))
