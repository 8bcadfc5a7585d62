"""The processors for which machine code is made from the IR of kernels: this machine's, that of other machines, and
the virtual one of browsers.

All take the same IR; only the layout of data and the instructions differ. Numbers are the same bit for bit: kernels
contain no function of the C library (`replaced.REPLACED`), and LLVM joins a product and a sum only where a kernel does
(`doubles.fused`).
"""

from typing import Any, NamedTuple

import llvmlite.binding as llvm

from palpate.compiler.arithmetic import ARM64, LEVEL


class ProcessorError(ValueError):
    """A processor without kernels."""


class Processor(NamedTuple):
    """A processor in LLVM's terms.

    triple     machine, vendor, system
    cpu        the processor whose instructions are used
    features   instructions in addition
    model      where code and data may lie: for processes that load the code (`jit`), or for a linker
    reloc      whether the code is for fixed addresses
    """

    triple: str
    cpu: str
    features: str = ""
    model: str = "jitdefault"
    reloc: str = "default"

    def machine(self, opt: Any = 3) -> Any:
        """LLVM's generator of machine code for this processor."""
        llvm.initialize_all_targets()
        llvm.initialize_all_asmprinters()
        return llvm.Target.from_triple(self.triple).create_target_machine(
            cpu=self.cpu, features=self.features, opt=opt, reloc=self.reloc, codemodel=self.model,
            jit=self.model == "jitdefault",
        )  # fmt: skip

    def adopt(self, module: Any, machine: Any) -> None:
        """Set processor and layout of data of a module of IR that was made for another one."""
        module.triple, module.data_layout = self.triple, str(machine.target_data)


WASM = Processor(
    "wasm32-unknown-unknown", "generic",
    "+bulk-memory,+bulk-memory-opt,+mutable-globals,+sign-ext,+nontrapping-fptoint,+simd128", "default", "static",
)  # fmt: skip
"""WebAssembly (`wasm`), with the instructions that all browsers have had since 2023."""
MACHINES = {
    "x86_64": Processor("x86_64-unknown-linux-gnu", LEVEL, reloc="static"),
    "aarch64": Processor("aarch64-unknown-linux-gnu", ARM64),
}
"""Machines with Linux, by the names that `platform.machine` and wheels give them: kernels can be compiled for each on
any of them (`translation`). A process there looks for the same triple, processor and instructions."""


def named(name: str) -> Processor:
    """The processor of the machines of this name."""
    if name not in MACHINES:
        raise ProcessorError(f"found processor {name!r}, expected {' or '.join(MACHINES)}")
    return MACHINES[name]
