"""Pin displays: inFORM's boards of motorised pins, and the Dot Pad's dots."""
