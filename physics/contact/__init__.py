"""Two bodies that press on each other: the series law, its terminal form, the spread of a load, the band of force."""
