"""The deformed surface of a touch: its colours, views by pyvista, films."""
