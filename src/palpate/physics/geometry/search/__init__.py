"""What searches for the closest point share: their order, corners of triangles, the foot, and starts on a NURBS surface."""
