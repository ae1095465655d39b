"""Setting up compiles every kernel, so that the first picture does not wait."""

from __future__ import annotations

import dis
import importlib
import inspect
import pkgutil
import sys
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

from numba.core.caching import NullCache
from numba.core.dispatcher import Dispatcher

import processing
from polfuse_lab.warm_up import warm_up

ROOT = Path(__file__).parents[2]


def walked() -> list[Any]:
    """All modules of the package that has the kernels."""
    names = [found.name for found in pkgutil.walk_packages(processing.__path__, "processing.")]
    return [importlib.import_module(name) for name in names]


def name_of(kernel: Any) -> str:
    return f"{kernel.py_func.__module__}.{kernel.py_func.__name__}"


def kernels(modules: list[Any]) -> dict[str, Any]:
    found = {}
    for module in modules:
        for thing in vars(module).values():
            if isinstance(thing, Dispatcher):
                found[name_of(thing)] = thing
    return found


def codes(code: CodeType) -> Iterator[CodeType]:
    """The code and all that is defined within it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from codes(constant)


def mentioned(function: FunctionType) -> list[Any]:
    """Kernels that a function mentions: global, from around it, or imported within it."""
    around = inspect.getclosurevars(function)
    found = [*around.globals.values(), *around.nonlocals.values()]
    for code in codes(function.__code__):
        found += [function.__globals__.get(name) for name in code.co_names]
        module = ""
        for step in dis.get_instructions(code):
            if step.opname == "IMPORT_NAME":
                module = step.argval
            elif step.opname == "IMPORT_FROM" and module in sys.modules:
                found.append(getattr(sys.modules[module], step.argval, None))
    return [thing for thing in found if isinstance(thing, Dispatcher)]


def plain_functions(modules: list[Any]) -> Iterator[FunctionType]:
    for module in modules:
        for thing in vars(module).values():
            members = vars(thing).values() if inspect.isclass(thing) else [thing]
            for member in members:
                if isinstance(member, Dispatcher):
                    continue
                function = inspect.unwrap(getattr(member, "__func__", member)) if callable(member) else None
                if isinstance(function, FunctionType) and function.__module__ == module.__name__:
                    yield function


def test_every_kernel_is_compiled() -> None:
    modules = walked()
    found = kernels(modules)
    assert len(found) > 100
    warm_up()
    kept = {name for name, kernel in found.items() if not isinstance(kernel._cache, NullCache)}
    called = {name_of(kernel): kernel for f in plain_functions(modules) for kernel in mentioned(f)}
    assert len(called) > 20
    # What Python calls has run itself; what kernels call in turn has no signature when it comes from the cache.
    assert [name for name, kernel in called.items() if name in kept and not kernel.signatures] == []
    reached: set[str] = set()
    ahead = [kernel for kernel in found.values() if kernel.signatures]
    while ahead:
        kernel = ahead.pop()
        if name_of(kernel) not in reached:
            reached.add(name_of(kernel))
            ahead += mentioned(kernel.py_func)
    assert sorted(kept - reached) == []


def test_kernels_live_in_one_package() -> None:
    # The walk above would not see others.
    packages = [ROOT / name for name in ("drivers", "gui", "hw_mocks", "polfuse_lab")]
    elsewhere = [path for package in packages for path in package.rglob("*.py") if "njit" in path.read_text("utf-8")]
    assert elsewhere == []
