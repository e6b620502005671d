"""Arrays that a function is called with belong to its caller: it counts no references to them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from numba.core import ir, types
from numba.core.lowering import Lower

from ndtorch.kernels.asked_once import replaced


@contextmanager
def borrowed() -> Iterator[None]:
    """What is compiled meanwhile does so. Whoever enters holds Numba's lock.

    Numba has every function count one reference more to each of its arguments when it begins, and one less when it
    has last used it, although whoever calls it holds on to them until it returns.
    """
    with ExitStack() as changed:
        changed.enter_context(replaced(Lower, "lower_assign", Usual.taken))
        changed.enter_context(replaced(Lower, "delvar", Usual.left))
        yield


class Usual:
    """What Numba does, and what takes its place."""

    assign: Any = Lower.lower_assign
    forget: Any = Lower.delvar

    @staticmethod
    def taken(lower: Any, kind: Any, statement: Any) -> Any:
        """Takes the place of `Lower.lower_assign`."""
        given, name = statement.value, statement.target.name
        if not isinstance(given, ir.Arg) or not once(lower, name):
            return Usual.assign(lower, kind, statement)
        of = lower.typeof(f"arg.{given.name}")
        if isinstance(of, types.Omitted):
            return Usual.assign(lower, kind, statement)
        lower.__dict__.setdefault("borrowed", set()).add(name)
        return lower.context.cast(lower.builder, lower.fnargs[given.index], of, kind)

    @staticmethod
    def left(lower: Any, name: str) -> None:
        """Takes the place of `Lower.delvar`."""
        if name not in lower.__dict__.get("borrowed", ()):
            Usual.forget(lower, name)


def once(lower: Any, name: str) -> bool:
    """Whether a variable is given something in one place only, so that it stays the argument."""
    if "given" not in lower.__dict__:
        blocks = lower.blocks.values()
        lower.given = Counter(inst.target.name for block in blocks for inst in block.find_insts(ir.Assign))
    found: bool = lower.given[name] == 1
    return found
