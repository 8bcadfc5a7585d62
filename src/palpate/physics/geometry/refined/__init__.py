"""Refinement of coarse meshes: thin triangles are removed, edges divided, normals fitted."""
