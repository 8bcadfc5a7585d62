"""What people look at: pictures of a recording, and the pages in the browser."""
