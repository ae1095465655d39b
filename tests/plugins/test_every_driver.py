"""One test that walks every installed driver of every kind against its contract; and tests of that walk itself."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest
from contract_checks import CONTRACTS, docstrings, faults_of_class, faults_of_options, members, smallest_options
from pydantic import TypeAdapter, ValidationError

from drivers.errors import DeviceError
from drivers.records import Channel
from drivers.registry import KINDS, available, driver_class

EVERY = [(kind, name) for kind in KINDS for name in available(kind)]
ON_A_LINE = [pair for pair in EVERY if pair[0] in ("switches", "trolley", "polarizer") and pair[1] != "by_hand"]
OWN = {
    "switches": {"dowkey_ms", "minicircuits_rc", "numato_relay"},
    "radar": {"scene", "sounddevice"},
    "trolley": {"by_hand", "encoder", "grbl", "zaber"},
    "polarizer": {"by_hand", "ell14"},
    "camera": {"harvesters", "scene"},
}
CALLS: dict[str, list[Callable[[Any], Any]]] = {
    "switches": [lambda d: d.state(), lambda d: d.select(Channel.HV)],
    "radar": [lambda d: d.begin(100), lambda d: d.poll(), lambda d: d.level(), lambda d: d.clock()],
    "trolley": [lambda d: d.poll(), lambda d: d.start_move(0.0), lambda d: d.stop(), lambda d: d.start_move(math.nan)],
    "polarizer": [lambda d: d.poll(), lambda d: d.start_turn(0.0), lambda d: d.stop()],
    "camera": [lambda d: d.trigger(), lambda d: d.poll(), lambda d: d.clock()],
}


class NoOperator:
    def ask(self, prompt: str) -> int:
        return 1

    def answered(self, ticket: int) -> bool:
        return False

    def withdraw(self, ticket: int) -> None:
        pass


def make(kind: str, name: str) -> Any:
    cls = driver_class(kind, name)
    options = smallest_options(cls.Options)
    return cls(options, NoOperator()) if name in ("by_hand", "encoder") else cls(options)


def test_all_of_our_drivers_are_installed() -> None:
    assert {kind: set(available(kind)) & OWN[kind] for kind in KINDS} == OWN


@pytest.mark.parametrize(("kind", "name"), EVERY)
def test_every_driver_keeps_its_contract(kind: str, name: str) -> None:
    cls = driver_class(kind, name)
    assert faults_of_class(cls, kind) == []
    assert faults_of_options(cls.Options) == []


@pytest.mark.parametrize(("kind", "name"), EVERY)
def test_every_driver_refuses_unknown_options(kind: str, name: str) -> None:
    cls = driver_class(kind, name)
    with pytest.raises(ValidationError, match=r"unexpected_keyword_argument|extra_forbidden"):
        TypeAdapter(cls.Options).validate_python({"colour_of_the_cable": "red"})


@pytest.mark.parametrize(("kind", "name"), EVERY)
def test_a_device_that_was_never_opened_fails_in_words(kind: str, name: str) -> None:
    """Whatever is asked of it: an answer or a DeviceError; safe state and close never raise, and again."""
    device = make(kind, name)
    said: list[DeviceError] = []
    for call in CALLS[kind]:
        try:
            call(device)
        except DeviceError as error:
            said.append(error)
    assert all(error.what and error.where and error.advice for error in said)
    assert said or name == "by_hand"
    for _ in range(2):
        device.make_safe()
        device.close()


@pytest.mark.parametrize(("kind", "name"), ON_A_LINE)
def test_opening_nothing_fails_in_one_sentence(kind: str, name: str) -> None:
    device = make(kind, name)
    with pytest.raises(DeviceError) as caught:
        device.open()
    said = str(caught.value)
    assert "\n" not in said
    assert "Traceback" not in said
    device.close()


# The walk itself finds what it is for.


class Sloppy:
    @dataclass
    class Options:
        speed: float = 1.0
        limit_m: float | None = None
        """Where it ends, m."""

    def __init__(self, options: Options, colour: str) -> None: ...

    def open(self): ...

    def select(self, where):
        """Go there."""


def test_the_walk_finds_what_is_wrong() -> None:
    assert faults_of_class(Sloppy, "switches") == [
        "the class has no docstring",
        "is constructed with ['options', 'colour'], not with options (and operator)",
        "open has no docstring",
        "has no make_safe",
        "has no close",
        "select takes ['self', 'where'], the contract ['self', 'channel']",
        "has no state",
    ]
    assert faults_of_options(Sloppy.Options) == [
        "Options can be changed (frozen=True is missing)",
        "Options take unknown names (__pydantic_config__ without extra = 'forbid')",
        "option speed has no docstring",
        "option speed is a float without a unit in its name",
    ]
    assert docstrings(Sloppy.Options) == {"limit_m": "Where it ends, m."}
    assert faults_of_options(Sloppy) == ["Options is no dataclass"]


def test_the_walk_knows_the_whole_contract() -> None:
    assert set(members(CONTRACTS["trolley"])) == {
        "open", "make_safe", "close", "limits_m", "start_move", "poll", "stop"}  # fmt: skip
    assert set(CONTRACTS) == set(KINDS)
