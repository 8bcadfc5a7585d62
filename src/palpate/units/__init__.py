"""Units: `symbols` has every unit, `quantity` the parser of "6 mm", `header` the units of the columns of a table."""
