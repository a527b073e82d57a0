"""Parts of a kernel with machine code of their own: the kernel calls them by their address.

A kernel is compiled as a whole, on one core, with all that it might need. Its stages are compiled side by side, and
only those that a picture needs. Whoever calls the kernel asks for the addresses (:meth:`Stage.address`), which has
missing stages compiled or waited for as any kernel, and hands them over; inside, :func:`run` jumps there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba.core import cgutils, types
from numba.extending import intrinsic

from torchrender.kernels.compile import Kernel, options_of
from torchrender.kernels.libraries import OWN_CODE


class Stage(Kernel):
    """A function of kernels' arguments that returns nothing and makes no arrays, and that kernels alone call."""

    def __init__(self, py_func: Any, need: str | None) -> None:
        OWN_CODE.add(py_func)
        super().__init__(py_func, None, options_of(counted=False) | {"no_cpython_wrapper": True})
        self._seen = True  # asked for from Python: told about, kept and waited for like what Python calls
        self.need = need
        self._addresses: dict[Any, int] = {}

    def address(self, *kinds: Any) -> int:
        """Where the code for arguments of these types is; it stays there."""
        found = self._addresses.get(kinds)
        if found is None:
            if kinds not in self.overloads:
                self.compile(kinds)
            made = self.overloads[kinds]
            found = int(made.library.get_pointer_to_function(made.fndesc.llvm_func_name))
            self._addresses[kinds] = found
        return found


def stage(need: str | None = None) -> Callable[[Callable[..., Any]], Stage]:
    """Decorator for a stage.

    Args:
        need: what only some scenes have and this stage is for, such as "rectangles"; None: every picture runs it.
    """
    return lambda function: Stage(function, need)


@intrinsic
def run(typingctx, address, arguments):  # noqa: ARG001
    """Call the stage at an address with a tuple of arguments, of exactly the types that the address was made for."""
    kinds = tuple(types.unliteral(one) for one in arguments.types)

    def generate(context, builder, sig, args):
        values = [
            context.cast(builder, builder.extract_value(args[1], number), given, kind)
            for number, (given, kind) in enumerate(zip(sig.args[1].types, kinds))
        ]
        kind = context.call_conv.get_function_type(types.none, kinds)
        code = builder.inttoptr(args[0], kind.as_pointer())
        status, _ = context.call_conv.call_function(builder, code, types.none, kinds, values)
        with cgutils.if_unlikely(builder, status.is_error):
            context.call_conv.return_status_propagate(builder, status)
        return context.get_dummy_value()

    return types.none(address, arguments), generate
