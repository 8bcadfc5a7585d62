"""Relations between runs that must hold in any scene: a random search for scenes in which one does not."""
