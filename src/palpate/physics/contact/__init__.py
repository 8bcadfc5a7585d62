"""Contact of fingertip and body: the series law, its terminal form, the load distribution, the force uncertainty."""
