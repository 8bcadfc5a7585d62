"""What the searches for the closest point share: the foot that they fill, and where one on a NURBS surface starts."""
