"""Files of other programs: meshes of tetrahedra, read in a process with limits; checks of HDF5 files."""
