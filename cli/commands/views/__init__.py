"""Pictures, films and the page."""
