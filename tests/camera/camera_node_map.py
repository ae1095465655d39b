"""A node map that behaves like GenApi's, for tests of feature handling."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

READ_WRITE, READ_ONLY = 4, 3

PFNC = {
    "Mono8": 0x01080001,
    "Mono10p": 0x010A0046,
    "Mono12": 0x01100005,
    "Mono12p": 0x010C0047,
    "Mono12Packed": 0x010C0006,
    "Mono16": 0x01100007,
    "Polarized8": 0x8108FFFF,
}
"""Codes of pixel formats (PFNC 2.4; that of Polarized8 stands for a vendor's own)."""


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

    def get_value(self, verify: bool = False, ignore_cache: bool = False) -> Any:
        return self.value

    def get_int_value(self) -> int:
        return PFNC[self.value]

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
