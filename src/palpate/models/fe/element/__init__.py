"""Elements: shape functions, faces, validity of curved elements, meshes of tetrahedra and their files."""
