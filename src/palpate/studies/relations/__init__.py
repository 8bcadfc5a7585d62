"""Relations between runs that must hold whatever the scene: a random search for scenes in which one does not."""
