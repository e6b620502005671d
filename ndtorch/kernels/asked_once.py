"""What Numba works out again for every operation of a kernel is worked out once for each kind of operation."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from llvmlite.binding import ffi
from numba.core.codegen import CPUCodeLibrary
from numba.core.registry import cpu_target
from numba.core.targetconfig import ConfigStack, TargetConfig
from numba.core.types.functions import BaseFunction

top: Any = ConfigStack.top_or_none


@contextmanager
def asked_once() -> Iterator[None]:
    """Compiling takes four fifths of the time meanwhile, and gives the same code. Whoever enters holds Numba's lock."""
    lock: Any = ffi.lib._lock
    with ExitStack() as changed:
        changed.enter_context(replaced(BaseFunction, "get_call_type", Calls(BaseFunction.get_call_type).method()))
        changed.enter_context(replaced(TargetConfig, "values", values))
        changed.enter_context(replaced(CPUCodeLibrary, "_optimize_functions", simplified))
        # Nothing calls a kernel from C.
        changed.enter_context(replaced(type(cpu_target.target_context), "create_cfunc_wrapper", nothing))
        # Those told of every call of LLVM, several at once, only add up its time.
        changed.enter_context(replaced(lock, "_cblist", []))
        yield


@contextmanager
def replaced(owner: Any, name: str, meanwhile: Any) -> Iterator[None]:
    """An attribute is another one for a while."""
    before = getattr(owner, name)
    setattr(owner, name, meanwhile)
    try:
        yield
    finally:
        setattr(owner, name, before)


class Calls:
    """The types that calls were found to have, of each function with arguments of these types and under these flags.

    Numba tries one candidate after the other for every `+`, and most of them several times.
    """

    def __init__(self, usual: Any) -> None:
        self.usual = usual
        self.known: dict[Any, Any] = {}
        self.flags: list[Any] = []
        self.numbers: dict[int, tuple[int, Any]] = {}

    def method(self) -> Any:
        """What takes the place of `BaseFunction.get_call_type`."""

        def get_call_type(function: Any, context: Any, given: Any, named: Any) -> Any:
            key = (id(function), id(context), tuple(given), tuple(named.items()), self.number())
            if key not in self.known:
                found = self.usual(function, context, given, named)
                if found is None:
                    return None
                # The function is kept, so that its number stays its own.
                self.known[key] = function, found, function._impl_keys[found.args]
            _, found, implementation = self.known[key]
            function._impl_keys[found.args] = implementation
            return found

        return get_call_type

    def number(self) -> int:
        """Of the flags that hold now: equal ones have the same."""
        flags = top()
        if id(flags) not in self.numbers:
            if flags not in self.flags:
                self.flags.append(flags)
            self.numbers[id(flags)] = self.flags.index(flags), flags
        return self.numbers[id(flags)][0]


def values(self: Any) -> dict[str, Any]:
    """As `TargetConfig.values`, which asks for every option by itself."""
    return {**{name: option.default for name, option in self.options.items()}, **self._values}


def simplified(self: Any, module: Any) -> None:
    """As `CPUCodeLibrary._optimize_functions`, but for what has no body."""
    module.data_layout = self._codegen._data_layout
    for function in module.functions:
        if not function.is_declaration:
            passes, builder = self._codegen._function_pass_manager()
            with self._recorded_timings.record(f"Function passes on {function.name!r}", builder):
                passes.run(function, builder)


def nothing(*_: Any) -> None:
    """No code."""
