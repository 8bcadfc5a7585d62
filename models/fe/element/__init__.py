"""Elements: shape functions, faces, materials, meshes of tetrahedra."""
