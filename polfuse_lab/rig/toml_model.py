"""Read a TOML file into a pydantic model; answer each mistake with file, line, field, found and allowed."""

from __future__ import annotations

import difflib
import re
import tomllib
import types
from pathlib import Path
from typing import Any, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, ValidationError

from polfuse_lab.errors import PolfuseError

Model = TypeVar("Model", bound=BaseModel)
Location = tuple[int | str, ...]


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
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
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
    return parse_model(text, model, path)


def parse_model(text: str, model: type[Model], path: Path | str) -> Model:
    """Parse TOML ``text`` into ``model``; ``path`` is used in messages only. Raises as :func:`read_model`."""
    path = Path(path)
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise PolfuseError(f"is not valid TOML: {error}", where=str(path), advice="correct that line") from error
    try:
        return model.model_validate(content)
    except ValidationError as error:
        raise FileMistake(path, [_sentence(text, model, item) for item in error.errors()]) from None


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
    return f"{place}: found {item['input']!r}, allowed: {_allowed(item)}"


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
