"""Read a TOML file into a pydantic model, and write one; answer a mistake with file, line, field, found and allowed."""

from __future__ import annotations

import difflib
import json
import re
import tomllib
import types
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, ValidationError

from polfuse_lab.errors import PolfuseError

Model = TypeVar("Model", bound=BaseModel)
Location = tuple[int | str, ...]

SHOWN = 200
"""Longest wrong value that a message quotes whole, characters."""


class FileModel(BaseModel):
    """Base of everything that users write: unknown keys are errors, values are frozen, numbers must be finite."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=True, validate_default=True
    )


class FileMistake(PolfuseError):
    """One or more wrong entries in a file; ``mistakes`` holds a sentence for each."""

    def __init__(self, path: Path, mistakes: list[str]) -> None:
        super().__init__("; ".join(mistakes), where=str(path), advice="correct the file and try again")
        self.mistakes = mistakes


def read_model(path: Path | str, model: type[Model]) -> Model:
    """Read ``path`` into ``model``.

    Raises:
        PolfuseError: the file cannot be read, or is not TOML (with its line).
        FileMistake: entries are wrong (each with line, field, found, allowed).
    """
    return parse_model(read_text(path), model, path)


def read_text(path: Path | str) -> str:
    """The text of a file that a user wrote. Raises :class:`PolfuseError` where it cannot be read."""
    path = Path(path)
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise PolfuseError(
            f"cannot be read ({error.strerror})",
            where=str(path),
            advice="check the name, or write one with 'polfuse init'",
        ) from error
    except UnicodeDecodeError as error:
        raise PolfuseError(
            f"is not UTF-8 text (byte {error.start})", where=str(path), advice="save it as UTF-8"
        ) from error


def parse_model(text: str, model: type[Model], path: Path | str) -> Model:
    """Parse TOML ``text`` into ``model``; ``path`` is used in messages only. Raises as :func:`read_model`."""
    return _validated(text, _content(text, Path(path)), model, Path(path))


def parse_kind(text: str, models: Mapping[str, type[Model]], default: str, path: Path | str) -> Model:
    """Parse TOML ``text`` into the model that its ``kind`` names, ``default`` where it names none.

    Raises as :func:`read_model`.
    """
    content = _content(text, Path(path))
    kind = content.get("kind", default)
    model = models.get(kind) if isinstance(kind, str) else None
    if model is None:
        line = line_of(text, ("kind",))
        close = difflib.get_close_matches(str(kind), models, n=1)
        hint = f" (did you mean '{close[0]}'?)" if close else ""
        raise FileMistake(
            Path(path),
            [f"{f'line {line}, ' if line else ''}kind: found {_short(kind)}{hint}, allowed: {', '.join(models)}"],
        )
    return _validated(text, content, model, Path(path))


def model_to_toml(model: BaseModel, without: tuple[str, ...] = ()) -> str:
    """TOML text that is read as ``model``; what has its default, and the keys ``without``, are left out."""
    return _toml_tables(model, (), without)


def _toml_tables(model: BaseModel, table: tuple[str, ...], without: tuple[str, ...]) -> str:
    lines: list[str] = []
    inner: list[str] = []
    for name, field in type(model).model_fields.items():
        value = getattr(model, name)
        if name in without or (not field.is_required() and value == field.get_default(call_default_factory=True)):
            continue
        path = (*table, name)
        if isinstance(value, BaseModel):
            inner.append(f"[{'.'.join(path)}]\n{_toml_tables(value, path, ())}")
        elif isinstance(value, tuple) and value and isinstance(value[0], BaseModel):
            inner += [f"[[{'.'.join(path)}]]\n{_toml_tables(item, path, ())}" for item in value]
        else:
            lines.append(f"{name} = {toml_value(value)}\n")
    return "".join(lines) + "".join(inner)


def toml_value(value: object) -> str:
    """A string, number, boolean, list or table as TOML writes it on one line (long strings on several)."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (tuple, list)):
        return f"[{', '.join(map(toml_value, value))}]"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{toml_value(key)} = {toml_value(item)}" for key, item in value.items()) + "}"
    if isinstance(value, str):
        if "\n" in value and "'''" not in value + "'" and all(c.isprintable() or c == "\n" for c in value):
            return f"'''\n{value}'''"
        # A JSON string is a TOML one, but for DEL, which JSON leaves as it is.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(value)


def _content(text: str, path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise PolfuseError(f"is not valid TOML: {error}", where=str(path), advice="correct that line") from error


def _validated(text: str, content: dict[str, Any], model: type[Model], path: Path) -> Model:
    try:
        return model.model_validate(content)
    except ValidationError as error:
        items = error.errors()
        # A list whose items are all wrong is not too short as well.
        wrong = {item["loc"][:depth] for item in items for depth in range(len(item["loc"]))}
        told = [item for item in items if item["type"] != "too_short" or item["loc"] not in wrong]
        raise FileMistake(path, [_sentence(text, model, item) for item in told]) from None


def _short(value: object) -> str:
    shown = repr(value)
    return shown if len(shown) <= SHOWN else f"{shown[: SHOWN - 1]}…"


def _sentence(text: str, model: type[BaseModel], item: Any) -> str:
    location: Location = item["loc"]
    field = ".".join(str(part) for part in location) or "(the file)"
    line = line_of(text, location)
    place = f"line {line}, {field}" if line else field
    if item["type"] == "extra_forbidden":
        known = _known_keys(model, location[:-1])
        close = difflib.get_close_matches(str(location[-1]), known, n=1)
        hint = f" (did you mean '{close[0]}'?)" if close else ""
        return f"{place}: found a key that is not known{hint}, allowed: {', '.join(known)}"
    if item["type"] == "missing":
        return f"{place}: found nothing, allowed: {_describe(model, location)}"
    return f"{place}: found {_short(item['input'])}, allowed: {_allowed(item)}"


def _allowed(item: Any) -> str:
    message = str(item["msg"])
    message = re.sub(r"^(Input should be|Value error,)\s*", "", message)
    return message[:1].lower() + message[1:]


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    if get_origin(annotation) in (list, tuple, Union, types.UnionType) or get_args(annotation):
        return [found for inner in get_args(annotation) for found in _models_in(inner)]
    return []


def _walk(model: type[BaseModel], location: Location) -> list[type[BaseModel]]:
    models = [model]
    for part in location:
        if isinstance(part, int):
            continue
        inner = [
            found for m in models if part in m.model_fields for found in _models_in(m.model_fields[part].annotation)
        ]
        # A discriminator's tag stands in the location too, without being a field.
        models = inner or models
    return models


def _known_keys(model: type[BaseModel], location: Location) -> list[str]:
    models = _walk(model, location)
    tags = {str(part) for part in location}
    tagged = [m for m in models if tags & {str(getattr(f, "default", "")) for f in m.model_fields.values()}]
    return sorted({name for m in (tagged or models) for name in m.model_fields})


def _describe(model: type[BaseModel], location: Location) -> str:
    for owner in _walk(model, location[:-1]):
        field = owner.model_fields.get(str(location[-1]))
        if field is not None and field.description:
            return field.description.split("\n")[0]
    return "a value"


def line_of(text: str, location: Location) -> int | None:
    """Line (from 1) on which a TOML location is written; of its nearest table where the key itself is missing."""
    names = [part for part in location if isinstance(part, str)]
    best: tuple[int, int] | None = None
    table: list[str] = []
    seen: dict[str, int] = {}
    index = {".".join(names[: i + 1]): location[j + 1] for i, j in _indices(location)}
    for number, raw in enumerate(text.splitlines(), start=1):
        stripped = raw.strip()
        header = re.match(r"^\[(\[)?\s*([^\[\]]+?)\s*\]?\]", stripped)
        if header and not re.match(r"^[\w\"'.-]+\s*=", stripped):
            table = [part.strip().strip("\"'") for part in header.group(2).split(".")]
            if header.group(1):
                key = ".".join(table)
                seen[key] = seen.get(key, -1) + 1
            path = table
        else:
            assignment = re.match(r"^([A-Za-z0-9_\-\"'. ]+?)\s*=", stripped)
            if not assignment:
                continue
            path = table + [part.strip().strip("\"'") for part in assignment.group(1).split(".")]
        depth = _shared(names, path)
        right_item = all(seen.get(key, want) == want for key, want in index.items())
        if depth and right_item and depth == len(path) and (best is None or depth > best[0]):
            best = (depth, number)
    return best[1] if best else None


def _indices(location: Location) -> list[tuple[int, int]]:
    pairs = []
    name = -1
    for j, part in enumerate(location):
        if isinstance(part, str):
            name += 1
            if j + 1 < len(location) and isinstance(location[j + 1], int):
                pairs.append((name, j))
    return pairs


def _shared(names: list[str], path: list[str]) -> int:
    """How much of ``path`` is found in order in ``names`` (a discriminator's tag may stand between)."""
    position = 0
    for count, part in enumerate(path):
        while position < len(names) and names[position] != part:
            position += 1
        if position == len(names):
            return count if count == len(path) else 0
        position += 1
    return len(path)
