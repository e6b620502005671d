"""Compiling a kernel: what it calls is optimised once, where it ends up."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from llvmlite.binding import parse_assembly
from numba.core import codegen
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import cpu_target

from ndtorch.kernels.asked_once import asked_once
from ndtorch.kernels.borrowed import borrowed
from ndtorch.kernels.counted_plainly import counted_plainly, own, plain_counts

JITCodeLibrary: Any = codegen.JITCodeLibrary


class Part(JITCodeLibrary):  # type: ignore[misc]
    """Code of a kernel, or code that only the kernel calls: that is linked into it as it is.

    Numba would optimise every function and make machine code of it, and again of all that calls it: of the innermost
    functions four times.

    Attributes:
        whole: name of the kernel.
        later: constants of its parts, by name.
    """

    whole: str
    later: dict[str, Any]

    def _optimize_final_module(self) -> None:
        if self.name == self.whole:
            own(self._final_module)
            super()._optimize_final_module()

    def _finalize_final_module(self) -> None:
        if self.name != self.whole:
            self._finalize_dynamic_globals()
            self._finalized = True
            return
        super()._finalize_final_module()
        # Now that there is code, its parts can be told where their constants are.
        for variable in self._final_module.global_variables:
            if variable.name in self.later:
                self._codegen.set_env(variable.name, self.later.pop(variable.name))

    @property
    def codegen(self) -> Any:
        """What knows where constants are; a part that has no machine code keeps them for later."""
        return self._codegen if self.name == self.whole else self

    def set_env(self, name: str, env: Any) -> None:
        """Keep the constants of a function."""
        self.later[name] = env

    def serialize_using_object_code(self) -> Any:
        """What the cache keeps: machine code, and instead of all its source the names that are in it.

        Numba keeps the source so that other functions could contain this one. No function contains a kernel.
        """
        self._ensure_finalized()
        module = self._final_module
        names = [f'define void @"{f.name}"() {{ ret void }}' for f in module.functions if not f.is_declaration]
        names += [f'@"{v.name}" = global ptr null' for v in module.global_variables if not v.is_declaration]
        return self.name, "object", (self._get_compiled_object(), parse_assembly("\n".join(names)).as_bitcode())


@contextmanager
def optimised_once(name: str) -> Iterator[None]:
    """Everything that is compiled meanwhile is part of the kernel of this name.

    Nor does Python look for unused objects meanwhile: the compiler makes so many that this takes a tenth of the time.
    """
    lock: Any = global_compiler_lock
    with lock:
        context: Any = cpu_target.target_context
        context.refresh()
        # Made before everything is a part.
        plain_counts()
        maker = context.codegen()
        maker._library_class = type("PartOfKernel", (Part,), {"whole": name, "later": {}})
        collecting = gc.isenabled()
        gc.disable()
        try:
            with asked_once(), counted_plainly(), borrowed():
                yield
        finally:
            del maker._library_class
            if collecting:
                gc.enable()
