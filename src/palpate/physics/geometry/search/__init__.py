"""What searches for the closest point share: orders, corners, the foot that they fill, starts on a NURBS surface."""
