"""No test writes into the user's own data folder."""

from __future__ import annotations

import itertools

import pytest

_number = itertools.count()


@pytest.fixture(autouse=True)
def own_user_data(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("POLFUSE_USER_DATA", str(tmp_path_factory.getbasetemp() / f"user-data-{next(_number)}"))
