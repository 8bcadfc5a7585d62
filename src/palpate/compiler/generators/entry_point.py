"""Generated code of `compiler.entry_point`."""

from collections.abc import Callable
from typing import Any

from numba import types
from numba.core import cgutils


def called(signature: Callable[[], Any]) -> Callable[..., Any]:
    """The generator for calls of functions of this signature, in numba's convention. An exception of the function is
    that of the kernel."""
    form = signature()

    def call(typing: Any, address: Any, *given: Any) -> Any:
        result, expected = form.return_type, form.args
        if len(given) != len(expected):
            return None  # numba reports the call

        def generate(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
            convention = context.call_conv
            place, given = arguments[0], cgutils.unpack_tuple(builder, arguments[1], len(expected))
            code = convention.get_function_type(result, expected).as_pointer()
            status, value = convention.call_function(builder, builder.inttoptr(place, code), result, expected, given)
            with cgutils.if_unlikely(builder, status.is_error):
                convention.return_status_propagate(builder, status)
            return value

        return result(types.int64, types.StarArgTuple(expected)), generate

    return call
