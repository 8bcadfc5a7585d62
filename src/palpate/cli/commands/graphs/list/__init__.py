"""List nodes, messages, effects, tissues and material laws."""
