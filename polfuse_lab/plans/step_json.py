"""Steps as plain JSON values, and back: how a session and a custom plan keep them."""

from __future__ import annotations

import dataclasses
import difflib
import json
import math
import re
import types
from collections.abc import Iterable, Mapping
from typing import Any, get_args, get_type_hints

from drivers.records import Channel
from polfuse_lab.plans.steps import Step

_CLASSES: Mapping[str, type[Any]] = {
    re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).lower(): cls for cls in get_args(Step)
}
_NAMES = {cls: name for name, cls in _CLASSES.items()}
_FIELDS: Mapping[type[Any], Mapping[str, Any]] = {cls: get_type_hints(cls) for cls in _NAMES}


def step_to_plain(step: Step) -> dict[str, Any]:
    """A step as a JSON object: ``{"step": "move_to", "x_m": 0.1, "position": 0}``. Channels go by their names."""
    fields = {field.name: getattr(step, field.name) for field in dataclasses.fields(step)}
    plain = {name: value.name if isinstance(value, Channel) else value for name, value in fields.items()}
    return {"step": _NAMES[type(step)]} | {
        name: list(value) if isinstance(value, tuple) else value for name, value in plain.items()
    }


def step_from_plain(values: object) -> Step:
    """A step from its JSON object; fields with a default may be left out.

    Raises:
        ValueError: it is no step; says what was found and what is allowed.
    """
    if not isinstance(values, dict):
        raise ValueError(f"found {_short(values)}, allowed: an object such as {{'step': 'move_to', 'x_m': 0.0, …}}")
    name = values.get("step")
    cls = _CLASSES.get(name) if isinstance(name, str) else None
    if cls is None:
        close = difflib.get_close_matches(str(name), _CLASSES, n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        raise ValueError(f"step: found {_short(name)}{hint}, allowed: {', '.join(_CLASSES)}")
    fields = _FIELDS[cls]
    if unknown := [key for key in values if key != "step" and key not in fields]:
        raise ValueError(f"{name}: found a key {unknown[0]!r} that is not known, allowed: {', '.join(fields)}")
    missing = [
        field.name
        for field in dataclasses.fields(cls)
        if field.default is dataclasses.MISSING and field.name not in values
    ]
    if missing:
        raise ValueError(f"{name}: {missing[0]} is missing")
    found = {key: _value(value, fields[key], f"{name}.{key}") for key, value in values.items() if key != "step"}
    step: Step = cls(**found)
    return step


def steps_to_plain(steps: Iterable[Step]) -> list[dict[str, Any]]:
    """Steps as a list of JSON objects."""
    return [step_to_plain(step) for step in steps]


def steps_from_plain(values: object) -> tuple[Step, ...]:
    """Steps from a list of JSON objects. Raises :class:`ValueError` with the number of the step that is wrong."""
    if not isinstance(values, list):
        raise ValueError(f"found {_short(values)}, allowed: a list of steps")
    steps = []
    for number, item in enumerate(values, start=1):
        try:
            steps.append(step_from_plain(item))
        except ValueError as error:
            raise ValueError(f"step {number}: {error}") from None
    return tuple(steps)


def steps_to_json(steps: Iterable[Step]) -> str:
    """Steps as JSON text, one step in each line. Raises :class:`ValueError` for a number that is not finite."""
    lines = [json.dumps(step, ensure_ascii=False, allow_nan=False) for step in steps_to_plain(steps)]
    return "[\n" + ",\n".join(lines) + "\n]\n"


def steps_from_json(text: str) -> tuple[Step, ...]:
    """Steps from JSON text. Raises :class:`ValueError` with the line or the number of the step that is wrong."""
    try:
        values = json.loads(text)
    except json.JSONDecodeError as error:
        raise ValueError(f"is not JSON: {error.msg} (its line {error.lineno}, column {error.colno})") from None
    except RecursionError:
        raise ValueError("is not a list of steps: it is nested too deeply") from None
    return steps_from_plain(values)


def _value(value: object, hint: Any, where: str) -> Any:
    """One field's value as its type says."""
    if isinstance(hint, types.UnionType):
        if value is None:
            return None
        hint = next(arm for arm in get_args(hint) if arm is not type(None))
    if hint is Channel and isinstance(value, str) and value in Channel.__members__:
        return Channel[value]
    if hint is float and isinstance(value, (int, float)) and not isinstance(value, bool) and _finite(value):
        return float(value)
    if hint is int and isinstance(value, int) and not isinstance(value, bool) and abs(value) < 2**31:
        return value
    if hint in (bool, str) and isinstance(value, hint):
        return value
    if get_args(hint) and isinstance(value, list):
        return tuple(_value(item, get_args(hint)[0], where) for item in value)
    allowed = {
        Channel: ", ".join(Channel.__members__),
        float: "a finite number",
        int: "an integer below 2^31",
        bool: "true or false",
        str: "text",
    }
    raise ValueError(f"{where}: found {_short(value)}, allowed: {allowed.get(hint, 'a list of finite numbers')}")


def _finite(value: float) -> bool:
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}…"
