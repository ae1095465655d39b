"""The package's top: every name is there, and none is imported before it is used."""

from __future__ import annotations

import subprocess
import sys

import pytest

import polfuse_lab as pf


@pytest.mark.parametrize("name", pf.__all__)
def test_every_public_name_is_there(name: str) -> None:
    assert callable(getattr(pf, name))
    assert name in dir(pf)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'focuss'"):
        pf.focuss  # noqa: B018


def test_importing_the_package_imports_nothing_heavy() -> None:
    code = "import sys, polfuse_lab; sys.exit(any(m in sys.modules for m in ('numpy', 'h5py', 'numba', 'pydantic')))"
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0
