"""Decorators of kernels, as type checkers should see them: they skip a kernel as a whole, because its arguments are
records, which contain more than the messages that they name.

kernel       compile a function (`compiler.kernel.kernel`); a division by 0 raises
ieee_kernel  the same; a division by 0 returns inf or nan, as IEEE 754 defines it
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from typing import no_type_check as ieee_kernel
    from typing import no_type_check as kernel
else:
    from palpate.compiler.kernel import ieee_kernel, kernel

__all__ = ["ieee_kernel", "kernel"]
