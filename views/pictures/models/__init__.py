"""Pictures of what models found: fits, scans, the layered fingertip."""
