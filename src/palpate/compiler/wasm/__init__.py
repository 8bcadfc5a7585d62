"""WebAssembly from the IR of kernels, with llvmlite alone: no linker, no other compiler.

`link` makes one module of entry points and of all that they call; `object_file` makes the object of LLVM loadable;
`runtime` has what WebAssembly lacks, as kernels: the fused product and sum, the remainder, memory of arrays.
"""
