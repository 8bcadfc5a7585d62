"""Contact of two organs of simple shape: closed forms, full finite elements, and the bodies of the library."""
