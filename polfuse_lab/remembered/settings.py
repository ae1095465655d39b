"""Settings of the user: plain values by name, kept from one start of the program to the next."""

from __future__ import annotations

import json
from typing import Any

from polfuse_lab.remembered import store

FILE = "settings.json"
VERSION = 1


class Settings:
    """Values by name, such as ``"theme"`` or ``"collect.plan"``. Use :meth:`load`; thread-safe."""

    def __init__(self, values: dict[str, Any] | None = None, warning: str = "") -> None:
        self._values = dict(values or {})
        self.warning = warning
        """What is wrong with the stored settings, one sentence; empty when all is well."""

    @classmethod
    def load(cls) -> Settings:
        """The stored settings; none, with a warning, where the file is damaged or from a newer version."""
        with store.lock:
            content, warning = store.read(FILE, VERSION)
        values = content.get("values", {})
        if not isinstance(values, dict):
            return cls({}, f"{FILE} holds no values: defaults are used")
        return cls(values, warning)

    def get(self, key: str, default: Any = None) -> Any:
        """A value; the default where there is none, or one of another type than the default's."""
        value = self._values.get(key, default)
        if default is None or type(value) is type(default):
            return value
        if isinstance(default, float) and type(value) is int:
            return float(value)
        return default

    def set(self, key: str, value: Any) -> None:
        """Change a value; None forgets it. Raises TypeError for what JSON cannot hold."""
        json.dumps(value, allow_nan=False)
        with store.lock:
            if value is None:
                self._values.pop(key, None)
            else:
                self._values[key] = value

    def save(self) -> None:
        """Store all values, crash-safe. Never raises: :attr:`warning` tells."""
        with store.lock:
            self.warning = store.write(FILE, VERSION, {"values": self._values})
