"""Settings with which the shipped bodies model the slab: `methods()` of the file with the name of the body.

A body without a file gets the material of the slab in the settings of the same name, see `methods.of_user`.
"""
