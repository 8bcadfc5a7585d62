"""The pressed fingertip of the tactile-flow paper: boundary conditions, records, isostrain volumes."""
