"""No test writes into the user's own data folder."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def own_user_data(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("POLFUSE_USER_DATA", str(tmp_path_factory.getbasetemp() / "user-data"))
