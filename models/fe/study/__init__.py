"""The pressed fingertip of the tactile-flow paper: records, sections, isostrain volumes, published statements."""
