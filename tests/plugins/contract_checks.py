"""What every driver must be, whoever wrote it: its contract's methods, and options that say what they are."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import itertools
import re
import textwrap
import typing
from types import UnionType
from typing import Any

from drivers import contracts

CONTRACTS: dict[str, type[Any]] = {
    "switches": contracts.Switches,
    "radar": contracts.Radar,
    "trolley": contracts.Trolley,
    "polarizer": contracts.Polarizer,
    "camera": contracts.Camera,
}

UNITS = re.compile(
    r"_(m|s|hz|deg|rad|db|m_s|per_m|px|counts|percent|ratio|ppm|c)$|_per_count$"
    # Values that are pure numbers, named as the field names them.
    r"|^gain$"
)


def members(contract: type[Any]) -> dict[str, Any]:
    """Public methods and properties that a contract asks for, its base's included."""
    found: dict[str, Any] = {}
    for base in reversed(contract.__mro__):
        if base.__module__ == contracts.__name__:
            found |= {name: item for name, item in vars(base).items() if not name.startswith("_")}
    return found


def faults_of_class(cls: type[Any], kind: str) -> list[str]:
    """Where a driver's class falls short of its contract, in words."""
    faults = []
    if not (cls.__doc__ or "").strip():
        faults.append("the class has no docstring")
    parameters = list(inspect.signature(cls).parameters)
    if parameters not in (["options"], ["options", "operator"]):
        faults.append(f"is constructed with {parameters}, not with options (and operator)")
    for name, wanted in members(CONTRACTS[kind]).items():
        found = inspect.getattr_static(cls, name, None)
        if found is None:
            faults.append(f"has no {name}")
        elif isinstance(wanted, property):
            if inspect.isfunction(found):
                faults.append(f"{name} is a method, not a property")
            elif isinstance(found, property) and not found.__doc__:
                faults.append(f"{name} has no docstring")
        else:
            faults += _faults_of_method(name, found, wanted)
    return faults


def _faults_of_method(name: str, found: Any, wanted: Any) -> list[str]:
    if not inspect.isfunction(found):
        return [f"{name} is no method"]
    faults = [] if (found.__doc__ or "").strip() else [f"{name} has no docstring"]
    theirs, ours = (list(inspect.signature(each).parameters.values()) for each in (found, wanted))
    more = [one for one in theirs[len(ours) :] if one.default is one.empty]
    if [one.name for one in theirs[: len(ours)]] != [one.name for one in ours] or more:
        faults.append(f"{name} takes {[one.name for one in theirs]}, the contract {[one.name for one in ours]}")
    return faults


def faults_of_options(options: type[Any]) -> list[str]:
    """Where a driver's options fall short, in words."""
    if not dataclasses.is_dataclass(options):
        return ["Options is no dataclass"]
    faults = []
    if not options.__dataclass_params__.frozen:  # type: ignore[attr-defined]
        faults.append("Options can be changed (frozen=True is missing)")
    if getattr(options, "__pydantic_config__", {}).get("extra") != "forbid":
        faults.append("Options take unknown names (__pydantic_config__ without extra = 'forbid')")
    documented = docstrings(options)
    hints = typing.get_type_hints(options)
    for field in dataclasses.fields(options):
        if not documented.get(field.name):
            faults.append(f"option {field.name} has no docstring")
        kinds = typing.get_args(hints[field.name]) if _is_union(hints[field.name]) else (hints[field.name],)
        if float in kinds and not UNITS.search(field.name):
            faults.append(f"option {field.name} is a float without a unit in its name")
    return faults


def docstrings(options: type[Any]) -> dict[str, str]:
    """The string below each field, of the class and of those that it is derived from."""
    found: dict[str, str] = {}
    for base in reversed(options.__mro__[:-1]):
        body = typing.cast(ast.ClassDef, ast.parse(textwrap.dedent(inspect.getsource(base))).body[0]).body
        for field, text in itertools.pairwise(body):
            if (
                isinstance(field, ast.AnnAssign)
                and isinstance(field.target, ast.Name)
                and isinstance(text, ast.Expr)
                and isinstance(text.value, ast.Constant)
                and isinstance(text.value.value, str)
            ):
                found[field.target.id] = text.value.value.strip()
    return found


def _is_union(hint: Any) -> bool:
    return typing.get_origin(hint) in (typing.Union, UnionType)


_EXAMPLES = {"host": "127.0.0.1", "url": "tcp://127.0.0.1:9?token=0"}


def smallest_options(options: type[Any]) -> Any:
    """Options with a plausible value for each field that has no default."""
    hints = typing.get_type_hints(options)
    values: dict[str, Any] = {}
    for field in dataclasses.fields(options):
        if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
            hint = hints[field.name]
            values[field.name] = _EXAMPLES.get(field.name) or {str: "nowhere", int: 64, float: 1e-3}.get(hint, hint)
    return options(**values)
