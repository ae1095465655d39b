"""A node map that behaves like GenApi's, for tests of feature handling."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

READ_WRITE, READ_ONLY = 4, 3


@dataclass
class Node:
    value: Any
    min: Any = None
    max: Any = None
    inc: int = 1
    symbolics: tuple[str, ...] = ()
    mode: int = READ_WRITE
    executed: int = 0
    on_execute: Callable[[], None] | None = None

    def get_access_mode(self) -> int:
        return self.mode

    def execute(self) -> None:
        self.executed += 1
        if self.on_execute is not None:
            self.on_execute()


@dataclass
class NodeMap:
    nodes: dict[str, Node] = field(default_factory=dict)

    def has_node(self, name: str) -> bool:
        return name in self.nodes

    def get_node(self, name: str) -> Node:
        return self.nodes[name]
