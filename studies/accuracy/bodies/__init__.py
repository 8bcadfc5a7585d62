"""What the bodies that ship have to be given so that they stand for the slab: the file that is called like a body has
`methods()`. A body without a file is taken by the settings that are called like the slab's, see `of_user`."""
