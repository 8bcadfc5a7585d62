"""Pictures of recordings, and pages in the browser."""
