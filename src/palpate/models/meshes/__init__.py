"""Reading meshes of tetrahedra of other programs, in a process with limits."""
