"""Options are refused alike from a rig file (pydantic) and from Python, with the field and what is allowed."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest
from pydantic import TypeAdapter, ValidationError
from serial_helpers import PatientOperator

from drivers.registry import available, driver_class

SERIAL = [("switches", "dowkey_ms", {"port": "p"}), ("switches", "numato_relay", {"port": "p"}),
          ("switches", "minicircuits_rc", {"host": "h"}), ("trolley", "grbl", {"port": "p", "length_m": 3.0}),
          ("trolley", "zaber", {"port": "p", "length_m": 3.0, "microstep_m": 1e-6}),
          ("trolley", "encoder", {"port": "p", "length_m": 3.0, "counts_per_m": 1e4}),
          ("trolley", "by_hand", {"length_m": 3.0}), ("polarizer", "ell14", {"port": "p"}),
          ("polarizer", "by_hand", {})]  # fmt: skip


def make(kind: str, name: str, options: Any) -> Any:
    cls = driver_class(kind, name)
    return cls(options, PatientOperator()) if name in ("by_hand", "encoder") else cls(options)


@pytest.mark.parametrize(("kind", "name", "options"), SERIAL)
def test_every_driver_is_installed_with_documented_options(kind: str, name: str, options: dict[str, Any]) -> None:
    assert name in available(kind)
    cls = driver_class(kind, name)
    made = TypeAdapter(cls.Options).validate_python(options)
    make(kind, name, made).close()
    assert dataclasses.is_dataclass(made)
    with pytest.raises(dataclasses.FrozenInstanceError):
        made.port = "q"
    with pytest.raises(ValidationError, match=r"unexpected_keyword_argument|extra_forbidden"):
        TypeAdapter(cls.Options).validate_python(options | {"colour": "red"})


@pytest.mark.parametrize(
    ("kind", "name", "options"),
    [
        ("trolley", "grbl", {"port": "p", "length_m": -1.0}),
        ("trolley", "grbl", {"port": "p", "length_m": float("inf")}),
        ("trolley", "grbl", {"port": "p", "length_m": 3.0, "direction": 2}),
        ("trolley", "grbl", {"port": "p", "length_m": 3.0, "axis": "W"}),
        ("trolley", "grbl", {"port": "p", "length_m": 3.0, "feed_m_s": 0.0}),
        ("trolley", "by_hand", {"length_m": 0.0}),
        ("polarizer", "ell14", {"port": "p", "address": "G"}),
        ("polarizer", "ell14", {"port": "p", "offset_deg": float("nan")}),
        ("polarizer", "by_hand", {"sd_deg": 0.0}),
        ("switches", "dowkey_ms", {"port": "p", "settle_s": 1.0}),
        ("switches", "dowkey_ms", {"port": "p", "first": "both"}),
        ("switches", "dowkey_ms", {"port": "p", "h_position": 0}),
        ("switches", "numato_relay", {"port": "p", "receive_v_relay": 32}),
        ("switches", "minicircuits_rc", {"host": "h", "wear_limit_cycles": 0}),
        ("trolley", "zaber", {"port": "p", "length_m": 3.0, "microstep_m": 0.0}),
        ("trolley", "encoder", {"port": "p", "length_m": 3.0, "counts_per_m": 1e4, "counter_bits": 8}),
    ],
)
def test_wrong_values_are_refused_on_both_roads(kind: str, name: str, options: dict[str, Any]) -> None:
    cls = driver_class(kind, name)
    wrong = list(options)[-1]
    with pytest.raises(ValidationError) as from_file:
        TypeAdapter(cls.Options).validate_python(options)
    assert [error["loc"] for error in from_file.value.errors()] == [(wrong,)]
    with pytest.raises(ValueError, match=rf"{wrong}: found .*, allowed: "):
        make(kind, name, cls.Options(**options))
