"""The compiler of kernels: numba's passes over a function, without what has no effect on its code.

Several of numba's passes end with an analysis of the lifetime of all variables, which the next pass discards; some
prepare for constructs that hardly any kernel contains; and each writes the types of the function into an event. This
takes 20 % of the time of a compilation. A kernel with one of those constructs goes through numba's pass.
"""

import functools
from typing import Any

from numba.core import ir
from numba.core.compiler import CompilerBase, DefaultPassBuilder, StateDict
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.inline_closurecall import RewriteArrayOfConsts
from numba.core.ir_utils import build_definitions
from numba.core.postproc import VariableLifetime
from numba.core.rewrites import rewrite_registry
from numba.core.ssa import reconstruct_ssa
from numba.core.transforms import canonicalize_cfg
from numba.core.typed_passes import AnnotateTypes, DumpParforDiagnostics, NopythonRewrites, PreLowerStripPhis
from numba.core.untyped_passes import GenericRewrites, InlineClosureLikes, IRProcessing, ReconstructSSA

CLOSURES = {"make_function", "build_list"}
"""Expressions of functions that are defined in a kernel, and of lists."""
INLINED = {"reduce", "stencil"}
"""Names of functions that numba inlines."""


class KernelCompiler(CompilerBase):  # type: ignore[misc]
    """numba's compiler with the passes of kernels."""

    def define_pipelines(self) -> list[PassManager]:
        if self.state.func_ir is not None:  # a part of a function
            return [DefaultPassBuilder.define_nopython_pipeline(self.state)]
        return [_passes(self.state.flags)]


class Passes(PassManager):
    """Passes without a timer, an event and a text of the types for each."""

    def _runPass(self, index: int, pss: Any, internal_state: Any) -> None:
        pss.analysis = self._analysis
        pss.run_initialization(internal_state)
        pss.run_pass(internal_state)
        pss.run_finalizer(internal_state)


@register_pass(mutates_CFG=True, analysis_only=False)
class Canonical(IRProcessing):
    """Loops with one way back, as all passes expect them. The lifetime of variables is determined on request."""

    _name = "palpate_canonical"

    def run_pass(self, state: Any) -> bool:
        if state.func_ir.is_generator:
            return super().run_pass(state)
        state.func_ir.blocks = canonicalize_cfg(state.func_ir.blocks)
        state.func_ir.variable_lifetime = VariableLifetime(state.func_ir.blocks)
        return True


@register_pass(mutates_CFG=True, analysis_only=False)
class Closures(InlineClosureLikes):
    """Inlines functions that are defined in the kernel, comprehensions, `reduce` and stencils."""

    _name = "palpate_closures"

    def run_pass(self, state: Any) -> bool:
        return super().run_pass(state) if _has_closures(state.func_ir) else False


@register_pass(mutates_CFG=True, analysis_only=False)
class EarlyRewrites(GenericRewrites):
    """Constant indices, powers and exceptions."""

    _name = "palpate_early_rewrites"

    def run_pass(self, state: Any) -> bool:
        blocks = state.func_ir.blocks
        for kind in rewrite_registry.rewrites["before-inference"]:
            rewrite, waiting = kind(state), list(blocks.items())
            while waiting:  # again until nothing matches
                label, block = waiting.pop()
                if rewrite.match(state.func_ir, block, state.typemap, state.calltypes):
                    blocks[label] = rewrite.apply()
                    waiting.append((label, blocks[label]))
        return True


@register_pass(mutates_CFG=True, analysis_only=False)
class Assignments(ReconstructSSA):
    """One name for each assignment of a variable."""

    _name = "palpate_assignments"

    def run_pass(self, state: Any) -> bool:
        if state.func_ir.is_generator:
            return super().run_pass(state)
        state.func_ir = reconstruct_ssa(state.func_ir)
        self._patch_locals(state)
        state.func_ir._definitions = build_definitions(state.func_ir.blocks)
        state.func_ir.variable_lifetime = VariableLifetime(state.func_ir.blocks)
        return True


@register_pass(mutates_CFG=True, analysis_only=False)
class Merges(PreLowerStripPhis):
    """Assignments in place of the merges of `Assignments`."""

    _name = "palpate_merges"

    def run_pass(self, state: Any) -> bool:
        if state.func_ir.is_generator:
            return super().run_pass(state)
        state.func_ir = self._strip_phi_nodes(state.func_ir)
        state.func_ir._definitions = build_definitions(state.func_ir.blocks)
        return True


@register_pass(mutates_CFG=True, analysis_only=False)
class LateRewrites(NopythonRewrites):
    """Array expressions, arrays of constants and indices that are names."""

    _name = "palpate_late_rewrites"

    def run_pass(self, state: Any) -> bool:
        kinds = [kind for kind in rewrite_registry.rewrites["after-inference"] if kind is not RewriteArrayOfConsts]
        if _has_closures(state.func_ir) or any(
            kind(state).match(state.func_ir, block, state.typemap, state.calltypes)
            for kind in kinds
            for block in state.func_ir.blocks.values()
        ):
            return super().run_pass(state)
        return False


REPLACED = {
    IRProcessing: Canonical,
    InlineClosureLikes: Closures,
    GenericRewrites: EarlyRewrites,
    ReconstructSSA: Assignments,
    PreLowerStripPhis: Merges,
    NopythonRewrites: LateRewrites,
}
LEFT_OUT = (AnnotateTypes, DumpParforDiagnostics)
"""Passes that write texts."""


@functools.cache
def _passes(flags: Any) -> PassManager:
    """numba's passes for these flags, which are the same for all kernels, in their order."""
    passes = Passes("kernel")
    for kind, title in DefaultPassBuilder.define_nopython_pipeline(StateDict(flags=flags, func_ir=None)).passes:
        if kind not in LEFT_OUT:
            passes.add_pass(REPLACED.get(kind, kind), title)
    passes.finalize()
    return passes


def _has_closures(function: Any) -> bool:
    """Whether a function can contain what `InlineClosureLikes` inlines, or an array that is made of a list."""
    for block in function.blocks.values():
        for each in block.find_insts(ir.Assign):
            value = each.value
            if isinstance(value, ir.Expr):
                if value.op in CLOSURES or (value.op == "getattr" and value.attr in INLINED):
                    return True
            elif isinstance(value, ir.Global | ir.FreeVar) and value.name in INLINED:
                return True
    return False
