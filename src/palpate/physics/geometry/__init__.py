"""Surfaces: NURBS and triangle meshes, the closest point on them, their normals."""
