"""Every name of numba that palpate uses and numba does not promise to keep, with the reason.

The public names are those of `numba`, `numba.types` and `numba.extending`, and the events of `numba.core.event`. A test
checks that the names listed here exist in the installed numba, and that the sources use no others.
"""

PREFIX = "numba.core."

USED = {
    # A separate target, so that kernels are compiled for a fixed processor without changes of numba's settings.
    "target_extension.CPU": "base of the target; the way that numba documents",
    "target_extension.target_registry": "registers the target",
    "target_extension.dispatcher_registry": "registers the dispatcher of the target",
    "target_extension.jit_registry": "compiles numba's implementations in Python for the target",
    "target_extension.target_override": "selects the target during a compilation",
    "target_extension.current_target": "detects a call from a function of `numba.njit`",
    "registry.cpu_target": "the target of `numba.njit`, into which this call is linked; its processor",
    "registry.CPUTarget": "base of the target's description",
    "registry.CPUDispatcher": "base of kernels",
    "cpu.CPUContext": "base of the code generation of the target",
    "callconv.CPUCallConv": "base of its convention of calls",
    "typing.Context": "base of the typing of the target",
    "utils.threadsafe_cached_property": "as in the overridden properties of `CPUTarget`",
    "externals.c_math_functions": "mathematical functions of C, as `CPUContext` installs them",
    "codegen.JITCodeLibrary": "base of the code of a kernel, which remains IR until an entry point needs it",
    "codegen.JITCPUCodegen": "base of the code generator",
    "environment.lookup_environment": "environments of functions that are linked late",
    "compiler.CompileResult": "content of a cache file",
    "compiler.Flags": "options of a compilation, whose comparison takes 6 % of its time",
    "serialize.dumps": "pickles the content of a cache file",
    # What a kernel depends on, for the name of its cache file.
    "extending._Intrinsic": "an intrinsic, which depends on the function that generates its code",
    "typing.templates.builtin_registry": "functions, methods and attributes that `overload` implements",
    "imputils.builtin_registry": "lowering from outside numba",
    # Arrays and records in kernels without owner and without allocation.
    "cgutils": "tuples, stack memory and arrays in generated code",
}
"""Names below `numba.core`."""

OTHERS = {
    "numba.np.arrayobj.make_array": "arrays in generated code: fields of an array",
    "numba.np.arrayobj.populate_array": "arrays in generated code: an array at an address",
    "numba.np.linalg": "its search for scipy.linalg at import takes 0.3 s and is skipped",
}

OVERRIDDEN = {
    "codegen.JITCPUCodegen._get_host_cpu_name": "the fixed processor",
    "codegen.JITCPUCodegen._get_host_cpu_features": "its instructions",
    "codegen.JITCPUCodegen._init": "LLVM's machine of another processor, without an engine",
    "codegen.JITCPUCodegen._create_empty_module": "for another processor",
    "codegen.JITCPUCodegen._library_class": "the class of libraries",
    "codegen.JITCPUCodegen.set_env": "sets environments when machine code exists",
    "codegen.JITCodeLibrary.add_ir_module": "replaces calls of the C library",
    "codegen.JITCodeLibrary.add_linking_library": "links late",
    "codegen.JITCodeLibrary._optimize_functions": "optimises whole entry points only",
    "codegen.JITCodeLibrary.has_dynamic_globals": "also of linked functions",
    "codegen.JITCodeLibrary.finalize": "generates machine code of an entry point with all functions that it calls",
    "codegen.JITCodeLibrary._finalize_final_module": "generates machine code that this process does not load",
    "codegen.JITCodeLibrary._finalize_specific": "registers the functions of machine code",
    "codegen.JITCodeLibrary.get_pointer_to_function": "generates machine code on request",
    "codegen.JITCodeLibrary.serialize_using_object_code": "stores IR, or machine code of an entry point",
    "codegen.JITCodeLibrary._unserialize": "loads both",
    "cpu.CPUContext.init": "the code generator of the target",
    "cpu.CPUContext.load_additional_registries": "without the import of scipy.linalg",
    "cpu.CPUContext.call_conv": "exceptions without lines of the source",
    "callconv.CPUCallConv.build_excinfo_struct": "the same",
    "typing.Context.init": "memory for resolved calls",
    "typing.Context.resolve_function_type": "keeps resolved calls",
    "registry.CPUTarget._toplevel_typing_context": "the typing of the target",
    "registry.CPUTarget._toplevel_target_context": "the code generation of the target",
    "registry.CPUDispatcher.targetdescr": "the target",
    "registry.CPUDispatcher.compile": "waits for other processes, and suspends garbage collection",
    "registry.CPUDispatcher.get_call_template": "a call from a kernel uses the function without wrapper",
    "registry.CPUDispatcher.get_overload": "the same, and the code for a call from `numba.njit`",
    "compiler.Flags.__hash__": "constant: all flags of kernels are the same",
    "compiler.Flags.values": "faster",
    "compiler.Flags.get_mangle_string": "names of functions contain the hash of their code",
}
"""Members below `numba.core` that classes of palpate replace."""

MEMBERS = {
    "_codegen": "library: its generator",
    "_internal_codegen": "context: its generator, set in `init`",
    "_data_layout": "generator: sizes and alignments of the processor",
    "_defined_symbols": "engine: functions with machine code",
    "_engine": "generator: LLVM's engine",
    "_finalize_final_module": "library: generates machine code",
    "_finalized": "library: whether it has machine code",
    "_final_module": "library: its IR",
    "_get_compiled_object": "library: its machine code",
    "_get_module_for_linking": "library of numba that a kernel calls: its IR",
    "_linking_libraries": "library: functions that it calls",
    "_loopvect": "generator: setting",
    "_module_pass_manager": "generator: LLVM's passes",
    "_opt_level": "generator: setting",
    "_raise_if_finalized": "library: check",
    "_reload_init": "library: initialisation after loading",
    "_set_compiled_object": "library: sets machine code from a file",
    "_attr": "template of `overload_method`: the name of the method",
    "_overload_func": "template of `overload`: its implementation",
    "_ctor_kwargs": "intrinsic: its options",
    "_defn": "intrinsic: the function that generates its code",
    "_prefer_literal": "intrinsic: whether it takes literal types",
    "_tm": "generator: LLVM's machine",
    "_customize_flags": "compiler of a dispatcher: makes the flags",
    "_compiler": "dispatcher: its compiler",
    "_cache": "dispatcher: its cache on disk, replaced",
    "_impl_keys": "function type: its resolved calls",
    "_rebuild": "result of a compilation: from the content of a file",
    "_reduce": "result of a compilation: as the content of a file",
    "_target_name": "target: its name",
    "_values": "flags: those that differ from the default",
    "_getvalue": "structure in generated code: its value",
}
"""Private members that are used or set."""
