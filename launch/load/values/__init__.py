"""From YAML and texts to the values of settings, with units and with the place of each fault."""
