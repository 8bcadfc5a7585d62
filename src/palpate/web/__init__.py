"""A graph as a folder of static files: the compiled tick as WebAssembly, the memory of its nodes, and the page.

started   from a run to its started nodes          image     their memory, at addresses of WebAssembly
program   code, memory and description together    folder    the files, each with its hash
"""
